use std::num::NonZeroUsize;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::WHAT;
use crate::TrainError;

/// The training loss (paper, "Training"): `MSE + λp · perceptual` of the final renders, plus, for each intermediate set of
/// Gaussians, `λint · (MSE + λs · D-SSIM) + λunc · uncertainty`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct LossConfig {
    /// The perceptual term.
    pub perceptual: PerceptualChoice,
    /// `λp`.
    pub perceptual_weight: f64,
    /// `λint`.
    pub intermediate_weight: f64,
    /// `λs`, which the paper does not state; by default the value of `λp`.
    pub intermediate_d_ssim_weight: f64,
    /// `λunc`.
    pub uncertainty_weight: f64,
    /// Number of targets that the intermediate sets are rendered to; by default all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub intermediate_targets: Option<NonZeroUsize>,
    /// RGB behind the Gaussians.
    pub background: [f64; 3],
}

/// Choice of the perceptual term.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind", deny_unknown_fields)]
pub enum PerceptualChoice {
    /// `1 − SSIM`: replaces a learned loss when there are no weights for one.
    #[default]
    DSsim,
    /// LPIPS or ST-LPIPS.
    #[serde(rename_all = "kebab-case")]
    Learned {
        /// Which network.
        network: atsplat_metrics::learned::Network,
        /// The network's weights, in the metric's format.
        weights: PathBuf,
    },
}

impl Default for LossConfig {
    fn default() -> Self {
        Self {
            perceptual: PerceptualChoice::DSsim,
            perceptual_weight: 0.5,
            intermediate_weight: 0.5,
            intermediate_d_ssim_weight: 0.5,
            uncertainty_weight: 0.1,
            intermediate_targets: None,
            background: [0.0; 3],
        }
    }
}

impl LossConfig {
    pub(super) fn validate(&self) -> Result<(), TrainError> {
        let weights = [
            ("losses.perceptual-weight", self.perceptual_weight),
            ("losses.intermediate-weight", self.intermediate_weight),
            ("losses.intermediate-d-ssim-weight", self.intermediate_d_ssim_weight),
            ("losses.uncertainty-weight", self.uncertainty_weight),
        ];
        match weights.into_iter().find(|(_, weight)| !(*weight >= 0.0 && weight.is_finite())) {
            Some((field, weight)) => Err(TrainError::malformed(WHAT, field, "a number of at least 0", weight)),
            None => Ok(()),
        }
    }
}
