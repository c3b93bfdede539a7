//! `atsplat fit` as a user runs it.

use atsplat_files::Sha256Digest;
use atsplat_numeric::Tolerance;
use atsplat_splat::gpu::adapters;
use atsplat_tests::skip_without_graphics;
use serde_json::{Value, json};
use tempfile::tempdir;

use crate::common::{SCENE, atsplat, photograph, printed_json, read_json, started, succeed};

const FIT: [&str; 10] = ["fit", "photos", "--views", "..", "--size", "32x32", "--start", SCENE, "--strategy", "fixed"];

/// The scene is optimised for photos at half their size; held-out ones are then compared at that size, at the photos' own, and at an
/// eighth of that.
#[test]
fn held_out_photos_are_compared_at_other_scales() {
    let folder = tempdir().unwrap();
    photograph(folder.path());
    let with_scales = |scales: &'static str| {
        let views = ["fit", "photos", "--views", "..", "--held-out", "..:4", "--size", "32x32", "--scales", scales];
        let run = ["--start", SCENE, "--strategy", "mip-splatting", "--steps", "2", "--out", "fitted.ply", "--json"];
        [&views[..], &run[..]].concat()
    };
    let report = printed_json(folder.path(), &with_scales("2,1,0.25"));
    let rows = report["at-scales"].as_array().unwrap();
    let size = |row: &Value| (row["scale"].as_f64(), row["width"].as_u64(), row["height"].as_u64());
    let expected = [(2.0, 64), (1.0, 32), (0.25, 8)].map(|(scale, side)| (Some(scale), Some(side), Some(side)));
    assert_eq!(rows.iter().map(size).collect::<Vec<_>>(), expected);
    assert_eq!(report["configuration"]["constants"]["blur"], 0.1, "the blur that rendered");
    let last = report["evaluations"].as_array().unwrap().last().unwrap();
    assert_eq!((&rows[1]["psnr"], &rows[1]["ssim"]), (&last["psnr"], &last["ssim"]), "once the size itself");
    assert!([0, 2].iter().all(|&at| rows[at]["psnr"].as_f64().unwrap() > 10.0 && rows[at]["psnr"] != last["psnr"]));
    assert!(rows[0]["ssim"].is_f64() && rows[2]["ssim"].is_null(), "no window fits into 8×8 pixels");
    let enlarged = atsplat(folder.path(), &with_scales("4"));
    assert_ne!(enlarged.code, 0);
    assert!(enlarged.stderr.contains("--scales 4") && enlarged.stderr.contains("128"), "{}", enlarged.stderr);
}

/// The record names the device, and a checkpoint of the CPU is not resumed on an adapter.
#[test]
fn a_fit_on_an_adapter_says_so() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let fit = |more: &[&'static str]| -> Vec<&str> {
        let input = ["fit", "photos", "--views", "..", "--held-out", "..:4", "--size", "32x32", "--start", SCENE];
        let run = ["--strategy", "3dgs", "--steps", "4", "--out", "fitted.ply"];
        [&input[..], &run, more].concat()
    };
    let unknown = atsplat(here, &fit(&["--device", "wgpu:99"]));
    let names_both = unknown.stderr.contains("error: --device wgpu:99: ")
        && unknown.stderr.contains("graphics adapter: expected number 99, found ");
    assert!(unknown.code == 1 && names_both, "{}", unknown.stderr);
    assert!(!here.join("fitted.ply").exists());
    let checkpoint = ["--checkpoint", "state", "--checkpoint-every", "2"];
    let text = succeed(here, &fit(&checkpoint));
    assert!(text.lines().next().is_some_and(|line| line.ends_with(" on cpu")), "{text}");
    let record = || read_json(&here.join("fitted.ply.json"));
    let on_cpu = record();
    assert_eq!(on_cpu["device"], "cpu");
    let Some(adapter) = adapters().into_iter().next() else {
        return skip_without_graphics("cli fit", "none listed");
    };
    let adapter = format!("{adapter}, {}", adapter.driver);
    let expected = format!("checkpoint: device: expected {adapter}, found cpu (state)");
    atsplat(here, &fit(&[&checkpoint[..], &["--resume", "--device", "wgpu:0"]].concat())).says(1, &expected);
    let text = succeed(here, &fit(&["--device", "wgpu:0"]));
    assert!(text.lines().next().is_some_and(|line| line.ends_with(&format!(" on {adapter}"))), "{text}");
    let on_adapter = record();
    assert_eq!(on_adapter["device"], adapter);
    let psnr = |record: &Value| record["evaluations"].as_array().unwrap().last().unwrap()["psnr"].as_f64().unwrap();
    Tolerance::absolute(0.05).assert([psnr(&on_adapter)], [psnr(&on_cpu)], "held-out PSNR");
}

