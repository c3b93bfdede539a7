//! How weights that a run starts from differ from it: a difference is a notice, and kept in the run's provenance.
//!
//! Fine-tuning changes settings on purpose, so a difference is not an error; but weights mean something else to another network.

use std::path::Path;

use atsplat_files::changes;
use atsplat_model::ModelConfig;
use atsplat_model::parameters::parameters;
use atsplat_model::weights::ModelWeights;
use serde_json::{Value, json};

use super::weights::{beyond_f16, value_beyond_f16};
use crate::parameters::{Parameters, is_within};
use crate::provenance::{BACKGROUND, POSE_NORMALISATION, background};
use crate::{TrainConfig, TrainError};

/// Fields of a model's configuration that change no Gaussian ([`ModelConfig::hash`]).
const DESCRIPTIVE: [&str; 6] = ["name", "title", "notes", "inferred", "views", "resolution"];
/// Tensors that a message names; the others are counted.
const NAMED: usize = 4;

/// How the network and the training of given weights differ from those of a run, one sentence each: settings of the network, tensors that
/// are not read, other than those of `model.fresh`, the normalisation of poses and the background, if the file states them.
///
/// # Errors
/// [`TrainError::Malformed`] for a setting that JSON cannot represent.
pub(super) fn differences(
    config: &TrainConfig,
    model: &ModelConfig,
    weights: &ModelWeights,
) -> Result<Vec<String>, TrainError> {
    let mut found = Vec::new();
    let settings = other_settings(&weights.config, model)?;
    if !settings.is_empty() {
        found.push(format!("initial weights: their network has other settings: {settings}"));
    }
    let known = parameters(model);
    let is_used = |name: &str| {
        known.iter().any(|parameter| parameter.name == name)
            || config.model.fresh.iter().any(|part| is_within(name, part))
    };
    let given = &weights.tensors.tensors;
    let unused: Vec<&str> = given.keys().map(String::as_str).filter(|name| !is_used(name)).collect();
    if !unused.is_empty() {
        let (count, all, names) = (unused.len(), given.len(), first_names(&unused));
        found.push(format!("initial weights: {count} of their {all} tensors are in no part of this network: {names}"));
    }
    let stated = [
        (POSE_NORMALISATION, "with poses normalised by", config.pose_normalisation.name()),
        (BACKGROUND, "on the background", background(config)),
    ];
    for (key, how, current) in stated {
        if let Some(theirs) = weights.provenance.get(key).filter(|theirs| **theirs != current) {
            found.push(format!("initial weights: trained {how} {theirs}, now {current}"));
        }
    }
    Ok(found)
}

/// The first of these names, and how many more there are.
pub(super) fn first_names(names: &[&str]) -> String {
    let first = names.iter().take(NAMED).copied().collect::<Vec<_>>().join(", ");
    match names.len().saturating_sub(NAMED) {
        0 => first,
        more => format!("{first} and {more} more"),
    }
}

/// An error for initial weights that the run could not write itself.
pub(super) fn require_f16(parameters: &Parameters, file: &Path) -> Result<(), TrainError> {
    let mut beyond = beyond_f16(parameters);
    for (name, tensor) in &parameters.frozen().tensors {
        if beyond.is_none() {
            beyond = value_beyond_f16(&tensor.to_f32()?).map(|value| (name.clone(), value));
        }
    }
    match beyond {
        None => Ok(()),
        Some((tensor, value)) => {
            let expected = "values up to 65504, because a run's weights are written as f16";
            Err(TrainError::malformed("initial weights", tensor, expected, value).in_file(file))
        }
    }
}

/// The settings in which networks differ; up to four of each part, so that a part of which all is new hides no other.
fn other_settings(given: &ModelConfig, current: &ModelConfig) -> Result<String, TrainError> {
    let (given, current) = (settings(given)?, settings(current)?);
    let mut found = Vec::new();
    for (part, theirs) in given.as_object().into_iter().flatten() {
        let changed = changes(&json!({ part: theirs }), &json!({ part: current.get(part) })).map_err(not_json)?;
        found.extend(Some(changed).filter(|text| !text.is_empty()));
    }
    Ok(found.join("; "))
}

/// The fields of a configuration that make its network what it is, including those that are at their defaults and not written.
fn settings(model: &ModelConfig) -> Result<Value, TrainError> {
    let mut value = serde_json::to_value(model).map_err(not_json)?;
    if let Some(fields) = value.as_object_mut() {
        fields.retain(|name, _| !DESCRIPTIVE.contains(&name.as_str()));
    }
    if let Some(head) = value.pointer_mut("/head").and_then(Value::as_object_mut) {
        head.insert("frame".to_owned(), serde_json::to_value(model.head.frame).map_err(not_json)?);
    }
    let blocks = value.pointer_mut("/decoder/blocks").and_then(Value::as_array_mut).into_iter().flatten();
    for (block, configured) in blocks.zip(&model.decoder.blocks) {
        if let Some(fields) = block.as_object_mut() {
            fields.insert("expand".to_owned(), Value::Bool(configured.expand));
        }
    }
    Ok(value)
}

