//! Whole runs: identical bits however they are interrupted, and never a silent NaN.

use std::collections::BTreeMap;
use std::path::Path;

use crate::common::{Noise, bits, config, trainer};
use atsplat_model::ModelConfig;
use atsplat_model::weights::{ModelWeights, Precision, TensorFile};
use atsplat_numeric::{Extremes as _, Tolerance};
use atsplat_tests::on_threads;
use atsplat_train::logs::{self, EvaluationRecord, StepRecord};
use atsplat_train::{Event, Limits, Start, TrainConfig, TrainError, Trainer};
use tempfile::tempdir;

fn run(trainer: &mut Trainer, steps: Option<u64>) -> Result<bool, TrainError> {
    trainer.run(Limits { steps, time: None }, &mut |_| ())
}

fn whole(config: &TrainConfig, source: Noise) -> Vec<Vec<u32>> {
    let folder = tempdir().unwrap();
    let mut trainer = trainer(config.clone(), folder.path(), &Start::Fresh, source);
    assert!(run(&mut trainer, None).unwrap());
    bits(&trainer)
}

fn steps(folder: &Path) -> Vec<StepRecord> {
    logs::read(&folder.join("steps.jsonl")).unwrap()
}

/// What a run reports until a step.
fn notices(trainer: &mut Trainer, steps: u64) -> Vec<String> {
    let mut notices = Vec::new();
    let mut on_event = |event: &Event<'_>| {
        if let Event::Notice(text) = event {
            notices.push((*text).to_owned());
        }
    };
    trainer.run(Limits { steps: Some(steps), time: None }, &mut on_event).unwrap();
    notices
}

fn position(trainer: &Trainer, parameter: &str) -> usize {
    trainer.state().parameters.list().iter().position(|known| known.name == parameter).unwrap()
}

#[test]
fn resuming_gives_identical_weights() {
    let (config, folder) = (config(""), tempdir().unwrap());
    let expected = whole(&config, Noise::CLEAN);
    for (stop, start) in [(3, Start::Fresh), (4, Start::Resume), (9, Start::Resume), (12, Start::Resume)] {
        let mut trainer = trainer(config.clone(), folder.path(), &start, Noise::CLEAN);
        assert_eq!(run(&mut trainer, Some(stop)).unwrap(), stop == 12);
        if stop == 12 {
            assert_eq!(bits(&trainer), expected);
        }
    }
    assert_eq!(steps(folder.path()).iter().map(|record| record.step).collect::<Vec<_>>(), (0..12).collect::<Vec<_>>());
    assert_eq!(std::fs::read_dir(folder.path().join("checkpoints")).unwrap().count(), 2, "the last two are kept");
}

#[test]
fn a_run_is_identical_on_any_number_of_threads() {
    let config = config("");
    let on = |threads| on_threads(threads, || whole(&config, Noise::CLEAN));
    let one = on(1);
    for threads in [2, 3] {
        assert!(on(threads) == one, "{threads} threads");
    }
}

#[test]
fn another_seed_gives_other_weights() {
    let config = config("");
    let other = TrainConfig { seed: config.seed + 1, ..config.clone() };
    assert!(whole(&config, Noise::CLEAN) != whole(&other, Noise::CLEAN));
}

#[test]
fn training_lowers_the_loss() {
    let config = config("distinct = 2");
    let folder = tempdir().unwrap();
    let mut trainer =
        trainer(TrainConfig { steps: 60.try_into().unwrap(), ..config }, folder.path(), &Start::Fresh, Noise::CLEAN);
    run(&mut trainer, None).unwrap();
    let totals: Vec<f64> = steps(folder.path()).iter().map(|record| record.terms.unwrap().total).collect();
    assert!(totals[59] < 0.9 * totals[0], "{} to {}", totals[0], totals[59]);
}

#[test]
fn a_broken_sample_is_skipped_and_counted() {
    let broken = Noise {
        corrupt: |number, sample| {
            if number == 5 {
                sample.targets.images[9] = f32::NAN;
            }
        },
    };
    let folder = tempdir().unwrap();
    let mut trainer = trainer(config(""), folder.path(), &Start::Fresh, broken);
    assert!(run(&mut trainer, None).unwrap());
    assert_eq!((trainer.state().skipped(), trainer.state().updates), (1, 11));
    assert!(trainer.state().parameters.non_finite().is_empty());
    let records = steps(folder.path());
    let reason = records[2].skip_reason.as_ref().unwrap();
    assert!(reason.contains("target image 0") && reason.contains("noise 5") && reason.contains("step 2"), "{reason}");
    assert!(records[2].terms.is_none() && records[3].terms.is_some());
}

