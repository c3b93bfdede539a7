//! Indices whose targets are not those of their protocol.

use std::path::Path;

use crate::common::{Outcome, atsplat, succeed};
use crate::evaluation::write_noise;
use atsplat_protocol::IndexFile;
use atsplat_results::Results;

/// Runs the protocol `tiny.toml` on an index, into a store of the index's name, and lints the index.
fn outcomes(here: &Path, name: &str, entries: &str) -> [Outcome; 3] {
    let index = format!("{name}.json");
    std::fs::write(here.join(&index), entries).unwrap();
    let run = ["run", "tiny.toml", "--data", "data", "--method", "nearest-view", "--index", &index, "--out", name];
    let report = ["report", name, "--out", "page", "--strict"];
    let lint = ["protocol", "lint", &index, "--preset", "tiny.toml", "--strict"];
    [atsplat(here, &[&run[..], &["--strict"]].concat()), atsplat(here, &report), atsplat(here, &lint)]
}

/// The protocol is one of targets inside the window, by the sampling rule that it names.
#[test]
fn targets_that_are_not_the_protocols_fail_a_strict_run() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 2);
    let second = r#""scene-01": {"context": [3, 20], "target": [1, 9, 25]}"#;
    for (name, first, kind) in [
        ("inside", r#"{"context": [3, 20], "target": [4, 8, 12]}"#, None),
        (
            "outside",
            r#"{"context": [3, 20], "target": [1, 22, 25]}"#,
            Some("entries with every target outside the window"),
        ),
        ("inputs", r#"{"context": [3, 20], "target": [20, 3]}"#, Some("entries whose targets are all context frames")),
    ] {
        let [run, report, lint] = outcomes(here, name, &format!(r#"{{"scene-00": {first}, {second}}}"#));
        let expected = if kind.is_some() { 4 } else { 0 };
        assert_eq!([run.code, report.code], [expected; 2], "{name}: {}{}", run.stdout, report.stderr);
        let Some(kind) = kind else { continue };
        assert!(run.stdout.contains(&format!("warning: tiny: 1 {kind}")), "{name}: {}", run.stdout);
        assert!(report.stderr.contains(&format!("tiny: 1 {kind}")), "{name}: {}", report.stderr);
        lint.says(4, &format!("1 {kind}"));
    }
}

/// Sampled windows get the targets that the protocol derives from published ones.
#[test]
fn a_sampled_index_is_split_as_its_protocol_says() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let preset = std::fs::read_to_string(here.join("tiny.toml")).unwrap();
    let derivation = "targets = [6, 6]\nderivation = { rule = \"shifted-window\", margin = 3 }";
    std::fs::write(here.join("tiny.toml"), preset.replacen("targets = [1, 99]", derivation, 1)).unwrap();
    let rule = "[sampler]\nsampler = 'farthest-point'\nwindow = 12\ncontext-views = 2\ntargets = { rule = 'window' }\n";
    std::fs::write(here.join("rule.toml"), rule).unwrap();
    let args = ["run", "tiny.toml", "--data", "data", "--method", "nearest-view", "--out", "store", "--strict"];
    succeed(here, &[&args[..], &["--sampler", "rule.toml"]].concat());
    let results = Results::read(&here.join("store")).unwrap();
    let context = &results.trials[0].context;
    let (first, last) = (*context.iter().min().unwrap(), *context.iter().max().unwrap());
    let targets: Vec<u64> = results.targets.iter().map(|row| row.frame).collect();
    assert_eq!(targets, (first - 3..first).chain(last + 1..last + 4).collect::<Vec<_>>());
}

/// The first five of forty frames have no image, and are counted once.
#[test]
fn the_split_of_a_sampled_index_takes_only_frames_with_an_image() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    for frame in 0..5 {
        std::fs::remove_file(here.join(format!("data/scene-00/{}.png", frame * 33_367))).unwrap();
    }
    let preset = std::fs::read_to_string(here.join("tiny.toml")).unwrap();
    let derivation = "targets = [6, 6]\nderivation = { rule = \"shifted-window\", margin = 3 }";
    std::fs::write(here.join("tiny.toml"), preset.replacen("targets = [1, 99]", derivation, 1)).unwrap();
    let rule = "[sampler]\nsampler = 'farthest-point'\nwindow = 12\ncontext-views = 2\ntargets = { rule = 'window' }\n";
    std::fs::write(here.join("rule.toml"), rule).unwrap();
    let args = ["run", "tiny.toml", "--data", "data", "--method", "nearest-view", "--out", "store"];
    let run = atsplat(here, &[&args[..], &["--sampler", "rule.toml"]].concat());
    run.prints(0, "warning: tiny: 5 missing-image: ");
    assert!(!run.stderr.contains("missing-image"), "{}", run.stderr);
    let results = Results::read(&here.join("store")).unwrap();
    let targets: Vec<u64> = results.targets.iter().map(|row| row.frame).collect();
    assert!(targets.len() == 6 && targets.iter().all(|frame| *frame >= 5), "{targets:?}");
}

/// As with other context views, their trials run.
#[test]
fn another_number_of_targets_is_a_warning_of_a_run_and_a_fault_of_a_lint() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let preset = std::fs::read_to_string(here.join("tiny.toml")).unwrap();
    std::fs::write(here.join("tiny.toml"), preset.replacen("targets = [1, 99]", "targets = [3, 4]", 1)).unwrap();
    let [run, report, lint] = outcomes(here, "two", r#"{"scene-00": {"context": [3, 20], "target": [4, 12]}}"#);
    let expected =
        "1 entries without the preset's 3 to 4 targets: scene scene-00, entry 0, field target: expected 3 to 4";
    assert_eq!([run.code, report.code], [0, 0], "{}{}", run.stdout, report.stderr);
    assert!(run.stdout.contains(&format!("warning: tiny: {expected}")), "{}", run.stdout);
    lint.prints(4, expected);
}

/// Its rows would be in tables under those of the paper.
#[test]
fn a_protocol_of_ones_own_does_not_have_a_built_in_name() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let preset = std::fs::read_to_string(here.join("tiny.toml")).unwrap();
    std::fs::write(here.join("mine.toml"), preset.replacen("name = \"tiny\"", "name = \"re10k-2v-256\"", 1)).unwrap();
    let run = atsplat(here, &["run", "mine.toml", "--data", "data", "--method", "warp", "--out", "store"]);
    assert!(run.code != 0 && run.stderr.contains("field name: expected another name"), "{}", run.stderr);
    assert!(run.stderr.contains("mine.toml") && !here.join("store").exists(), "{}", run.stderr);
}

/// The last ten of forty frames have no image.
#[test]
fn targets_outside_a_window_have_images() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    for frame in 30..40 {
        std::fs::remove_file(here.join(format!("data/scene-00/{}.png", frame * 33_367))).unwrap();
    }
    std::fs::write(here.join("index.json"), r#"{"scene-00": {"context": [20, 27], "target": [22]}}"#).unwrap();
    let args = ["protocol", "extrapolate", "index.json", "--data", "data", "-o", "outside.json", "--strict"];
    let split = atsplat(here, &args);
    assert!(split.stdout.contains("1  entries with every target"), "{}", split.stdout);
    let missing = "10  frames without an image or a usable pose";
    split.prints(4, missing);
    let entry = &IndexFile::read(&here.join("outside.json")).unwrap().index.scenes["scene-00"][0];
    assert_eq!((&entry.context, entry.target.last()), (&vec![12, 19], Some(&29)));
}
