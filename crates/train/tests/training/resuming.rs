//! What a run leaves behind is not lost when it is resumed or fails.

use std::collections::BTreeMap;
use std::path::Path;

use atsplat_files::Sha256Digest;
use atsplat_model::weights::{ModelWeights, TensorFile};
use atsplat_train::logs::{self, StepRecord};
use atsplat_train::{Event, Limits, Start, TrainError, Trainer};
use tempfile::tempdir;

use crate::common::{Noise, config, trainer};

fn run(folder: &Path, start: &Start, steps: u64) -> Vec<String> {
    let mut notices = Vec::new();
    let mut on_event = |event: &Event<'_>| {
        if let Event::Notice(text) = event {
            notices.push((*text).to_owned());
        }
    };
    let mut trainer = trainer(config(""), folder, start, Noise::CLEAN);
    trainer.run(Limits { steps: Some(steps), time: None }, &mut on_event).unwrap();
    notices
}

fn resume(folder: &Path) -> Result<Trainer, TrainError> {
    Trainer::with_samples(config(""), Box::new(Noise::CLEAN), folder, &Start::Resume)
}

/// Every file of a run that resuming might replace.
fn contents(folder: &Path) -> BTreeMap<&'static str, Option<Vec<u8>>> {
    ["weights.safetensors", "steps.jsonl", "evaluations.jsonl"]
        .map(|name| (name, std::fs::read(folder.join(name)).ok()))
        .into()
}

/// Checkpoints are large: users move or remove them. The configuration writes one every 4 steps.
#[test]
fn a_run_whose_checkpoints_are_gone_is_not_restarted() {
    let folder = tempdir().unwrap();
    let (whole, given) = (folder.path().join("whole"), folder.path().join("given"));
    run(&whole, &Start::Fresh, 6);
    let (checkpoints, weights) = (whole.join("checkpoints"), whole.join("weights.safetensors"));
    run(&given, &Start::Weights(TensorFile::open(&weights).unwrap()), 1);
    let refused = |run: &Path, found: &str| {
        let before = contents(run);
        let error = resume(run).unwrap_err().to_string();
        let expected =
            format!("output folder: {}: expected the run's checkpoints in `checkpoints`: put them back", run.display());
        assert!(error.starts_with(&expected) && error.ends_with(found), "{error}");
        assert_eq!(contents(run), before);
        error
    };
    std::fs::rename(&checkpoints, whole.join("elsewhere")).unwrap();
    let error = refused(&whole, "found none, but weights.safetensors");
    assert!(error.contains(&format!("`--init {}`", weights.display())), "{error}");
    std::fs::create_dir(&checkpoints).unwrap();
    refused(&whole, "found none, but weights.safetensors");
    std::fs::remove_dir(&checkpoints).unwrap();
    std::fs::rename(whole.join("elsewhere"), &checkpoints).unwrap();
    assert_eq!(resume(&whole).unwrap().state().step, 6);

    // Without weights, the log decides: a checkpoint follows its fourth step.
    std::fs::remove_dir_all(&checkpoints).unwrap();
    std::fs::remove_file(&weights).unwrap();
    refused(&whole, "found none, but steps.jsonl up to step 6");
    let log = std::fs::read_to_string(whole.join("steps.jsonl")).unwrap();
    std::fs::write(whole.join("steps.jsonl"), log.split_inclusive('\n').take(4).collect::<String>()).unwrap();
    let notices = run(&whole, &Start::Resume, 5);
    assert!(notices[0].starts_with("no checkpoint was written: the run restarts at step 0"), "{notices:?}");

    std::fs::remove_dir_all(given.join("checkpoints")).unwrap();
    std::fs::remove_file(given.join("weights.safetensors")).unwrap();
    refused(&given, "found none, but steps.jsonl up to step 1");
}

/// Earlier versions started such runs, with the default weight of the uncertainty loss.
#[test]
fn losses_that_a_new_run_must_not_have_are_those_of_a_run_that_is_resumed() {
    let folder = tempdir().unwrap();
    let run = folder.path().join("run");
    let mut config = config("");
    let selection = "selection = { kind = 'straight-through' }".parse::<toml::Table>().unwrap();
    config.model.changes.insert("expansion".to_owned(), selection.into());
    let open = |start: &Start| Trainer::with_samples(config.clone(), Box::new(Noise::CLEAN), &run, start);
    let problem = "training configuration: losses.uncertainty-weight: expected 0.0 with the selection straight-through, \
                   whose scores only the rendering loss trains, found 0.1";
    assert_eq!(open(&Start::Fresh).unwrap_err().to_string(), problem);
    assert!(!run.exists());
    std::fs::create_dir(&run).unwrap();
    std::fs::write(run.join("steps.jsonl"), "").unwrap();
    let mut notices = Vec::new();
    let mut on_event = |event: &Event<'_>| {
        if let Event::Notice(text) = event {
            notices.push((*text).to_owned());
        }
    };
    open(&Start::Resume).unwrap().run(Limits { steps: Some(1), time: None }, &mut on_event).unwrap();
    let expected = format!("the run goes on as it began, but a new one would be rejected: {problem}");
    assert!(notices.contains(&expected), "{notices:?}");
}

