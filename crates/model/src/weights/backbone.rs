use std::path::Path;

use super::{ImportReport, KeyMap, KnownFile, StoredTensors, TensorFile};
use crate::ModelError;
use crate::config::{BackboneConfig, DinoSize, ModelConfig};
use crate::parameters::{Parameter, parameters};

/// Maps of the two ways that DINOv2 is published.
const KEY_MAPS: [&str; 2] = ["dinov2-official", "dinov2-hugging-face"];

/// The frozen backbone of a configuration, read from a published file.
#[derive(Clone, Debug)]
pub struct BackboneWeights {
    /// Parameters whose names begin with `backbone.`.
    pub tensors: StoredTensors,
    /// What became of the file's tensors.
    pub report: ImportReport,
    /// sha256 of the file, to be recorded with every result.
    pub sha256: String,
    /// What the file is, if its hash is known.
    pub known: Option<&'static KnownFile>,
}

/// Reads the frozen backbone from the authors' file or from Hugging Face's, told apart by the names in it.
///
/// # Errors
/// [`ModelError::MissingWeights`] with where to get them, [`ModelError::InFile`] around
/// [`ModelError::Unfit`], or around [`ModelError::Malformed`] where the file's sha256 is not `expected_sha256`.
pub fn read_backbone(
    path: &Path,
    config: &ModelConfig,
    expected_sha256: Option<&str>,
) -> Result<BackboneWeights, ModelError> {
    let file = TensorFile::find(path, || KnownFile::advice(&config.backbone))?;
    file.check_sha256(expected_sha256)?;
    let expected = frozen(config);
    let mut best: Option<(StoredTensors, ImportReport)> = None;
    for map in KEY_MAPS {
        let outcome = KeyMap::resolve(map)?.apply(&file.stored, &expected);
        // Of two maps that fail, the one that knows more of the file's names has the better report.
        if best.as_ref().is_none_or(|(_, report)| report.missing.len() > outcome.1.missing.len()) {
            best = Some(outcome);
        }
    }
    match best {
        Some((tensors, report)) if report.is_complete() => {
            let known = KnownFile::with_sha256(&file.sha256);
            Ok(BackboneWeights { tensors, report, sha256: file.sha256, known })
        }
        best => {
            let report = best.map(|(_, report)| report).unwrap_or_default();
            Err(ModelError::Unfit(Box::new(report)).in_file(path))
        }
    }
}

impl BackboneConfig {
    /// Which DINOv2 a file holds whole, told by its names and shapes, and what became of the file's tensors; the largest
    /// where several fit.
    ///
    /// # Errors
    /// [`ModelError::Malformed`], never for a file.
    pub fn in_file(stored: &StoredTensors) -> Result<Option<(Self, ImportReport)>, ModelError> {
        let mut config = ModelConfig::named("paper-re10k")?;
        for map in KEY_MAPS {
            let map = KeyMap::resolve(map)?;
            for size in [DinoSize::Large, DinoSize::Base, DinoSize::Small, DinoSize::Tiny] {
                for registers in [true, false] {
                    config.backbone = Self::DinoV2 { size, registers };
                    let (_, report) = map.apply(stored, &frozen(&config));
                    if report.is_complete() {
                        return Ok(Some((config.backbone, report)));
                    }
                }
            }
        }
        Ok(None)
    }
}

fn frozen(config: &ModelConfig) -> Vec<Parameter> {
    parameters(config).into_iter().filter(|parameter| !parameter.trained).collect()
}