fn not_json(error: serde_json::Error) -> TrainError {
    TrainError::malformed("model configuration", "JSON", "a value that JSON can represent", error)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use atsplat_camera::PoseNormalisation;
    use atsplat_model::config::{AnchorContext, HeadFrame};
    use atsplat_model::weights::StoredTensors;

    use super::*;

    fn experiment(name: &str) -> (TrainConfig, ModelConfig) {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/experiments");
        let config = TrainConfig::read(&folder.join(format!("{name}.toml"))).unwrap();
        let model = config.model.config().unwrap();
        (config, model)
    }

    fn embedded(name: &str) -> ModelWeights {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/checkpoints");
        ModelWeights::read(&folder.join(format!("{name}.safetensors"))).unwrap()
    }

    fn differences_of(weights: &ModelWeights, (config, model): &(TrainConfig, ModelConfig)) -> Vec<String> {
        differences(config, model, weights).unwrap()
    }

    #[test]
    fn another_network_or_normalisation_is_noted() {
        let weights = embedded("micro-rooms");
        let (mut config, same) = experiment("micro-rooms");
        assert!(differences_of(&weights, &(config.clone(), same.clone())).is_empty(), "its name and title are others");

        let mut model = same.clone();
        model.head.frame = HeadFrame::World;
        let expected = ["initial weights: their network has other settings: head.frame: patch, now world"];
        assert_eq!(differences_of(&weights, &(config.clone(), model)), expected);
        let mut model = same.clone();
        model.decoder.blocks[3].expand = false;
        let expected = "initial weights: their network has other settings: decoder.blocks[3].expand: true, now false";
        assert_eq!(differences_of(&weights, &(config.clone(), model)), [expected]);

        let mut model = same;
        model.anchors.context = AnchorContext::None {};
        config.pose_normalisation = PoseNormalisation::FirstViewRelative;
        let found = differences_of(&weights, &(config.clone(), model.clone()));
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(found[0].contains("anchors.context.kind: point-net, now none"), "{}", found[0]);
        let unused = weights.tensors.tensors.keys().filter(|name| name.starts_with("anchors.context.")).count();
        let all = weights.tensors.tensors.len();
        let start =
            format!("initial weights: {unused} of their {all} tensors are in no part of this network: anchors.");
        assert!(unused > 0 && found[1].starts_with(&start), "{}", found[1]);
        let expected = format!(
            "initial weights: trained with poses normalised by mean-camera (long-lrm), now {}",
            config.pose_normalisation.name()
        );
        assert_eq!(found[2], expected);

        // Of parts that are new on purpose, nothing is missed.
        config.model.fresh = vec!["anchors".to_owned()];
        assert!(
            !differences_of(&weights, &(config.clone(), model.clone())).iter().any(|text| text.contains("tensors"))
        );
        let unstated = ModelWeights { provenance: BTreeMap::new(), ..weights };
        assert!(!differences_of(&unstated, &(config, model)).iter().any(|text| text.contains("poses")));
    }

    #[test]
    fn another_background_is_noted() {
        let provenance = BTreeMap::from([(BACKGROUND.to_owned(), "[0.0, 0.0, 0.0]".to_owned())]);
        let weights = ModelWeights { provenance, ..embedded("micro-rooms") };
        let (mut config, model) = experiment("micro-rooms");
        assert!(differences_of(&weights, &(config.clone(), model.clone())).is_empty());
        config.losses.background = [0.0, 0.5, 1.0];
        let expected = "initial weights: trained on the background [0.0, 0.0, 0.0], now [0.0, 0.5, 1.0]";
        assert_eq!(differences_of(&weights, &(config, model)), [expected]);
    }

    /// Rows of claims have new heads and expansions, and the paper goes from one dataset and size to the next.
    #[test]
    fn committed_experiments_say_what_they_change_and_no_more() {
        let rooms = embedded("micro-rooms");
        let quiet = ["micro-rooms", "micro-yards", "claims/full", "claims/unified", "claims/separate-yards-6v"];
        for name in quiet {
            assert!(differences_of(&rooms, &experiment(name)).is_empty(), "{name}");
        }
        let changed = "initial weights: their network has other settings: ";
        let learnable = differences_of(&rooms, &experiment("claims/anchor-learnable"));
        assert!(learnable[0].ends_with("; head.frame: patch, now world"), "{}", learnable[0]);
        let k_4 = differences_of(&rooms, &experiment("claims/k-4"));
        assert_eq!(k_4, [format!("{changed}head.gaussians-per-token: 16, now 4")]);
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/experiments/claims");
        let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        for entry in files.filter(|path| path.extension().is_some_and(|extension| extension == "toml")) {
            let name = format!("claims/{}", entry.file_stem().unwrap().to_str().unwrap());
            let found = differences_of(&rooms, &experiment(&name));
            assert!(found.len() <= 2 && found.iter().all(|text| text.len() < 300), "{name}: {found:?}");
        }

        // Settings alone: weights of this size are not made in a test.
        let without_tensors = |name: &str| {
            let (config, tensors) = (experiment(name).1, StoredTensors::default());
            ModelWeights { config, provenance: BTreeMap::new(), tensors, sha256: None, metadata_covered: true }
        };
        let (re10k, dl3dv) = (without_tensors("paper/re10k"), without_tensors("paper/dl3dv-6v"));
        for name in ["paper/dl3dv-6v", "paper/dl3dv-4v", "paper/dl3dv-2v", "paper/dl3dv-224"] {
            assert!(differences_of(&re10k, &experiment(name)).is_empty(), "{name}: only views and size are others");
        }
        let larger = differences_of(&dl3dv, &experiment("paper/dl3dv-hr"));
        let expected =
            format!("{changed}coarse.image-downscale: 1, now 2; decoder.blocks[1].expansion.ratio: 0.5, now 0.8");
        assert_eq!(larger, [expected]);
    }

    #[test]
    fn names_beyond_the_fourth_are_counted() {
        assert_eq!(first_names(&["a", "b", "c", "d"]), "a, b, c, d");
        assert_eq!(first_names(&["a", "b", "c", "d", "e", "f"]), "a, b, c, d and 2 more");
    }
}
