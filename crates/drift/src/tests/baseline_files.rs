//! Baselines and probes as files: what is written is what is read, and what cannot be read replaces nothing.

use super::*;
use crate::probe::Outputs;

#[test]
fn baseline_files_are_exact_and_keep_the_history() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("quick.json");
    let mut base = store(true, 4, 0.3, 1);
    base.targets[5].status = TargetStatus::NonFinite;
    base.targets[5].scores.clear();
    let first = baseline_of(&base);
    let second = first.accept(&store(true, 4, 0.3, 2), &[], acceptance("a better filter"));
    second.write(&path).unwrap();
    assert_eq!(Baseline::read(&path).unwrap(), second);
    let reasons: Vec<_> = second.history.iter().map(|acceptance| acceptance.reason.as_str()).collect();
    assert_eq!(reasons, ["first", "a better filter"]);
    let text = std::fs::read_to_string(&path).unwrap();
    let rows = text.lines().filter(|line| line.contains("\"scene 001\"")).count();
    assert_eq!(rows, 4 + 1 + 3, "a row a line, and a line an image:\n{text}");
    assert_eq!(second.read_probe(&path).unwrap(), None);
    let twice = |part: &str| {
        let row = text.lines().find(|line| line.contains(part)).unwrap();
        text.replacen(row, &format!("{row}\n{row}"), 1)
    };
    // Another format may have fields that are unknown here.
    let newer = text.replace("\"format\": 3", "\"format\": 4,\n  \"colour\": \"blue\"");
    std::fs::write(&path, newer).unwrap();
    let error = Baseline::read(&path).unwrap_err().to_string();
    assert!(error.contains("expected format 1 to 3, found format 4") && !error.contains("colour"), "{error}");
    for broken in [
        text.replace("\"limits\"", "\"limit\""),
        text[..text.len() / 2].to_owned(),
        format!("{}\n}}\n", text.split_once(",\n  \"targets\": [").unwrap().0),
        twice("\"trial_hash\""),
        twice("\"target\":1,"),
    ] {
        std::fs::write(&path, broken).unwrap();
        assert!(matches!(Baseline::read(&path), Err(DriftError::Malformed(_))));
    }
    assert!(matches!(Baseline::read(&folder.path().join("none")), Err(DriftError::Io(_))));
}

/// The file of values is another one although every stage has the same values, as after a kill between the two files.
#[test]
fn a_probe_that_was_not_accepted_with_its_baseline_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("quick.json");
    let ([(first, values), (second, others)], outputs) = probed_twice();
    first.write_with_probe(&path, &values).unwrap();
    assert_eq!(Baseline::read(&path).unwrap().read_probe(&path).unwrap(), Some((Recipe::default(), outputs)));
    second.write(&path).unwrap();
    let error = Baseline::read(&path).unwrap().read_probe(&path).unwrap_err().to_string();
    for part in ["SHA-256: expected the probe that was accepted with the baseline", "quick.probe.safetensors"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    // Baselines had no hash once.
    let mut old = second;
    old.probe.as_mut().unwrap().sha256 = None;
    old.write_with_probe(&path, &others).unwrap();
    let read = Baseline::read(&path).unwrap();
    assert!(read == old && read.read_probe(&path).unwrap().is_some());
}

#[test]
fn a_baseline_without_a_probe_removes_that_of_an_older_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("quick.json");
    let ([(first, values), _], _) = probed_twice();
    first.write_with_probe(&path, &values).unwrap();
    first.write(&path).unwrap();
    assert!(Baseline::probe_path(&path).exists(), "it still belongs to the baseline");
    Baseline { probe: None, ..first }.write(&path).unwrap();
    assert!(!Baseline::probe_path(&path).exists());
    assert_eq!(Baseline::read(&path).unwrap().read_probe(&path).unwrap(), None);
}

#[test]
fn a_baseline_that_cannot_be_written_leaves_the_old_probe() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("quick.json");
    let ([(first, values), (second, others)], _) = probed_twice();
    first.write_with_probe(&path, &values).unwrap();
    let probe = || std::fs::read(Baseline::probe_path(&path)).unwrap();
    let before = probe();
    std::fs::remove_file(&path).unwrap();
    std::fs::create_dir(&path).unwrap();
    assert!(matches!(second.write_with_probe(&path, &others), Err(DriftError::Io(_))));
    assert!(probe() == before, "the probe of the old baseline");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no temporary file remains");
}

/// JSON has no NaN: what is written in its place is no number.
#[test]
fn a_baseline_that_could_not_be_read_again_replaces_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("quick.json");
    let ([(first, values), (mut second, others)], _) = probed_twice();
    first.write_with_probe(&path, &values).unwrap();
    second.probe.as_mut().unwrap().scores.insert("psnr".to_owned(), f64::NAN);
    for error in [second.write_with_probe(&path, &others), second.write(&path)].map(Result::unwrap_err) {
        let error = error.to_string();
        assert!(error.starts_with("the new baseline: expected one that can be read again, found "), "{error}");
    }
    let read = Baseline::read(&path).unwrap();
    assert!(read == first && read.read_probe(&path).unwrap().is_some(), "the old one with its probe");
}

/// As of a probe whose recipe had no metric, which earlier versions ran.
#[test]
fn a_stage_without_values_has_a_fingerprint_that_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("quick.json");
    let (_, mut outputs) = probed_twice();
    outputs.scores.iter_mut().for_each(std::collections::BTreeMap::clear);
    let fingerprint = outputs.fingerprints().pop().unwrap();
    assert_eq!((fingerprint.values, fingerprint.min, fingerprint.mean, fingerprint.max), (0, None, None, None));
    let baseline = baseline_of(&store(true, 4, 0.3, 1));
    let (baseline, values) = baseline.with_probe(Recipe::default(), &outputs).unwrap();
    baseline.write_with_probe(&path, &values).unwrap();
    let read = Baseline::read(&path).unwrap();
    assert_eq!(read.read_probe(&path).unwrap(), Some((Recipe::default(), outputs)));
}

/// Two baselines whose probes have the same values from different files, and the first probe: the second has a byte that no
/// decoder reads.
fn probed_twice() -> ([(Baseline, Vec<u8>); 2], Outputs) {
    let inputs = Inputs::pattern(&atsplat_splat::RendererConstants::default()).unwrap();
    let outputs = run(&Pipeline::of(&Recipe::default()).unwrap(), &inputs).unwrap();
    let mut others = outputs.clone();
    others.inputs.files[0].push(0);
    assert_eq!(others.fingerprints(), outputs.fingerprints());
    let both = [&outputs, &others].map(|outputs| {
        let baseline = baseline_of(&store(true, 4, 0.3, 1));
        baseline.with_probe(Recipe::default(), outputs).unwrap()
    });
    (both, outputs)
}
