//! Rows depend on the data they were made from, and a store has one writer at a time.

#![cfg(unix)]

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, SystemTime};

use crate::common::{atsplat, succeed};
use crate::evaluation::{bare, write_noise};
use atsplat_model::ModelConfig;
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{ModelWeights, Precision, StoredTensors, TensorFile, generated};
use atsplat_results::Results;

const RUN: [&str; 8] = ["run", "tiny.toml", "--data", "data", "--method", "nearest-view,warp", "--out", "store"];

fn results(here: &Path, store: &str) -> Results {
    Results::read(&here.join(store)).unwrap()
}

/// Names of folders cannot have these characters. A title is stated later, corrected, and kept when the command does not state it;
/// no row depends on it.
#[test]
fn a_title_is_text_in_every_format_and_no_drift() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    succeed(here, &[&RUN[..7], &["own", "--metrics", "psnr", "--keep-images", "all"]].concat());
    let renders = ["--renders", "own/images/tiny/warp", "--name", "mine", "--deterministic", "--metrics", "psnr"];
    let score = |more: &[&str]| {
        let args = ["score", "tiny.toml", "--data", "data", "--out", "scores"];
        atsplat(here, &[&args[..], &renders, more].concat())
    };
    let long = "x".repeat(81);
    for wrong in ["", " ", "two\nlines", long.as_str()] {
        score(&["--title", wrong]).says(2, "expected a title in one line of at most 80 characters, found ");
    }
    assert_eq!(score(&[]).code, 0);
    let first = results(here, "scores");
    assert_eq!(first.provenance.methods[0].title, "mine");
    succeed(here, &["drift", "accept", "scores", "--baseline", "baseline.json", "--why", "first results"]);

    assert_eq!(score(&["--title", "3DGS"]).code, 0);
    assert_eq!(score(&["--title", " w/o d_2 | 3DGS* 50% & $x #1 "]).code, 0);
    assert_eq!(score(&[]).code, 0);
    let titled = results(here, "scores");
    assert_eq!(titled.provenance.methods[0].title, "w/o d_2 | 3DGS* 50% & $x #1");
    assert_eq!(bare(&titled), bare(&first));
    let drift = succeed(here, &["drift", "scores", "--baseline", "baseline.json"]);
    assert!(!drift.contains("title") && !drift.contains("3DGS"), "{drift}");

    succeed(here, &["report", "scores", "--methods", "mine", "--out", "page"]);
    let table = |extension: &str| {
        std::fs::read_to_string(here.join("page/tables/protocol-tiny").with_extension(extension)).unwrap()
    };
    for (extension, expected) in [
        ("md", "| w/o d\\_2 \\| 3DGS\\* 50% &amp; \\$x #1 | "),
        ("tex", "w/o d\\_2 \\textbar{} 3DGS* 50\\% \\& \\$x \\#1 & "),
        ("csv", "w/o d_2 | 3DGS* 50% & $x #1,measured,"),
    ] {
        let text = table(extension);
        assert!(text.lines().any(|line| line.starts_with(expected)), "{expected}\n{text}");
    }
}

/// Number of rounds of two processes; `ATSPLAT_ROUNDS` sets it.
fn rounds() -> usize {
    std::env::var("ATSPLAT_ROUNDS").map_or(4, |rounds| rounds.parse().unwrap())
}

fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args([name, &child.id().to_string()]).status().unwrap().success());
}

#[test]
fn a_second_writer_is_rejected_and_no_trial_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 16);
    succeed(here, &[&RUN[..7], &["undisturbed"]].concat());
    let expected = bare(&results(here, "undisturbed"));
    assert_eq!(expected.0.len(), 32);
    let mut met = 0;
    for round in 0..rounds() {
        let store = format!("store-{round}");
        let args = [&RUN[..7], &[store.as_str()]].concat();
        let mut first = Command::new(env!("CARGO_BIN_EXE_atsplat"))
            .args(&args)
            .current_dir(here)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        while !["run.json", "provenance.json"].iter().all(|file| here.join(&store).join(file).exists()) {
            std::thread::sleep(Duration::from_millis(1));
        }
        // At any point of its work.
        std::thread::sleep(Duration::from_millis((round * 7 % 20) as u64));
        signal(&first, "-STOP");
        if first.try_wait().unwrap().is_some() {
            // It ended before it could be stopped.
            continue;
        }
        met += 1;
        let second = atsplat(here, &args);
        assert_eq!(second.code, 1, "{}", second.stdout);
        let process = format!("{store} is being written by process {} on ", first.id());
        for part in [process.as_str(), "UTC", "--shard 1/2", "atsplat merge"] {
            assert!(second.stderr.contains(part), "{part}: {}", second.stderr);
        }
        // Readers are not locked out, though there may be nothing to read yet.
        let report = atsplat(here, &["tradeoff", &store]);
        let is_early = report.code == 1 && report.stderr.contains("nothing was scored: no method has a trial");
        assert!(report.code == 0 || is_early, "{}: {}", report.code, report.stderr);
        signal(&first, "-CONT");
        assert!(first.wait().unwrap().success());
        assert_eq!(bare(&results(here, &store)), expected, "round {round}");
    }
    assert!(met > 0, "the second process never met the first");
}

/// Writes an image with a trailing byte and an old modification time.
fn write_with_tail(path: &Path, image: &[u8], tail: u8) {
    std::fs::write(path, [image, &[tail]].concat()).unwrap();
    let then = SystemTime::UNIX_EPOCH + Duration::from_secs(1_700_000_000);
    std::fs::File::options().write(true).open(path).unwrap().set_modified(then).unwrap();
}