#[test]
fn faults_in_a_row_stop_the_run_with_a_diagnosis() {
    let broken = Noise {
        corrupt: |number, sample| {
            if number >= 6 {
                sample.context.images[0] = f32::INFINITY;
            }
        },
    };
    assert_eq!(config("").most_faults.get(), 5, "by default");
    let folder = tempdir().unwrap();
    let mut stopped = trainer(config("most-faults = 3"), folder.path(), &Start::Fresh, broken);
    let error = run(&mut stopped, None).unwrap_err();
    let TrainError::Stopped(diagnosis) = &error else { panic!("{error}") };
    assert_eq!(diagnosis.skipped.iter().map(|skipped| skipped.step).collect::<Vec<_>>(), [3, 4, 5]);
    assert_eq!(diagnosis.in_a_row, 3);
    assert!(diagnosis.parameters.is_empty());
    let text = error.to_string();
    assert!(text.contains("context image 0") && text.contains("all weights are finite"), "{text}");
    assert!(text.contains("3 steps in a row could not be used\n"), "{text}");
    drop(stopped);
    // The checkpoint before the skipped steps is kept.
    let resumed = trainer(config("most-faults = 3"), folder.path(), &Start::Resume, Noise::CLEAN);
    assert_eq!(resumed.state().step, 4);
    drop(resumed);
    // It counts one of them, which is not described again.
    let mut again = trainer(config("most-faults = 3"), folder.path(), &Start::Resume, broken);
    let error = run(&mut again, None).unwrap_err();
    let TrainError::Stopped(diagnosis) = &error else { panic!("{error}") };
    assert_eq!((diagnosis.in_a_row, diagnosis.skipped.len()), (3, 2));
    let text = error.to_string();
    assert!(text.contains("3 steps in a row could not be used, 1 of them before the run was resumed"), "{text}");
}

#[test]
fn a_weight_that_is_not_finite_is_named_and_never_written() {
    let folder = tempdir().unwrap();
    let mut broken = trainer(config("most-faults = 2"), folder.path(), &Start::Fresh, Noise::CLEAN);
    run(&mut broken, Some(4)).unwrap();
    let place = position(&broken, "coarse.fuse.weight");
    broken.state_mut().parameters.values_mut()[place][7] = f32::NAN;
    let text = run(&mut broken, None).unwrap_err().to_string();
    assert!(text.contains("coarse.fuse.weight contains 1 value"), "{text}");
    let text = broken.write_checkpoint().unwrap_err().to_string();
    assert!(text.contains("coarse.fuse.weight") && text.contains("finite weights"), "{text}");
    drop(broken);
    let resumed = trainer(config("most-faults = 2"), folder.path(), &Start::Resume, Noise::CLEAN);
    assert_eq!(resumed.state().step, 4);
    assert!(resumed.state().parameters.non_finite().is_empty());
}

/// All Gaussians of a token have the same place and shape: gradients are finite and separate them.
#[test]
fn collapsed_gaussians_are_trained_apart() {
    let folder = tempdir().unwrap();
    let mut trainer = trainer(config(""), folder.path(), &Start::Fresh, Noise::CLEAN);
    let place = position(&trainer, "head.mlp.fc2.weight");
    let rows = &mut trainer.state_mut().parameters.values_mut()[place];
    let one = rows[..rows.len() / 16].to_vec();
    rows.copy_from_slice(&one.repeat(16));
    assert!(run(&mut trainer, None).unwrap());
    assert_eq!(trainer.state().skipped(), 0);
    assert!(trainer.state().parameters.values()[place] != one.repeat(16));
}

/// An all-zero head gives Gaussians with zero quaternions, which are not drawn: no error, no NaN.
#[test]
fn zero_quaternions_do_not_stop_a_run() {
    let folder = tempdir().unwrap();
    let mut trainer = trainer(config(""), folder.path(), &Start::Fresh, Noise::CLEAN);
    let place = position(&trainer, "head.mlp.fc2.weight");
    trainer.state_mut().parameters.values_mut()[place].fill(0.0);
    assert!(run(&mut trainer, None).unwrap());
    assert_eq!(trainer.state().skipped(), 0);
    assert!(trainer.state().parameters.non_finite().is_empty());
}

