use std::path::PathBuf;

use atsplat_scene::preprocess::{Preprocessing, RescaleAndCrop};
use serde::{Deserialize, Serialize};

use crate::drift::DriftError;

/// Which stages a probe runs, by the names that a user would give; what is behind the names is what may drift.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct Recipe {
    /// Name or TOML file of a [`atsplat_model::ModelConfig`].
    pub model: String,
    /// Its weights.
    pub weights: ProbeWeights,
    /// What happens to pictures of 112×96 pixels; the network's patches must divide what comes out.
    pub preprocessing: Preprocessing,
    /// Name of a preset of [`atsplat_splat::RendererConstants`].
    pub constants: String,
    /// RGB behind everything, in [0, 1].
    pub background: [f64; 3],
    /// Ids of metrics, none of them with weights of its own.
    pub metrics: Vec<String>,
}

/// Where a probe's weights come from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ProbeWeights {
    /// Generated from a seed, on every machine alike.
    Seed(u64),
    /// A weights file of this toolkit.
    File(PathBuf),
}

impl Default for Recipe {
    /// The smallest network with generated weights on 64×64 pixels: no file is needed.
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
    /// A recipe from TOML text; what it leaves out is the default.
    ///
    /// # Errors
    /// [`DriftError::Unfit`] with the place.
    pub fn from_toml(text: &str) -> Result<Self, DriftError> {
        toml::from_str(text).map_err(|error| DriftError::unfit("probe", "a recipe in TOML", error))
    }
}