/// The network sees the cameras of a normalised world; the record has those of the photos, as the Gaussians do.
#[test]
fn a_refinement_records_cameras_and_extent_in_the_frame_of_the_photos() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    succeed(here, &["render", SCENE, "--orbit", "8", "--size", "128x128", "--out", "photos"]);
    let fit = ["fit", "photos", "--views", "0,1,3", "--refine", "micro-rooms", "--steps", "1", "--extent", "2.5"];
    let output = ["--optimise-poses", "--out", "fitted.ply", "--json"];
    let record = printed_json(here, &[&fit[..], &output].concat());
    let given = read_json(&here.join("photos/render.json"));
    let pose = |camera: &Value| -> Vec<f64> {
        camera["camera-from-world"].as_array().unwrap().iter().map(|entry| entry.as_f64().unwrap()).collect()
    };
    // After one step, no camera is far from where it was.
    let close = Tolerance::absolute(1e-3);
    for (found, frame) in record["corrections"].as_array().unwrap().iter().zip([0_usize, 1, 3]) {
        close.assert(pose(found), pose(&given["views"][frame]), &format!("frame {frame}"));
    }
    assert_eq!(record["corrections"].as_array().unwrap().len(), 3);
    let extents = [&record["extent"], &record["configuration"]["extent"]].map(|extent| extent.as_f64().unwrap());
    Tolerance::relative(1e-12).assert(extents, [2.5; 2], "extent");
    let weights = concat!(env!("CARGO_MANIFEST_DIR"), "/../../eval/checkpoints/micro-rooms.safetensors");
    let hash = Sha256Digest::of(&std::fs::read(weights).unwrap());
    assert_eq!(record["start"], format!("network micro-rooms, sha256 {hash}"));
}

/// Each of them decides the Gaussians.
#[test]
fn a_record_tells_photos_and_starts_apart() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let record = |start: &'static str, more: &[&'static str]| -> Value {
        let fit = ["fit", "photos", "--views", "..", "--strategy", "fixed", "--steps", "1", "--start", start];
        succeed(here, &[&fit[..], &["--out", "fitted.ply"], more].concat());
        read_json(&here.join("fitted.ply.json"))
    };
    let [wide, small] = ["64x36", "48x27"].map(|size| record(SCENE, &["--size", size]));
    assert_eq!([&wide, &small].map(|record| record["sizes"].clone()), [json!(["64x36"]), json!(["48x27"])]);
    assert_ne!(wide["views-sha256"], small["views-sha256"]);
    assert_eq!((&wide["start-sha256"], &wide["start"]), (&small["start-sha256"], &json!(SCENE)));
    assert!(wide["start-sha256"].is_string() && wide.get("held-out-sha256").is_none(), "{wide}");
    let held_out = record(SCENE, &["--size", "64x36", "--held-out", "..:4"]);
    assert!(held_out["held-out-sha256"].is_string(), "{held_out}");
    assert_ne!(held_out["views-sha256"], wide["views-sha256"]);
    let [near, far] = ["1,4", "1,9"].map(|depths| record("random:40", &["--size", "64x36", "--depths", depths]));
    assert_eq!([&near, &far].map(|record| record["start"].clone()), ["random:40, depths 1,4", "random:40, depths 1,9"]);
    assert_ne!(near["start-sha256"], far["start-sha256"]);
    assert_eq!(near["views-sha256"], wide["views-sha256"]);
}