#[test]
fn changed_images_are_recomputed_and_verify_reads_all() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 3);
    let image = here.join("data/scene-01/0.png");
    let bytes = std::fs::read(&image).unwrap();
    write_with_tail(&image, &bytes, 1);
    assert!(succeed(here, &RUN).contains("6 results computed"));
    assert!(succeed(here, &[&RUN[..], &["--verify"]].concat()).contains("0 results computed; 6 were there before"));
    // With the same size and modification time, but another time of its last change.
    write_with_tail(&image, &bytes, 2);
    assert!(succeed(here, &RUN).contains("2 results computed; 4 were there before"));
    // Where the store says that images have changed, only reading them tells that they have not.
    let digests = here.join("store/digests.txt");
    let text = std::fs::read_to_string(&digests).unwrap();
    let wrong = |line: &str| format!("{} {}\n", line.rsplit_once(' ').unwrap().0, "0".repeat(64));
    std::fs::write(&digests, text.lines().map(wrong).collect::<Vec<_>>().concat()).unwrap();
    assert!(succeed(here, &[&RUN[..], &["--verify"]].concat()).contains("0 results computed; 6 were there before"));
    // A different image.
    let other = std::fs::read(here.join("data/scene-02/0.png")).unwrap();
    std::fs::write(&image, other).unwrap();
    let alone = [&RUN[..5], &["warp"], &RUN[6..]].concat();
    atsplat(here, &alone).says(1, "nearest-view on tiny, scene \"scene-01\", entry 0: its images or cameras changed");
    assert!(succeed(here, &RUN).contains("2 results computed; 4 were there before"));
    succeed(here, &[&RUN[..7], &["fresh"]].concat());
    assert_eq!(bare(&results(here, "store")), bare(&results(here, "fresh")));
}

#[test]
fn rejects_a_store_given_twice_and_counts_repeated_results() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 4);
    for shard in ["1/2", "2/2"] {
        let store = format!("part-{}", &shard[..1]);
        succeed(here, &[&RUN[..7], &[&store, "--shard", shard]].concat());
    }
    std::os::unix::fs::symlink(here.join("part-1"), here.join("linked")).unwrap();
    for again in ["part-1", "./part-1/", "linked"] {
        atsplat(here, &["merge", "part-1", "part-2", again, "--out", "merged"]).says(2, "is the same store as part-1");
        atsplat(here, &["report", "part-1", again, "--out", "page"]).says(2, "is the same store as part-1");
    }
    assert!(!here.join("page").exists());
    let copied = Command::new("cp").args(["-r", "part-1", "copy"]).current_dir(here).status().unwrap();
    assert!(copied.success());
    atsplat(here, &["merge", "part-1", "copy", "part-2", "--out", "merged"]).says(0, "4 results are in several stores");
    let merged = atsplat(here, &["merge", "part-1", "part-2", "--out", "again"]);
    assert!(merged.code == 0 && merged.stderr.is_empty(), "{}", merged.stderr);
    // A whole run among the parts is named.
    succeed(here, &[&RUN[..7], &["whole"]].concat());
    let refused = atsplat(here, &["merge", "part-1", "whole", "part-2", "--out", "none"]);
    let error = "error: merging whole: numbers of shards of the two runs differ: expected 2 shards, found a whole run";
    assert!(refused.code == 1 && refused.stderr.starts_with(error), "{}", refused.stderr);
}

fn weights(here: &Path, name: &str, change: impl FnOnce(&mut StoredTensors)) -> PathBuf {
    let config = ModelConfig::named("nano").unwrap();
    let tensors = generated(&parameters(&config), 3);
    let mut stored = ModelWeights::new(config, [].into(), &tensors).unwrap().to_stored(Precision::Half).unwrap();
    change(&mut stored);
    let path = here.join(name);
    stored.write(&path).unwrap();
    path
}

#[test]
fn rejects_weights_with_an_edited_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let edit = |stored: &mut StoredTensors| {
        let text = stored.metadata.get_mut("atsplat.configuration").unwrap();
        *text = text.replacen("ratio = 0.25", "ratio = 0.125", 1);
    };
    weights(here, "whole.safetensors", |_| ());
    let edited = weights(here, "edited.safetensors", edit);
    weights(here, "earlier.safetensors", |stored| {
        stored.metadata.insert("atsplat.format".to_owned(), "1".to_owned());
        stored.metadata.remove("atsplat.metadata-sha256").unwrap();
        edit(stored);
    });
    let message = succeed(here, &["weights", "verify", "whole.safetensors"]);
    assert!(message.contains("complete: ") && !message.contains("no hash recorded"), "{message}");
    let rejected = atsplat(here, &["weights", "verify", "edited.safetensors"]);
    let named = rejected.stderr.contains("configuration, provenance") && rejected.stderr.contains("edited.safetensors");
    assert!(rejected.code == 1 && named, "{}", rejected.stderr);
    assert!(TensorFile::open(&edited).is_ok(), "its tensors are as they were");
    let message = succeed(here, &["weights", "verify", "earlier.safetensors"]);
    assert!(message.contains("no hash recorded") && !message.contains("whole"), "{message}");
}

#[test]
fn a_report_without_results_is_a_failure() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    succeed(here, &RUN);
    let results = Results { trials: Vec::new(), targets: Vec::new(), ..results(here, "store") };
    results.write(&here.join("bare")).unwrap();
    for (args, expected) in [
        (&["store", "--tables", "dl3dv"][..], "--tables: the stores have no results for any of these tables: dl3dv"),
        (&["bare"], "the stores have no results: bare"),
    ] {
        atsplat(here, &[&["report"], args, &["-o", "page"]].concat()).says(1, expected);
        assert!(!here.join("page/index.html").exists(), "{args:?}");
    }
}
