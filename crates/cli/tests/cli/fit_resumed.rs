//! Runs of `atsplat fit` that continue from a checkpoint.

use tempfile::tempdir;

use crate::common::{SCENE, atsplat, json_of, photograph, printed_json, started, succeed};

/// Killed after its first checkpoint. Gaussians are split before and after it.
#[test]
fn a_run_that_was_killed_is_resumed_in_the_middle() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let input = ["fit", "photos", "--views", "..", "--held-out", "..:4", "--size", "32x32", "--start", SCENE];
    let run = ["--strategy", "3dgs", "--steps", "1000", "--evaluate-every", "30", "--checkpoint", "state"];
    let output = ["--checkpoint-every", "150", "--out", "fitted.ply", "--plots", "plots"];
    let fit = [&input[..], &run, &output].concat();
    let results = ["fitted.ply", "fitted.ply.json", "plots/learning-curve.svg"].map(|file| here.join(file));
    let read = || results.each_ref().map(|file| std::fs::read(file).unwrap());
    succeed(here, &fit);
    let whole = read();
    for file in results.iter().chain([&here.join("state")]) {
        std::fs::remove_file(file).unwrap();
    }
    let mut killed = started(here, &fit, "state");
    killed.kill().unwrap();
    killed.wait().unwrap();
    assert!(results.iter().all(|file| !file.exists()), "it ended");
    let resumed = atsplat(here, &[&fit[..], &["--resume"]].concat());
    let compared = |step: u64| resumed.stderr.contains(&format!("after {step} steps: "));
    assert!(resumed.code == 0 && !compared(30) && compared(990), "{}", resumed.stderr);
    assert!(read() == whole, "to the bit");
}

/// From the state after its last step, which has all comparisons and the losses of every photo.
#[test]
fn a_resumed_run_has_the_record_and_the_curve_of_an_uninterrupted_one() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let fit = |more: &[&'static str]| -> Vec<&str> {
        let input = ["fit", "photos", "--views", "..", "--held-out", "..:4", "--size", "32x32", "--start", SCENE];
        let run = ["--strategy", "3dgs", "--steps", "7", "--evaluate-every", "2", "--checkpoint", "state"];
        let output = ["--checkpoint-every", "6", "--out", "fitted.ply", "--plots", "plots"];
        [&input[..], &run, &output, more].concat()
    };
    let read = |file: &str| std::fs::read_to_string(here.join(file)).unwrap();
    let results = || ["fitted.ply.json", "plots/learning-curve.svg"].map(read);
    succeed(here, &fit(&[]));
    let (whole, gaussians) = (results(), std::fs::read(here.join("fitted.ply")).unwrap());
    let record = json_of(&whole[0]);
    let steps = record["evaluations"].as_array().unwrap().iter().map(|evaluation| evaluation["step"].as_u64());
    assert_eq!(steps.collect::<Vec<_>>(), [2, 4, 6, 7].map(Some));
    assert!(record["training-psnr"].as_f64().is_some_and(f64::is_finite), "{record}");
    succeed(here, &fit(&["--resume"]));
    assert_eq!(results(), whole);
    assert!(std::fs::read(here.join("fitted.ply")).unwrap() == gaussians);
}

/// The second process takes no step. The third resumes what a version wrote that recorded no time.
#[test]
fn a_resumed_run_reports_the_time_of_all_its_steps() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let fit = ["fit", "photos", "--views", "..", "--size", "32x32", "--start", SCENE, "--strategy", "fixed"];
    let run =
        ["--steps", "300", "--checkpoint", "state", "--checkpoint-every", "300", "--resume", "--out", "fitted.ply"];
    let fit = [&fit[..], &run].concat();
    let report = || printed_json(here, &[&fit[..], &["--json"]].concat());
    let [whole, resumed] = [report(), report()];
    let seconds = [&whole, &resumed].map(|report| report["seconds"].as_f64().unwrap());
    assert!(seconds[1] > 0.5 * seconds[0], "{seconds:?}");
    assert!(resumed.get("seconds-since-step").is_none(), "{resumed}");
    let mut bytes = std::fs::read(here.join("state")).unwrap();
    for (name, other) in [(r#"\"elapsed\":"#, r#"\"elapsee\":"#), ("atsplat.fit-sha256", "atsplat.fit-sha25x")] {
        let at = bytes.windows(name.len()).position(|window| window == name.as_bytes()).unwrap();
        bytes[at..at + name.len()].copy_from_slice(other.as_bytes());
    }
    std::fs::write(here.join("state"), bytes).unwrap();
    assert_eq!(report()["seconds-since-step"], 300);
    atsplat(here, &fit).prints(0, " s (since step 300: its checkpoint has no time) on cpu");
}
