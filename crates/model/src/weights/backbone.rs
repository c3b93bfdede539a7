use std::path::Path;

use atsplat_files::Sha256Digest;

use super::{ImportReport, KeyMap, KnownFile, StoredTensors, TensorFile};
use crate::ModelError;
use crate::config::{BackboneConfig, DinoSize, ModelConfig};
use crate::parameters::{Parameter, parameters};

/// Key maps of the two published formats of DINOv2.
const KEY_MAPS: [&str; 2] = ["dinov2-official", "dinov2-hugging-face"];

/// The frozen backbone of a configuration, read from a published file.
#[derive(Clone, Debug)]
pub struct BackboneWeights {
    /// Parameters whose names begin with `backbone.`.
    pub tensors: StoredTensors,
    /// How the file's tensors were used.
    pub report: ImportReport,
    /// SHA-256 of the file, to be recorded with every result.
    pub sha256: Sha256Digest,
    /// The known file with this hash, if any.
    pub known: Option<&'static KnownFile>,
}

/// Reads the frozen backbone from the authors' file or from Hugging Face's, which differ in tensor names.
///
/// # Errors
/// [`super::TensorError::Missing`] with where to get them, [`ModelError::InFile`] around
/// [`ModelError::Unfit`], or around [`ModelError::Malformed`] if the file's sha256 is not `expected_sha256`, or if it has
/// registers and the model's backbone has none.
pub fn read_backbone(
    path: &Path,
    config: &ModelConfig,
    expected_sha256: Option<Sha256Digest>,
) -> Result<BackboneWeights, ModelError> {
    let file = TensorFile::find(path, || KnownFile::advice(&config.backbone))?;
    file.check_sha256(expected_sha256)?;
    backbone_of(&file, config)
}

/// [`read_backbone`] of an open file.
pub(super) fn backbone_of(file: &TensorFile, config: &ModelConfig) -> Result<BackboneWeights, ModelError> {
    let expected = frozen(config);
    let apply = |map: &str| Ok::<_, ModelError>(KeyMap::resolve(map)?.apply(&file.stored, &expected));
    let [official, hugging_face] = KEY_MAPS.map(apply);
    let (official, hugging_face) = (official?, hugging_face?);
    // If both maps fail, the one that matches more names has the better report.
    let (tensors, report) =
        if official.1.missing.len() > hugging_face.1.missing.len() { hugging_face } else { official };
    if !report.is_complete() {
        return Err(ModelError::Unfit(Box::new(report)).in_file(&file.path));
    }
    // All other tensors of a backbone with registers fit one without them.
    if let Some(extra) = report.left_over.iter().find(|extra| extra.tensor.ends_with("register_tokens")) {
        let found = format!("{} {}", extra.tensor, extra.found);
        let expected = "DINOv2 without registers, as in the model";
        return Err(ModelError::malformed("weights", "file", expected, found).in_file(&file.path));
    }
    Ok(BackboneWeights { tensors, report, sha256: file.sha256, known: KnownFile::with_sha256(file.sha256) })
}

impl BackboneConfig {
    /// The DINOv2 that a file contains completely, by names and shapes, with the import report; the largest if several fit.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] for a broken embedded configuration or key map, never for the file.
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
