use std::path::PathBuf;

use atsplat_files::toml_problem;
use atsplat_model::ModelConfig;
use serde::{Deserialize, Serialize};
use toml::Table;

use super::{WHAT, derived};
use crate::TrainError;

/// A network by name or path, with changes to its configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ModelChoice {
    /// Built-in name, or a path that ends in `.toml`.
    pub base: String,
    /// Pretrained DINOv2 weights, for a network whose backbone is frozen. A run from given weights has them instead of those in its
    /// weights file, which must be the same up to the rounding of that file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub backbone: Option<PathBuf>,
    /// Folder that caches the frozen backbone's features, so that each image goes through it once. It grows with every new
    /// image drawn: at 256×256 with ViT-B, by 0.8 MB each. Other types of processor, and versions that compute features in another
    /// way, have files of their own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub feature_cache: Option<PathBuf>,
    /// Fields of the model's configuration to be changed.
    #[serde(default)]
    pub changes: Table,
    /// Parameters that are initialised although the run starts from given weights: their names, or the names of parts that contain
    /// them, such as `head`. The given weights need not have them, but there must be some.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fresh: Vec<String>,
    /// Whether the run must start from given weights.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub init: bool,
}

impl ModelChoice {
    /// The network's whole configuration.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] if the changes do not fit a configuration, [`TrainError::Model`] if there is no such network or
    /// the changed one contradicts itself.
    pub fn config(&self) -> Result<ModelConfig, TrainError> {
        let base = ModelConfig::resolve(&self.base)?.to_toml()?;
        let mut table: Table =
            base.parse().map_err(|error: toml::de::Error| TrainError::malformed(WHAT, "model.base", "TOML", error))?;
        derived::merge(&mut table, self.changes.clone());
        let fits = |error: toml::de::Error| {
            let (expected, found) = toml_problem("changes that fit a model configuration", &error);
            let field = derived::field_of(&error).map_or_else(String::new, |field| format!(".{field}"));
            TrainError::malformed(WHAT, format!("model.changes{field}"), expected, found)
        };
        let config: ModelConfig = table.try_into().map_err(fits)?;
        config.validate()?;
        Ok(config)
    }
}