#[test]
fn a_damaged_checkpoint_falls_back_to_the_previous_one() {
    let (config, folder) = (config(""), tempdir().unwrap());
    run(&mut trainer(config.clone(), folder.path(), &Start::Fresh, Noise::CLEAN), Some(8)).unwrap();
    let newest = folder.path().join("checkpoints/step-00000008.safetensors");
    let mut bytes = std::fs::read(&newest).unwrap();
    let last = bytes.len() - 5;
    bytes[last] ^= 1;
    std::fs::write(&newest, bytes).unwrap();
    let mut resumed = trainer(config.clone(), folder.path(), &Start::Resume, Noise::CLEAN);
    assert_eq!(resumed.state().step, 4);
    run(&mut resumed, None).unwrap();
    assert_eq!(bits(&resumed), whole(&config, Noise::CLEAN));
}

#[test]
fn a_run_is_not_overwritten_or_mixed_with_another() {
    let (tiny, folder) = (config(""), tempdir().unwrap());
    run(&mut trainer(tiny.clone(), folder.path(), &Start::Fresh, Noise::CLEAN), Some(4)).unwrap();
    let open = |config: &TrainConfig, start: &Start| {
        Trainer::with_samples(config.clone(), Box::new(Noise::CLEAN), folder.path(), start).map(drop)
    };
    // Whatever the configuration is, and before it is compared with that of the run.
    let other = TrainConfig { clip: 2.0, ..tiny.clone() };
    let given = Start::Weights(TensorFile::open(&folder.path().join("weights.safetensors")).unwrap());
    for (config, start) in [(&tiny, &Start::Fresh), (&other, &Start::Fresh), (&other, &given)] {
        let error = open(config, start).unwrap_err().to_string();
        let place = format!("output folder: {}: ", folder.path().display());
        let expected = "expected no run; choose another folder, or `--resume`, found one with checkpoints";
        assert_eq!(error, format!("{place}{expected}"));
    }
    let error = open(&other, &Start::Resume).unwrap_err().to_string();
    assert!(error.contains("step-00000004.safetensors, field configuration: "), "{error}");
    assert!(error.ends_with("other settings: clip: 1.0, now 2.0"), "{error}");
    // Of which another hash of the model follows.
    let mut other = tiny.clone();
    other.model.base = "micro".to_owned();
    let error = open(&other, &Start::Resume).unwrap_err().to_string();
    assert!(error.ends_with("other settings: model.base: nano, now micro"), "{error}");
    open(&tiny, &Start::Resume).unwrap();
    // Checkpoints are large, and may be removed after a run.
    std::fs::remove_dir_all(folder.path().join("checkpoints")).unwrap();
    std::fs::write(folder.path().join("evaluations.jsonl"), "{}\n").unwrap();
    for left in ["steps.jsonl", "evaluations.jsonl", "weights.safetensors"] {
        let error = open(&tiny, &Start::Fresh).unwrap_err().to_string();
        assert!(error.ends_with(&format!("expected no run, found {left} of a run without checkpoints")), "{error}");
        std::fs::remove_file(folder.path().join(left)).unwrap();
    }
    open(&tiny, &Start::Fresh).unwrap();
}