/// f16 rounds 65519 to 65504, and 65520 to infinity.
#[test]
fn a_diverged_run_names_the_step_and_keeps_its_checkpoints() {
    let folder = tempdir().unwrap();
    let files = || {
        let entries = std::fs::read_dir(folder.path().join("checkpoints")).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        (names, contents(folder.path()))
    };
    let mut diverged = trainer(config(""), folder.path(), &Start::Fresh, Noise::CLEAN);
    let place =
        diverged.state().parameters.list().iter().position(|parameter| parameter.name == "coarse.fuse.weight").unwrap();
    diverged.state_mut().parameters.values_mut()[place][3] = 65520.0;
    let error = diverged.write_checkpoint().unwrap_err().to_string();
    assert!(error.contains("by step 0: ") && error.ends_with("no checkpoint was written"), "{error}");
    (diverged.state_mut().step, diverged.state_mut().updates) = (4, 4);
    diverged.state_mut().parameters.values_mut()[place][3] = 65519.0;
    diverged.write_checkpoint().unwrap();
    let before = files();
    diverged.state_mut().step = 9;
    diverged.state_mut().parameters.values_mut()[place][3] = -70_000.0;
    let error = diverged.write_checkpoint().unwrap_err();
    assert!(matches!(error, TrainError::Diverged { step: 9, last_checkpoint: Some(4), .. }), "{error}");
    let text = error.to_string();
    for expected in [
        "training diverged by step 9: coarse.fuse.weight contains -70000, and weights are written as f16",
        "lower schedule.learning-rate or clip; checkpoints up to step 4 remain",
    ] {
        assert!(text.contains(expected), "{text}");
    }
    assert_eq!(files(), before);
}

/// Of two samples each, the latest eight of twelve steps are drawn again.
#[test]
fn a_resumed_run_compares_the_samples_of_its_latest_steps() {
    let folder = tempdir().unwrap();
    run(folder.path(), &Start::Fresh, 12);
    let log = folder.path().join("steps.jsonl");
    let recorded: Vec<StepRecord> = logs::read(&log).unwrap();
    let resume_with_another = |step: usize| {
        let mut records = recorded.clone();
        records[step].samples_sha256 = Some(Sha256Digest::of(b"other samples"));
        let lines = records.iter().map(|record| serde_json::to_string(record).unwrap() + "\n");
        std::fs::write(&log, lines.collect::<String>()).unwrap();
        resume(folder.path()).map(|trainer| trainer.state().step).map_err(|error| error.to_string())
    };
    for step in [0, 3] {
        assert_eq!(resume_with_another(step), Ok(12));
    }
    for step in [4, 11] {
        let error = resume_with_another(step).unwrap_err();
        let expected = format!("training data: samples of step {step}: expected those that steps.jsonl records");
        assert!(error.starts_with(&expected), "{error}");
    }
}

/// A log of an earlier version is another case: it has records, without hashes.
#[test]
fn a_log_that_is_gone_is_called_so() {
    let folder = tempdir().unwrap();
    run(folder.path(), &Start::Fresh, 4);
    let log = folder.path().join("steps.jsonl");
    let whole = std::fs::read(&log).unwrap();
    let unchecked = "whether the training data have changed was not checked";
    for (content, why) in [(None, "the file is gone"), (Some(""), "no records of the run so far")] {
        match content {
            None => std::fs::remove_file(&log).unwrap(),
            Some(text) => std::fs::write(&log, text).unwrap(),
        }
        let notices = run(folder.path(), &Start::Resume, 4);
        assert_eq!(notices[0], format!("steps.jsonl: {why}: {unchecked}"));
        assert_eq!(notices[1], "steps.jsonl: expected the 4 steps so far, found 0");
    }
    std::fs::write(&log, whole).unwrap();
    assert_eq!(run(folder.path(), &Start::Resume, 4), [""; 0]);
}

/// Which may have other kernels or decoders.
#[test]
fn another_build_is_reported_and_recorded() {
    let folder = tempdir().unwrap();
    run(folder.path(), &Start::Fresh, 4);
    let path = folder.path().join("checkpoints/step-00000004.safetensors");
    let mut stored = TensorFile::open(&path).unwrap().stored;
    let [_, current] = ["metadata-sha256", "builds"].map(|key| stored.metadata.remove(key).unwrap());
    assert_eq!(current, env!("CARGO_PKG_VERSION"));
    // The first as in checkpoints of earlier versions.
    for (recorded, other) in
        [(None, Some("not stated")), (Some("0.0.1 (a1b2)"), Some("0.0.1 (a1b2)")), (Some(&*current), None)]
    {
        stored.metadata.extend(recorded.map(|recorded| ("builds".to_owned(), recorded.to_owned())));
        stored.write(&path).unwrap();
        let notices = run(folder.path(), &Start::Resume, 4);
        let expected = other.map(|other| {
            format!("the checkpoint was computed by another build of this program, {other}, now {current}: ")
        });
        assert_eq!(notices.len(), usize::from(other.is_some()), "{notices:?}");
        assert!(notices.iter().zip(&expected).all(|(notice, expected)| notice.starts_with(expected)), "{notices:?}");
        let builds = other.map_or_else(|| current.clone(), |other| format!("{other}; {current}"));
        let weights = ModelWeights::read(&folder.path().join("weights.safetensors")).unwrap();
        assert_eq!(weights.provenance["builds"], builds);
    }
}
