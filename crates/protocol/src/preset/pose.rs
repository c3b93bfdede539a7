use serde::{Deserialize, Serialize};

/// How a trial's world is moved and scaled before a method sees it, as presets write it:
/// `{ rule = "mean-camera", scale = "long-lrm" }`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "rule", rename_all = "kebab-case", deny_unknown_fields)]
pub enum PoseNormalisation {
    /// The dataset's own world: MVSplat, DepthSplat.
    #[default]
    None,
    /// Lengths divided by the distance between the first and the last context view: pixelSplat
    /// `src/dataset/dataset_re10k.py:141-154`, NoPoSplat `:163-179`.
    BaselineOne {
        /// Shorter baselines are an error, in scene units.
        #[serde(default = "baseline_minimum")]
        minimum: f64,
        /// Longer baselines are an error, in scene units.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        maximum: Option<f64>,
    },
    /// The first context view becomes the world: NoPoSplat `misc/cam_utils.py:27-41`.
    FirstViewRelative,
    /// Lengths divided by the largest distance between two context views: YoNoSplat
    /// `src/dataset/norm_scale.py:20-55`.
    MaxPairwise {
        /// Shorter distances are an error, in scene units.
        #[serde(default = "baseline_minimum")]
        minimum: f64,
        /// Longer distances are an error, in scene units.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        maximum: Option<f64>,
    },
    /// The mean of the context views becomes the world: iLRM, Long-LRM `data/dataset.py:192-205`.
    MeanCamera {
        /// How lengths are scaled afterwards.
        #[serde(default)]
        scale: MeanCameraScale,
        /// A further factor on all lengths; > 0.
        #[serde(default = "one")]
        scene_scale: f64,
    },
    /// One rule after the other.
    Sequence {
        /// The rules, first to last.
        steps: Vec<Self>,
    },
}

/// How lengths are scaled once the mean camera is the world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeanCameraScale {
    /// The largest absolute coordinate of a normalised context centre becomes 1.
    #[default]
    LongLrm,
    /// Divides by the largest absolute coordinate of the original context centres.
    IlrmMain,
    /// LVSM's mean over context and target views, and its factor 1.35.
    Lvsm,
    /// Lengths stay.
    None,
}

const fn baseline_minimum() -> f64 {
    1e-3
}

const fn one() -> f64 {
    1.0
}