/// Steps of one would follow those of the other in the logs.
#[test]
fn one_process_at_a_time_trains_in_a_folder() {
    let (config, folder) = (config(""), tempdir().unwrap());
    let run = folder.path().join("run");
    let open = |start: &Start| Trainer::with_samples(config.clone(), Box::new(Noise::CLEAN), &run, start);
    let first = open(&Start::Fresh).unwrap();
    for start in [Start::Fresh, Start::Resume] {
        let error = open(&start).unwrap_err();
        assert!(matches!(error, TrainError::InUse { .. }), "{error}");
        let holder = format!("run is being written by process {} on ", std::process::id());
        assert!(error.to_string().contains(&holder), "{error}");
    }
    drop(first);
    // As a killed process leaves it.
    std::fs::write(run.join("run.json"), r#"{"pid":1,"host":"elsewhere","since":0}"#).unwrap();
    open(&Start::Resume).unwrap();
}

/// Products of matrices have other bits there.
#[test]
fn another_type_of_processor_is_reported() {
    let folder = tempdir().unwrap();
    run(&mut trainer(config(""), folder.path(), &Start::Fresh, Noise::CLEAN), Some(4)).unwrap();
    let path = folder.path().join("checkpoints/step-00000004.safetensors");
    let mut stored = TensorFile::open(&path).unwrap().stored;
    // As in earlier versions, which state neither.
    let [_, current] = ["metadata-sha256", "processor"].map(|key| stored.metadata.remove(key).unwrap());
    for recorded in [None, Some(current.clone()), Some("an older one".to_owned())] {
        stored.metadata.extend(recorded.clone().map(|recorded| ("processor".to_owned(), recorded)));
        stored.write(&path).unwrap();
        let noticed = notices(&mut trainer(config(""), folder.path(), &Start::Resume, Noise::CLEAN), 4);
        let expected = format!("another type of processor, an older one, now {current}: ");
        let found = noticed.iter().any(|notice| notice.contains(&expected));
        assert_eq!(found, recorded.is_some_and(|recorded| recorded != current), "{noticed:?}");
    }
}

/// The configuration names the model by the same path.
#[test]
fn a_run_does_not_resume_with_another_model_in_the_same_file() {
    let (mut config, folder) = (config(""), tempdir().unwrap());
    let (model, run) = (folder.path().join("model.toml"), folder.path().join("run"));
    let text = ModelConfig::text_of("nano").unwrap();
    std::fs::write(&model, text).unwrap();
    config.model.base = model.to_string_lossy().into_owned();
    trainer(config.clone(), &run, &Start::Fresh, Noise::CLEAN).write_checkpoint().unwrap();
    let resumed = || Trainer::with_samples(config.clone(), Box::new(Noise::CLEAN), &run, &Start::Resume).map(drop);
    std::fs::write(&model, text.replace("title = \"", "title = \"Renamed: ")).unwrap();
    resumed().unwrap();
    // With parameters of the same shapes.
    let changed = text.replace("neighbours = 16", "neighbours = 8");
    assert_ne!(changed, text);
    std::fs::write(&model, changed).unwrap();
    let error = resumed().unwrap_err().to_string();
    assert!(error.contains("model-sha256") && error.contains("or a new run from its weights"), "{error}");
}

#[test]
fn a_run_can_start_from_the_weights_of_another() {
    let (config, folder, second) = (config(""), tempdir().unwrap(), tempdir().unwrap());
    let mut first = trainer(config.clone(), folder.path(), &Start::Fresh, Noise::CLEAN);
    run(&mut first, None).unwrap();
    let weights = folder.path().join("weights.safetensors");
    let start = Start::Weights(TensorFile::open(&weights).unwrap());
    let mut smaller = config.clone();
    let head = smaller.model.changes["head"].as_table_mut().unwrap();
    head.insert("gaussians-per-token".to_owned(), toml::Value::Integer(8));
    let refused = Trainer::with_samples(smaller, Box::new(Noise::CLEAN), second.path(), &start);
    let error = refused.unwrap_err().to_string();
    let place = format!("{}, field head.mlp.fc2.weight: ", weights.display());
    assert!(error.contains(&place), "{error}");
    assert!(error.ends_with("expected a tensor of shape [112, 32], found float16 [224, 32]"), "{error}");
    let second = trainer(config, second.path(), &start, Noise::CLEAN);
    let far =
        first.state().parameters.values().iter().flatten().zip(second.state().parameters.values().iter().flatten());
    assert!(far.map(|(a, b)| (a - b).abs()).fold(0.0, f32::maximum_of) < 1e-3, "f16 weights");
    assert_eq!(second.state().step, 0);
}

/// Both runs begin with the same weights and samples; rounding products moves the loss, but hardly.
#[test]
fn products_in_bfloat16_change_a_step_a_little() {
    let first = |more: &str| {
        let folder = tempdir().unwrap();
        run(&mut trainer(config(more), folder.path(), &Start::Fresh, Noise::CLEAN), Some(1)).unwrap();
        let step = steps(folder.path()).swap_remove(0);
        (step.terms.unwrap().total, step.gradient_norm.unwrap())
    };
    let (exact, rounded) = (first(""), first("matmul-precision = \"bf16\""));
    for (exact, rounded) in [(exact.0, rounded.0), (exact.1, rounded.1)] {
        let moved = ((rounded - exact) / exact).abs();
        assert!(moved > 1e-7 && moved < 0.03, "{exact} became {rounded}");
    }
}

#[test]
fn logs_are_converted_to_parquet() {
    use polars::prelude::*;
    let folder = tempdir().unwrap();
    let broken = Noise {
        corrupt: |number, sample| {
            if number == 4 {
                sample.targets.images[9] = f32::NAN;
            }
        },
    };
    run(&mut trainer(config(""), folder.path(), &Start::Fresh, broken), Some(4)).unwrap();
    let path = folder.path().join("steps.parquet");
    logs::write_steps(&path, &steps(folder.path())).unwrap();
    let frame = ParquetReader::new(std::fs::File::open(&path).unwrap()).finish().unwrap();
    assert_eq!(frame.height(), 4);
    let totals: Vec<Option<f64>> = frame.column("total").unwrap().f64().unwrap().iter().collect();
    assert!(totals[0].is_some() && totals[2].is_none());
    let none: Vec<EvaluationRecord> = logs::read(&folder.path().join("nothing.jsonl")).unwrap();
    let evaluation = EvaluationRecord {
        step: 7,
        psnr: 21.0,
        ssim: 0.75,
        nearest_view_psnr: 16.5,
        nearest_view_ssim: 0.5,
        targets: 3,
        identical: 1,
        secs: 2.0,
        samples_sha256: None,
    };
    for (records, expected) in [(none, vec![]), (vec![evaluation], vec![21.0, 0.75, 16.5, 0.5, 2.0])] {
        logs::write_evaluations(&path, &records).unwrap();
        let frame = ParquetReader::new(std::fs::File::open(&path).unwrap()).finish().unwrap();
        let columns = ["psnr", "ssim", "nearest-view-psnr", "nearest-view-ssim", "secs"];
        let values = columns.iter().flat_map(|name| frame.column(name).unwrap().f64().unwrap().into_no_null_iter());
        Tolerance::EXACT.assert(values, expected, "evaluations");
    }
}

/// An incomplete line is dropped with everything after the checkpoint.
#[test]
fn an_incomplete_line_is_dropped() {
    let folder = tempdir().unwrap();
    run(&mut trainer(config(""), folder.path(), &Start::Fresh, Noise::CLEAN), Some(5)).unwrap();
    let path = folder.path().join("steps.jsonl");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, &text[..text.len() - 20]).unwrap();
    assert_eq!(steps(folder.path()).len(), 4);
    let mut resumed = trainer(config(""), folder.path(), &Start::Resume, Noise::CLEAN);
    run(&mut resumed, None).unwrap();
    assert_eq!(steps(folder.path()).last().unwrap().step, 11);
}