/// Of five Gaussians, two cannot be repaired.
#[test]
fn broken_gaussians_of_a_start_are_warned_of_and_counted() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let fields = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let mut text = "ply\nformat ascii 1.0\nelement vertex 5\n".to_owned();
    text.extend(fields.split(' ').flat_map(|field| ["property float ", field, "\n"]));
    text.push_str("end_header\n");
    for (x, w) in [("0.5", "1"), ("nan", "1"), ("0", "0"), ("inf", "1"), ("0.25", "1")] {
        text.extend([x, " 0 0 1 0 0 2 -3 -3 -3 ", w, " 0 0 0\n"]);
    }
    std::fs::write(here.join("start.ply"), text).unwrap();
    let fit = ["fit", "photos", "--views", "..", "--size", "32x32", "--start", "start.ply", "--strategy", "fixed"];
    let fitted = atsplat(here, &[&fit[..], &["--steps", "1", "--extent", "1", "--out", "fitted.ply"]].concat());
    assert_eq!(fitted.code, 0, "{}", fitted.stderr);
    let expected = "warning: --start start.ply: 3 of 5 Gaussians are broken, of which 2 are removed and 1 repaired: ";
    assert!(fitted.stderr.contains(expected), "{}", fitted.stderr);
    let record = read_json(&here.join("fitted.ply.json"));
    let counts = ["start-gaussians", "dropped", "gaussians"].map(|field| record[field].as_u64());
    assert_eq!(counts, [Some(5), Some(2), Some(3)]);
    let warnings: Vec<&str> = record["warnings"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    let expected = expected.strip_prefix("warning: ").unwrap();
    assert!(matches!(&warnings[..], [_colours, of_start] if of_start.starts_with(expected)), "{warnings:?}");
}

#[test]
fn errors_name_the_option_that_mends_them() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let fit = ["fit", "photos", "--views", "0,4,6", "--strategy", "fixed", "--steps", "1", "--out", "fitted.ply"];
    for (more, expected) in [
        (&["--size", "96x80"][..], "error: --size 96x80: "),
        (&["--refine", "micro-rooms"], "error: --refine without --size scales photos to 128x128: "),
        (&["--held-out", "0,4", "--start", "random:9"], "error: --start random:9 requires --depths NEAR,FAR: "),
        (&["--memory", "1"], "error: --memory 1 (MiB): memory-limit: "),
        // A held-out photo of 64×64 pixels with twelve bytes for each, and three for each pixel of all three photos.
        (
            &["--held-out", "0", "--memory", "1"],
            " 10000 Gaussians and 2 images, next to 86016 bytes of other images, found ",
        ),
        // More than any machine can allocate.
        (&["--start", "random:1000000000000000"], "error: --memory 8192 (MiB): memory-limit: expected at least "),
        (
            &["--start", "random:1000000000000000", "--memory", "18446744073709551615"],
            "error: max-gaussians: expected at least the 1000000000000000 initial Gaussians, found 1000000",
        ),
    ] {
        atsplat(here, &[&fit[..], more].concat()).says(1, expected);
    }
    let one = atsplat(here, &[&fit[..], &["--held-out", "0,4"]].concat());
    assert!(one.stderr.contains(" is the only view"), "{}", one.stderr);
}

/// An image is missing, in a folder whose name reads like another reason.
#[test]
fn only_errors_about_the_size_name_its_option() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let photos = "a: preprocessing: b";
    std::fs::rename(here.join("photos"), here.join(photos)).unwrap();
    std::fs::remove_file(here.join(photos).join("000001.png")).unwrap();
    let fit =
        ["fit", photos, "--size", "32x32", "--strategy", "fixed", "--steps", "1", "--out", "fitted.ply", "--views"];
    let rejected = atsplat(here, &[&fit[..], &["0,1,2"]].concat());
    let expected = "error: scene \"render\": image-missing: frame 1 (";
    let names_the_frame = rejected.stderr.contains(expected) && !rejected.stderr.contains("--size");
    assert!(rejected.code == 1 && names_the_frame, "{}", rejected.stderr);
}

/// The output of `atsplat render` is one scene, with its images next to the record.
#[test]
fn options_of_datasets_are_rejected_for_renders() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let fit =
        |more: &[&'static str]| atsplat(here, &[&FIT[..], &["--steps", "1", "--out", "fitted.ply"], more].concat());
    for (more, code, expected) in [
        (["--key", "garden"], 1, "--key garden: the output of `atsplat render` is one scene, render (photos)"),
        (["--images", "2"], 2, "COLMAP, found the output of `atsplat render`"),
        (["--frames", "photos"], 2, "--frames: expected RE10K trajectories or a COLMAP model, found the output of"),
    ] {
        fit(&more).says(code, expected);
    }
    assert!(!here.join("fitted.ply").exists());
    assert_eq!(fit(&["--key", "render"]).code, 0);
}

/// The start has degree 1.
#[test]
fn dropped_degrees_of_a_start_are_warned_of() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    for (degree, dropped) in [("0", true), ("1", false), ("2", false)] {
        let more = ["--steps", "1", "--out", "fitted.ply", "--sh-degree", degree];
        let fitted = atsplat(here, &[&FIT[..], &more].concat());
        let warning =
            "the initial Gaussians have spherical harmonics of degree 1: those above --sh-degree 0 are dropped";
        assert_eq!((fitted.code, fitted.stderr.contains(warning)), (0, dropped), "{degree}: {}", fitted.stderr);
    }
}

