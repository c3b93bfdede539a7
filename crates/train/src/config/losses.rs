use std::num::NonZeroUsize;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::WHAT;
use crate::TrainError;

/// The training loss (paper, "Training"): `MSE + λp · perceptual` of the final renders, plus, for each intermediate set of
/// Gaussians, `λint · (MSE + λs · D-SSIM) + λunc · uncertainty`; with exact distances of simulated scenes also those.
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
    /// Weight, at the first step, of the difference between the logarithms of the anchors' distances and the exact ones
    /// of simulated scenes; falls linearly. The paper has no such term; 0 by default.
    pub distance_weight: f64,
    /// Share of the run after which that weight is 0.
    pub distance_until: f64,
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
            distance_weight: 0.0,
            distance_until: 0.6,
            intermediate_targets: None,
            background: [0.0; 3],
        }
    }
}

impl LossConfig {
    /// Weight of exact distances after `share` of the run.
    pub fn distance_weight_at(&self, share: f64) -> f64 {
        self.distance_weight * (1.0 - share / self.distance_until).clamp(0.0, 1.0)
    }

    pub(super) fn validate(&self) -> Result<(), TrainError> {
        let weights = [
            ("losses.perceptual-weight", self.perceptual_weight),
            ("losses.intermediate-weight", self.intermediate_weight),
            ("losses.intermediate-d-ssim-weight", self.intermediate_d_ssim_weight),
            ("losses.uncertainty-weight", self.uncertainty_weight),
            ("losses.distance-weight", self.distance_weight),
        ];
        if !(self.distance_until > 0.0 && self.distance_until <= 1.0) {
            let expected = "a share of the run, above 0, at most 1";
            return Err(TrainError::malformed(WHAT, "losses.distance-until", expected, self.distance_until));
        }
        match weights.into_iter().find(|(_, weight)| !(*weight >= 0.0 && weight.is_finite())) {
            Some((field, weight)) => Err(TrainError::malformed(WHAT, field, "a number of at least 0", weight)),
            None => Ok(()),
        }
    }
}