/// A crash of the system can lose lines of a log that a checkpoint followed.
#[test]
fn steps_that_the_log_lost_are_reported() {
    let folder = tempdir().unwrap();
    run(&mut trainer(config(""), folder.path(), &Start::Fresh, Noise::CLEAN), Some(4)).unwrap();
    let path = folder.path().join("steps.jsonl");
    let text = std::fs::read_to_string(&path).unwrap();
    for (kept, expected) in [(4, None), (1, Some("steps.jsonl: expected the 4 steps so far, found 1"))] {
        std::fs::write(&path, text.split_inclusive('\n').take(kept).collect::<String>()).unwrap();
        let notices = notices(&mut trainer(config(""), folder.path(), &Start::Resume, Noise::CLEAN), 4);
        assert_eq!(notices.first().map(String::as_str), expected);
    }
}

/// The average equals its recurrence over the weights of every step.
#[test]
fn averaged_weights_follow_the_recurrence_and_resume_identically() {
    let config = config("average = 0.5");
    let folder = tempdir().unwrap();
    let mut uninterrupted = trainer(config.clone(), folder.path(), &Start::Fresh, Noise::CLEAN);
    let mut mean: Vec<f64> = uninterrupted.state().parameters.values().concat().into_iter().map(f64::from).collect();
    for step in 0..12 {
        uninterrupted.step(&mut |_| ()).unwrap();
        let kept = ((1.0 + f64::from(step)) / (10.0 + f64::from(step))).minimum_of(0.5);
        let values = uninterrupted.state().parameters.values().concat();
        mean.iter_mut().zip(values).for_each(|(mean, value)| *mean = kept * *mean + (1.0 - kept) * f64::from(value));
    }
    let average = uninterrupted.state().result().values().concat();
    let close = Tolerance { absolute: 1e-6, relative: 1e-5 };
    close.assert(average.iter().copied().map(f64::from), mean, "average");
    assert!(uninterrupted.state().parameters.values().concat() != average);

    let folder = tempdir().unwrap();
    for (stop, start) in [(5, Start::Fresh), (12, Start::Resume)] {
        let mut resumed = trainer(config.clone(), folder.path(), &start, Noise::CLEAN);
        run(&mut resumed, Some(stop)).unwrap();
        if stop == 12 {
            assert!(resumed.state().result().values().concat() == average);
        }
    }
    let kept = ModelWeights::read(&folder.path().join("weights.safetensors")).unwrap();
    let kept = kept.tensors.tensors["head.mlp.fc2.weight"].to_f32().unwrap();
    let state = uninterrupted.state();
    let at = position(&uninterrupted, "head.mlp.fc2.weight");
    let halves = Tolerance { absolute: 1e-6, relative: 1e-3 };
    halves.assert(kept.into_iter().map(f64::from), state.result().values()[at].iter().copied().map(f64::from), "f16");
}