#[test]
fn filters_of_a_start_that_stay_as_they_are_are_warned_of() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let fit = |start: &str, strategy: &str, out: &str| {
        let views = ["fit", "photos", "--views", "..", "--size", "32x32", "--steps", "1"];
        let fitted = atsplat(here, &[&views[..], &["--start", start, "--strategy", strategy, "--out", out]].concat());
        assert_eq!(fitted.code, 0, "{}", fitted.stderr);
        fitted.stderr.contains("the initial Gaussians have 3D filters (filter_3D)")
    };
    assert!(!fit(SCENE, "fixed", "plain.ply") && !fit(SCENE, "mip-splatting", "mip.ply"));
    assert!(fit("mip.ply", "fixed", "fixed.ply") && !fit("mip.ply", "mip-splatting", "again.ply"));
}

/// What density control cannot do is a warning before the first step.
#[test]
fn too_few_steps_for_density_control_are_warned_of() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let fit = |more: &[&'static str]| {
        let views =
            ["fit", "photos", "--views", "..", "--size", "32x32", "--start", "random:40", "--out", "fitted.ply"];
        let fitted = atsplat(here, &[&views[..], more].concat());
        assert_eq!(fitted.code, 0, "{}", fitted.stderr);
        fitted.stderr
    };
    let never = fit(&["--strategy", "3dgs", "--steps", "3"]);
    let expected = "warning: 3dgs never clones, splits or prunes Gaussians in 3 steps, but in 202 or more";
    assert!(never.contains(expected), "{never}");
    let growth = fit(&["--strategy", "mcmc", "--steps", "122"]);
    let expected = "warning: mcmc grows from 40 to at most 42 of 1000000 Gaussians (max-gaussians): ";
    assert!(growth.contains(expected), "{growth}");
    let reached = fit(&["--strategy", "mcmc", "--steps", "122", "--max-gaussians", "42"]);
    assert!(!reached.contains("mcmc grows"), "{reached}");
    let planned = fit(&["--strategy", "mcmc", "--seconds", "2"]);
    assert!(planned.contains("warning: as planned so far, mcmc "), "{planned}");
}

#[test]
fn files_are_opened_before_the_optimisation() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let fit = |more: &[&'static str]| [&FIT[..], &["--steps", "2", "--out", "fitted.ply"], more].concat();
    for (more, expected) in [
        (["--checkpoint", "photos"], "error: writing photos: "),
        (
            ["--plots", "photos/000000.png"],
            "error: creating the folder photos/000000.png: expected a folder, found the file photos/000000.png",
        ),
    ] {
        atsplat(here, &fit(&more)).says(1, expected);
        assert!(!here.join("fitted.ply").exists(), "{more:?}");
    }
    succeed(here, &fit(&["--checkpoint", "new/state", "--checkpoint-every", "2"]));
    assert!(here.join("new/state").is_file());
}

/// A folder in the place of the contact sheet is noticed when the Gaussians are written.
#[test]
fn no_record_of_an_earlier_run_is_left_next_to_new_gaussians() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let fit = [&FIT[..], &["--steps", "1", "--out", "fitted.ply", "--plots", "plots"]].concat();
    succeed(here, &fit);
    assert!(here.join("fitted.ply.json").is_file());
    std::fs::remove_file(here.join("plots/contact-sheet.png")).unwrap();
    std::fs::create_dir(here.join("plots/contact-sheet.png")).unwrap();
    atsplat(here, &fit).says(1, "contact-sheet.png");
    assert!(here.join("fitted.ply").is_file() && !here.join("fitted.ply.json").exists());
}

/// The time is over while steps are timed.
#[test]
fn a_run_without_a_step_is_a_failure() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let failed = atsplat(here, &[&FIT[..], &["--seconds", "1e-9", "--out", "fitted.ply"]].concat());
    let expected =
        "error: --seconds: the time limit ended before the first step; fitted.ply contains the initial Gaussians";
    failed.says(1, expected);
    assert!(here.join("fitted.ply").is_file());
}

