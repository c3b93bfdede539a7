use std::path::PathBuf;

use atsplat_files::malformed_toml;
use atsplat_scene::preprocess::{Preprocessing, RescaleAndCrop};
use serde::{Deserialize, Serialize};

use crate::DriftError;

/// Settings of a probe's stages, by the names that a user would give; what the names refer to may drift.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct Recipe {
    /// Name or TOML file of a [`atsplat_model::ModelConfig`].
    pub model: String,
    /// Its weights.
    pub weights: ProbeWeights,
    /// Preprocessing of the 112×96 images; the network's patches must divide the resulting size.
    pub preprocessing: Preprocessing,
    /// Name of a preset of [`atsplat_splat::RendererConstants`].
    pub constants: String,
    /// Background RGB in [0, 1].
    pub background: [f64; 3],
    /// Ids of metrics without learned weights, at least one.
    pub metrics: Vec<String>,
}

/// Where a probe's weights come from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ProbeWeights {
    /// Generated from a seed, equal on every machine.
    Seed(u64),
    /// A weights file of this toolkit.
    File(PathBuf),
}

impl Default for Recipe {
    /// The smallest network with generated weights on 64×64 pixels, which needs no files.
    fn default() -> Self {
        Self {
            model: "nano".to_owned(),
            weights: ProbeWeights::Seed(1),
            preprocessing: Preprocessing::of([RescaleAndCrop::new(64, 64).into()]),
            constants: "exact".to_owned(),
            background: [0.0; 3],
            metrics: ["psnr", "ssim", "l1"].map(str::to_owned).to_vec(),
        }
    }
}

impl Recipe {
    /// Parses a recipe from TOML; omitted fields have their defaults.
    ///
    /// # Errors
    /// [`DriftError::Malformed`] with line and column.
    pub fn from_toml(text: &str) -> Result<Self, DriftError> {
        toml::from_str(text).map_err(|error| malformed_toml("probe", "a recipe", text, &error).into())
    }
}