#[test]
fn provenance_keeps_hash_and_data_of_the_initial_weights() {
    let first = tempdir().unwrap();
    run(&mut trainer(config(""), first.path(), &Start::Fresh, Noise::CLEAN), None).unwrap();
    let path = first.path().join("weights.safetensors");
    let initial = ModelWeights::read(&path).unwrap();
    assert!(!initial.provenance.contains_key("initial-weights-sha256"));
    assert_eq!(initial.provenance["data"], "noise");
    let silent = first.path().join("silent.safetensors");
    let unstated = ModelWeights { provenance: BTreeMap::new(), ..initial.clone() };
    unstated.write(&silent, Precision::Single).unwrap();
    let of_silent = ModelWeights::read(&silent).unwrap().sha256;
    let stated = [("data", Some("noise; before: noise")), ("data-of-this-run", None), ("data-before", None)];
    // Without `data`, nothing is concluded about what the network never saw.
    let not_stated = [("data", None), ("data-of-this-run", Some("noise")), ("data-before", Some("not stated"))];
    for (path, sha256, expected) in [(path, initial.sha256, stated), (silent, of_silent, not_stated)] {
        let folder = tempdir().unwrap();
        for start in [Start::Weights(TensorFile::open(&path).unwrap()), Start::Resume] {
            let mut trainer = trainer(config(""), folder.path(), &start, Noise::CLEAN);
            let steps = trainer.state().step + 3;
            run(&mut trainer, Some(steps)).unwrap();
            let made = ModelWeights::read(&folder.path().join("weights.safetensors")).unwrap().provenance;
            assert_eq!(made.get("initial-weights-sha256"), sha256.as_ref());
            for (key, value) in expected {
                assert_eq!(made.get(key).map(String::as_str), value, "{key}");
            }
        }
    }
}

/// A run that is killed before its first step is done has a checkpoint of the weights that it was given.
#[test]
fn given_weights_outlive_a_kill_before_the_first_checkpoint() {
    let (first, folder) = (tempdir().unwrap(), tempdir().unwrap());
    run(&mut trainer(config(""), first.path(), &Start::Fresh, Noise::CLEAN), None).unwrap();
    let path = first.path().join("weights.safetensors");
    let mut killed =
        trainer(config(""), folder.path(), &Start::Weights(TensorFile::open(&path).unwrap()), Noise::CLEAN);
    let given = (bits(&killed), killed.state().initial_weights.clone());
    assert!(given.1.is_some());
    killed.step(&mut |_| ()).unwrap();
    drop(killed);
    std::fs::remove_file(path).unwrap();
    let resumed = trainer(config(""), folder.path(), &Start::Resume, Noise::CLEAN);
    assert_eq!(resumed.state().step, 0);
    assert!((bits(&resumed), resumed.state().initial_weights.clone()) == given);
}

#[test]
fn rejects_rooms_of_another_scale_than_the_models() {
    let text = config("").to_toml().unwrap().replace("resolution = [32, 32]", "resolution = [64, 64]");
    let folder = tempdir().unwrap();
    let error =
        Trainer::new(TrainConfig::from_toml(&text).unwrap(), folder.path(), &Start::Fresh).unwrap_err().to_string();
    assert!(error.contains("data[0].source.rooms.size") && error.contains("64x64, found 32x32"), "{error}");
}
