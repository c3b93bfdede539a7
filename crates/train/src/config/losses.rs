use std::num::NonZeroUsize;
use std::path::PathBuf;

use atsplat_camera::no_fields;
use serde::{Deserialize, Serialize};

use super::WHAT;
use crate::TrainError;

/// The training loss (paper, "Training"): `MSE + λp · perceptual` of the final renders, plus, for each intermediate set of
/// Gaussians, `λint · (MSE + λs · D-SSIM) + λunc · uncertainty`; with exact distances of simulated scenes also those.
///
/// Intermediate sets are those of the blocks before the last. The paper's sum runs over all blocks; but the last block's set is the
/// final one, and no expansion follows it whose scores could be trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct LossConfig {
    /// The perceptual term.
    pub perceptual: PerceptualChoice,
    /// `λp`.
    pub perceptual_weight: f64,
    /// `λp` in the last quarter of the run; unchanged by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub late_perceptual_weight: Option<f64>,
    /// `λint`.
    pub intermediate_weight: f64,
    /// `λs`: the paper replaces the perceptual term with D-SSIM here and states no other weight than its 0.5, which is the default,
    /// whatever `λp` is.
    pub intermediate_d_ssim_weight: f64,
    /// `λunc`: 0.0 is required of new runs with the selection straight-through, whose scores the rendering loss trains.
    pub uncertainty_weight: f64,
    /// Weight, at the first step, of the difference between the logarithms of the anchors' distances and the exact ones
    /// of simulated scenes; falls linearly. The paper has no such term; 0 by default.
    pub distance_weight: f64,
    /// Share of the run after which that weight is 0.
    pub distance_until: f64,
    /// Number of targets that the intermediate sets are rendered to; by default all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub intermediate_targets: Option<NonZeroUsize>,
    /// Background colour: RGB from 0 to 1.
    pub background: [f64; 3],
}

/// Choice of the perceptual term.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(
    rename_all = "kebab-case",
    tag = "kind",
    deny_unknown_fields,
    expecting = "a table such as { kind = \"d-ssim\" } or { kind = \"learned\", network = …, weights = … }"
)]
pub enum PerceptualChoice {
    /// `1 − SSIM`: replaces a learned loss when there are no weights for one.
    #[default]
    #[serde(deserialize_with = "no_fields")]
    DSsim,
    /// LPIPS or ST-LPIPS.
    #[serde(rename_all = "kebab-case")]
    Learned {
        /// Which network.
        network: atsplat_metrics::learned::LpipsNetwork,
        /// The network's weights, in the metric's format.
        weights: PathBuf,
    },
}

impl Default for LossConfig {
    fn default() -> Self {
        Self {
            perceptual: PerceptualChoice::DSsim,
            perceptual_weight: 0.5,
            late_perceptual_weight: None,
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

/// Share of the run after which [`LossConfig::late_perceptual_weight`] applies.
const LATE: f64 = 0.75;

impl LossConfig {
    /// Weight of the perceptual term after this share of the run, from 0 to 1.
    pub fn perceptual_weight_at(&self, progress: f64) -> f64 {
        self.late_perceptual_weight.filter(|_| progress >= LATE).unwrap_or(self.perceptual_weight)
    }

    /// Weight of exact distances after this share of the run, from 0 to 1.
    pub fn distance_weight_at(&self, progress: f64) -> f64 {
        self.distance_weight * (1.0 - progress / self.distance_until).clamp(0.0, 1.0)
    }

    pub(super) fn validate(&self) -> Result<(), TrainError> {
        let weights = [
            ("losses.perceptual-weight", self.perceptual_weight),
            ("losses.late-perceptual-weight", self.perceptual_weight_at(1.0)),
            ("losses.intermediate-weight", self.intermediate_weight),
            ("losses.intermediate-d-ssim-weight", self.intermediate_d_ssim_weight),
            ("losses.uncertainty-weight", self.uncertainty_weight),
            ("losses.distance-weight", self.distance_weight),
        ];
        if !(self.distance_until > 0.0 && self.distance_until <= 1.0) {
            let expected = "a share of the run, above 0, at most 1";
            return Err(TrainError::malformed(WHAT, "losses.distance-until", expected, self.distance_until));
        }
        if let Some(channel) = self.background.into_iter().find(|channel| !(0.0..=1.0).contains(channel)) {
            return Err(TrainError::malformed(WHAT, "losses.background", "channels from 0 to 1", channel));
        }
        match weights.into_iter().find(|(_, weight)| !(*weight >= 0.0 && weight.is_finite())) {
            Some((field, weight)) => Err(TrainError::malformed(WHAT, field, "a number of at least 0", weight)),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Such as a learned loss whose `kind` was left as it was.
    #[test]
    fn d_ssim_has_no_settings() {
        let read = |more: &str| {
            let text = format!("perceptual = {{ kind = 'd-ssim'{more} }}");
            toml::from_str::<LossConfig>(&text).map_err(|error| error.to_string())
        };
        let config = read("").unwrap();
        assert_eq!(config, LossConfig::default());
        assert!(toml::to_string(&config).unwrap().contains("[perceptual]\nkind = \"d-ssim\"\n"), "{config:?}");
        let learned = ", network = 'lpips-vgg', weights = 'vgg16.pth'";
        for (more, field) in [(", weight = 0.05", "`weight`"), (learned, "`network`")] {
            let error = read(more).unwrap_err();
            assert!(error.contains("unknown field") && error.contains(field), "{error}");
        }
    }

    #[test]
    fn weights_change_over_the_run() {
        let text = "perceptual-weight = 0.05\nlate-perceptual-weight = 0.2\ndistance-weight = 0.3";
        let config: LossConfig = toml::from_str(text).unwrap();
        config.validate().unwrap();
        let same = |weight: &dyn Fn(f64) -> f64, expected: [f64; 5], what: &str| {
            let weights = [0.0, 0.3, 0.74, 0.75, 0.99].map(weight);
            atsplat_numeric::Tolerance::absolute(1e-12).assert(weights, expected, what);
        };
        same(&|progress| config.perceptual_weight_at(progress), [0.05, 0.05, 0.05, 0.2, 0.2], "perceptual");
        same(&|progress| config.distance_weight_at(progress), [0.3, 0.15, 0.0, 0.0, 0.0], "distances");
        let constant = LossConfig { late_perceptual_weight: None, ..config.clone() };
        same(&|progress| constant.perceptual_weight_at(progress), [0.05; 5], "without a late weight");
        let broken = LossConfig { late_perceptual_weight: Some(-1.0), ..config };
        let error = broken.validate().unwrap_err().to_string();
        assert!(error.contains("losses.late-perceptual-weight"), "{error}");
    }
}