/// Killed long before its last step, and long after its first checkpoint.
#[test]
fn an_interrupted_run_leaves_no_incomplete_file() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let run = ["--steps", "1000000", "--checkpoint", "state", "--checkpoint-every", "100", "--out", "fitted.ply"];
    let mut fit = started(here, &[&FIT[..], &run].concat(), "state");
    fit.kill().unwrap();
    fit.wait().unwrap();
    let mut names: Vec<_> = std::fs::read_dir(here).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    let locks = if cfg!(unix) { &["fitted.ply.lock", "photos", "state", "state.lock"][..] } else { &[] };
    assert!(names == ["photos", "state"] || names == locks, "{names:?}");
    // The locks of a killed process hold nobody up, and go with the next run.
    std::fs::remove_file(here.join("state")).unwrap();
    succeed(here, &[&FIT[..], &["--out", "fitted.ply", "--steps", "1", "--checkpoint", "state"]].concat());
    assert!(!here.join("fitted.ply.lock").exists() && !here.join("state.lock").exists());
}

/// Two runs would leave the Gaussians of one and the record of the other.
#[test]
fn of_two_runs_into_one_file_the_later_one_fails() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let long = ["--out", "fitted.ply", "--steps", "1000000", "--checkpoint", "state", "--checkpoint-every", "100"];
    let mut long = started(here, &[&FIT[..], &long].concat(), "state");
    for (more, expected) in [
        (&["./fitted.ply", "--steps", "1"][..], "fitted.ply is being written by process "),
        (&["other.ply", "--steps", "1", "--checkpoint", "state", "--resume"], "state is being written by process "),
    ] {
        atsplat(here, &[&FIT[..], &["--out"], more].concat()).says(1, expected);
    }
    assert!(!here.join("other.ply").exists() && !here.join("other.ply.lock").exists());
    succeed(here, &[&FIT[..], &["--out", "other.ply", "--steps", "1"]].concat());
    long.kill().unwrap();
    long.wait().unwrap();
}

#[test]
fn a_record_has_the_hash_of_its_file_and_a_missing_checkpoint_is_noted() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let run = ["--out", "fitted.ply", "--steps", "1", "--checkpoint", "state", "--resume"];
    let note = "note: --resume: no checkpoint at state; starting from step 0";
    atsplat(here, &[&FIT[..], &run].concat()).says(0, note);
    let record = read_json(&here.join("fitted.ply.json"));
    let hash = Sha256Digest::of(&std::fs::read(here.join("fitted.ply")).unwrap());
    assert_eq!(record["file-sha256"], hash.to_string());
    assert_eq!(record["steps"], 1);
    assert!(here.join("state").is_file(), "the state at the end, though the interval is longer");
}

#[test]
fn options_that_nothing_reads_are_usage_errors() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    for (more, expected) in [
        (&["--depths", "1,9", "--refine", "micro-rooms"][..], "'--refine <WEIGHTS>'"),
        (&["--depths", "1,9", "--start", "points"], "--depths requires --start random:N (found --start points)"),
        (
            &["--opacities-as-stored"],
            "--opacities-as-stored requires --start with a file of Gaussians (found --start random:10000)",
        ),
        (&["--opacities-as-stored", "--refine", "micro-rooms"], "'--refine <WEIGHTS>'"),
        (&["--evaluate-every", "2"], "--held-out <SEL>"),
        (&["--checkpoint-every", "2"], "--checkpoint <FILE>"),
        (&["--checkpoint", "./fitted.ply"], "--checkpoint ./fitted.ply: --out writes fitted.ply; "),
        (&["--checkpoint", "fitted.ply.json"], "--checkpoint fitted.ply.json: --out writes fitted.ply.json; "),
        (&["--checkpoint", "fitted.ply.cameras.json"], ": --out writes fitted.ply.cameras.json; "),
        (&["--plots", "p", "--checkpoint", "p/contact-sheet.png"], ": --plots writes p/contact-sheet.png; "),
        (&["--start", "random:0"], "--start: expected random:N, found \"random:0\"; N is at least 1"),
    ] {
        let fit = ["fit", "photos", "--views", "..", "--strategy", "3dgs", "--steps", "2", "--out", "fitted.ply"];
        atsplat(here, &[&fit[..], more].concat()).says(2, expected);
    }
    for (data, more, expected) in [
        ("photos", "--absolute-gradients", "--absolute-gradients requires --strategy 3dgs or mip-splatting"),
        ("s3://bucket/photos", "--start=points", "--start points requires DATA on this machine"),
    ] {
        let fit = ["fit", data, "--views", "..", "--strategy", "mcmc", "--steps", "2", "--out", "fitted.ply", more];
        atsplat(here, &fit).says(2, expected);
    }
    assert_eq!(std::fs::read_dir(here).unwrap().count(), 0, "nothing was written");
}
