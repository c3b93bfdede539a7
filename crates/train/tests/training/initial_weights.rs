//! Weights that a run starts from may be of another network, but not in silence.

use std::collections::BTreeMap;
use std::path::Path;

use atsplat_model::weights::{ModelWeights, Precision, StoredTensor, TensorFile};
use atsplat_train::{Event, Limits, Start, TrainConfig, Trainer};
use tempfile::tempdir;

use crate::common::{Noise, config, trainer};

/// What a run up to a step reports, and the provenance of its weights.
fn run(config: &TrainConfig, folder: &Path, start: &Start, steps: u64) -> (Vec<String>, BTreeMap<String, String>) {
    let mut notices = Vec::new();
    let mut on_event = |event: &Event<'_>| {
        if let Event::Notice(text) = event {
            notices.push((*text).to_owned());
        }
    };
    let mut trainer = trainer(config.clone(), folder, start, Noise::CLEAN);
    trainer.run(Limits { steps: Some(steps), time: None }, &mut on_event).unwrap();
    (notices, ModelWeights::read(&folder.join("weights.safetensors")).unwrap().provenance)
}

/// Of the same shapes, without some of its tensors, and with other poses.
#[test]
fn weights_of_another_network_are_noted_and_recorded() {
    const KEY: &str = "initial-weights-differences";
    let folder = tempdir().unwrap();
    let [first, same, other] = ["first", "same", "other"].map(|name| folder.path().join(name));
    run(&config(""), &first, &Start::Fresh, 1);
    let start = Start::Weights(TensorFile::open(&first.join("weights.safetensors")).unwrap());
    let (notices, provenance) = run(&config(""), &same, &start, 1);
    assert_eq!(notices, [""; 0]);
    assert!(provenance.contains_key("initial-weights-sha256") && !provenance.contains_key(KEY));

    let mut changed = config("pose-normalisation = { rule = \"first-view-relative\" }");
    changed.model.changes.insert("anchors".to_owned(), toml::toml! { context = { kind = "none" } }.into());
    let (notices, provenance) = run(&changed, &other, &start, 1);
    let expected = ["has other settings: anchors.context.kind: point-net, now none", "tensors are in no part", "poses"];
    assert_eq!(notices.len(), expected.len(), "{notices:?}");
    for (notice, expected) in notices.iter().zip(expected) {
        assert!(notice.starts_with("initial weights: ") && notice.contains(expected), "{notice}");
    }
    assert_eq!(provenance[KEY], notices.join("; "));
    let (again, provenance) = run(&changed, &other, &Start::Resume, 2);
    assert_eq!((again, &provenance[KEY]), (Vec::new(), &notices.join("; ")), "noted once, and recorded for good");
}

/// A title may say so, but it is nothing that a run would notice.
#[test]
fn a_run_that_goes_on_from_weights_does_not_start_without_them() {
    let folder = tempdir().unwrap();
    let [first, second] = ["first", "second"].map(|name| folder.path().join(name));
    run(&config(""), &first, &Start::Fresh, 1);
    let weights = Start::Weights(TensorFile::open(&first.join("weights.safetensors")).unwrap());
    for (field, init, fresh) in [("model.init", true, Vec::new()), ("model.fresh", false, vec!["head".to_owned()])] {
        let mut config = config("");
        (config.model.init, config.model.fresh) = (init, fresh);
        let opened = |start: &Start| {
            let opened = Trainer::with_samples(config.clone(), Box::new(Noise::CLEAN), &second, start);
            opened.map(drop).map_err(|error| error.to_string())
        };
        let expected = format!("{field}: expected a run that starts from given weights (`--init`), found none");
        let refused = opened(&Start::Fresh).unwrap_err();
        assert!(refused.ends_with(&expected) && !second.exists(), "{refused}");
        opened(&weights).unwrap();
        opened(&Start::Resume).unwrap();
        std::fs::remove_dir_all(second.join("checkpoints")).unwrap();
        let refused = opened(&Start::Resume).unwrap_err();
        assert!(refused.ends_with(&expected), "without its checkpoint: {refused}");
        std::fs::remove_dir_all(&second).unwrap();
    }
}

/// As f16, 65519 is 65504 and 65520 infinite. The run could not write its weights.
#[test]
fn weights_beyond_f16_are_an_error_before_a_checkpoint() {
    const TENSOR: &str = "coarse.fuse.weight";
    let folder = tempdir().unwrap();
    let [first, second, path] = ["first", "second", "large.safetensors"].map(|name| folder.path().join(name));
    run(&config(""), &first, &Start::Fresh, 1);
    let mut weights = ModelWeights::read(&first.join("weights.safetensors")).unwrap();
    let given = weights.tensors.tensors[TENSOR].clone();
    let mut opened = |value: f32| {
        let mut values = given.to_f32().unwrap();
        values[3] = value;
        let tensor = StoredTensor::from_f32(given.shape().to_vec(), &values).unwrap();
        weights.tensors.tensors.insert(TENSOR.to_owned(), tensor);
        weights.write(&path, Precision::Single).unwrap();
        let start = Start::Weights(TensorFile::open(&path).unwrap());
        Trainer::with_samples(config(""), Box::new(Noise::CLEAN), &second, &start)
    };
    let error = opened(-65520.0).unwrap_err().to_string();
    let start = format!("initial weights: {}, field {TENSOR}: expected values up to 65504", path.display());
    assert!(error.starts_with(&start) && error.ends_with("found -65520"), "{error}");
    assert!(!second.exists());
    opened(65519.0).unwrap();
}
