//! Which DINOv2 a file holds, told by its names and shapes.

use atsplat_model::config::{BackboneConfig, DinoSize};
use atsplat_model::parameters::{Parameter, parameters};
use atsplat_model::weights::{KeyMap, StoredTensors};
use atsplat_model::{ModelConfig, ModelError};
use serde::Serialize;

/// A published network that a file holds whole.
#[derive(Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Backbone {
    size: DinoSize,
    registers: bool,
    key_map: String,
    /// Parameters of the network that the file gives.
    pub(super) parameters: usize,
    /// Tensors of the file that are no part of it.
    left_over: usize,
}

impl Backbone {
    /// The one whose every parameter the file has, finite and of its shape; the largest where several fit.
    pub(super) fn in_file(stored: &StoredTensors) -> Result<Option<Self>, ModelError> {
        let mut config = ModelConfig::named("paper-re10k")?;
        for key_map in ["dinov2-official", "dinov2-hugging-face"] {
            let map = KeyMap::resolve(key_map)?;
            for size in [DinoSize::Large, DinoSize::Base, DinoSize::Small, DinoSize::Tiny] {
                for registers in [true, false] {
                    config.backbone = BackboneConfig::DinoV2 { size, registers };
                    let frozen: Vec<Parameter> =
                        parameters(&config).into_iter().filter(|parameter| !parameter.trained).collect();
                    let (_, report) = map.apply(stored, &frozen);
                    if report.is_complete() {
                        let (parameters, left_over) = (report.matched.len(), report.left_over.len());
                        return Ok(Some(Self { size, registers, key_map: key_map.to_owned(), parameters, left_over }));
                    }
                }
            }
        }
        Ok(None)
    }
}

impl std::fmt::Display for Backbone {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let size = match self.size {
            DinoSize::Tiny => "the tests' tiny size",
            DinoSize::Small => "ViT-S/14",
            DinoSize::Base => "ViT-B/14",
            DinoSize::Large => "ViT-L/14",
        };
        let registers = if self.registers { "with" } else { "without" };
        write!(f, "shape of DINOv2 {size} {registers} registers, by key map {}", self.key_map)
    }
}
