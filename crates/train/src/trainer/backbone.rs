//! The weights of a frozen backbone: those of the file that the configuration names, and that given weights have the same.

use std::path::Path;

use atsplat_model::ModelConfig;
use atsplat_model::weights::{StoredTensor, StoredTensors, read_backbone};

use super::initial_weights::first_names;
use crate::config::WHAT;
use crate::{TrainConfig, TrainError};

/// The weights of a frozen backbone, from the file that the configuration names.
pub(crate) fn frozen(config: &TrainConfig, model: &ModelConfig) -> Result<StoredTensors, TrainError> {
    match &config.model.backbone {
        Some(path) => Ok(read_backbone(path, model, None)?.tensors),
        None if model.backbone.is_frozen() => {
            let expected =
                "the file of the frozen backbone's weights, or a run from weights that contain them (`--init`)";
            Err(TrainError::malformed(WHAT, "model.backbone", expected, "none"))
        }
        None => Ok(StoredTensors::default()),
    }
}

/// An error for given weights whose frozen tensors are not those of the backbone's file, exactly or rounded as weights files are.
pub(super) fn require_same(
    given: &StoredTensors,
    exact: &StoredTensors,
    weights: &Path,
    backbone: &Path,
) -> Result<(), TrainError> {
    let mut others = Vec::new();
    for (name, tensor) in &given.tensors {
        let is_same = exact.tensors.get(name).is_some_and(|exact| is_rounding_of(tensor, exact));
        if !is_same {
            others.push(name.as_str());
        }
    }
    if others.is_empty() {
        return Ok(());
    }
    let expected = format!("the frozen weights in {}, up to rounding", weights.display());
    let found = format!("others in {}: {}", backbone.display(), first_names(&others));
    Err(TrainError::malformed(WHAT, "model.backbone", expected, found))
}

/// Whether values are the exact ones, or these rounded to f16 or bf16.
fn is_rounding_of(values: &StoredTensor, exact: &StoredTensor) -> bool {
    let same = |rounded: &StoredTensor| {
        let [values, rounded] = [values, rounded].map(StoredTensor::to_f32);
        matches!((values, rounded), (Ok(values), Ok(rounded)) if values == rounded)
    };
    values.shape() == exact.shape() && (same(exact) || [exact.to_f16(), exact.to_bf16()].iter().flatten().any(same))
}
