//! Detects which DINOv2 a file holds, by tensor names and shapes.

use atsplat_model::ModelError;
use atsplat_model::config::{BackboneConfig, DinoSize};
use atsplat_model::weights::StoredTensors;
use serde::Serialize;

/// A published network that a file holds completely.
#[derive(Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Backbone {
    size: DinoSize,
    registers: bool,
    key_map: String,
    /// Number of the network's parameters in the file.
    pub(super) parameters: usize,
    /// Number of other tensors in the file.
    left_over: usize,
}

impl Backbone {
    pub(super) fn in_file(stored: &StoredTensors) -> Result<Option<Self>, ModelError> {
        let found = BackboneConfig::in_file(stored)?;
        Ok(found.and_then(|(backbone, report)| match backbone {
            BackboneConfig::DinoV2 { size, registers } => {
                let (parameters, left_over) = (report.matched.len(), report.left_over.len());
                Some(Self { size, registers, key_map: report.key_map, parameters, left_over })
            }
            BackboneConfig::Patch { .. } => None,
        }))
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
