mod baseline_one;
mod first_view_relative;
mod max_pairwise;
mod mean_camera;

use atsplat_numeric::Tolerance;
use serde::{Deserialize, Serialize};

use crate::{CameraError, Similarity, WorldFromCamera};
pub use mean_camera::MeanCameraScale;

/// Smallest baseline that pixelSplat and NoPoSplat accept (`baseline_epsilon`, `baseline_min`).
const BASELINE_MINIMUM: f64 = 1e-3;

/// How a trial's world is moved and scaled before a method sees it.
///
/// In a file each is a table: `{ rule = "mean-camera", scale = "long-lrm" }`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "rule", rename_all = "kebab-case", deny_unknown_fields)]
pub enum PoseNormalisation {
    /// The dataset's own world: MVSplat, DepthSplat.
    #[default]
    None,
    /// Lengths are divided by the distance between the first and the last context view; nothing is
    /// moved. pixelSplat `src/dataset/dataset_re10k.py:141-154`, NoPoSplat `:163-179`.
    BaselineOne {
        /// Shorter baselines are an error, in scene units.
        #[serde(default = "baseline_minimum")]
        minimum: f64,
        /// Longer baselines are an error, in scene units (NoPoSplat: 1e10 on RE10K, 1e2 on DL3DV).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        maximum: Option<f64>,
    },
    /// The first context view becomes the world: `E ← E₀⁻¹ · E`. NoPoSplat `misc/cam_utils.py:27-41`.
    FirstViewRelative,
    /// Lengths are divided by the largest distance between two context views; nothing is moved.
    /// YoNoSplat `src/dataset/norm_scale.py:20-55`, method `max_pairwise_d`.
    MaxPairwise {
        /// Shorter distances are an error, in scene units.
        #[serde(default = "baseline_minimum")]
        minimum: f64,
        /// Longer distances are an error, in scene units.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        maximum: Option<f64>,
    },
    /// The mean of the views becomes the world's origin and axes. Long-LRM `data/dataset.py:192-205`,
    /// iLRM `src/dataset/dataset_re10k.py:163-179`, LVSM `data/dataset_scene.py:97-131`.
    ///
    /// With the mean forward axis `m_z`, the mean down axis `m_y` and the mean centre `c`:
    /// `f = normalize(m_z)`, `d = normalize(m_y − (m_y·f) f)`, `r = d × f`, `E′ = [r d f c]⁻¹ · E`.
    /// Where that has no stable answer, the [`Fallback`]s apply.
    MeanCamera {
        /// How lengths are scaled afterwards.
        #[serde(default)]
        scale: MeanCameraScale,
        /// A further factor on all lengths (Long-LRM's `scene_scale`); > 0.
        #[serde(default = "one", skip_serializing_if = "is_one")]
        scene_scale: f64,
    },
    /// One rule after the other; factors multiply. NoPoSplat is baseline-one, then first-view-relative.
    Sequence {
        /// The rules, first to last.
        steps: Vec<Self>,
    },
}

const fn baseline_minimum() -> f64 {
    BASELINE_MINIMUM
}

const fn one() -> f64 {
    1.0
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes fields by reference")]
fn is_one(value: &f64) -> bool {
    Tolerance::EXACT.accepts(*value, 1.0)
}

/// What a rule had to do because its published formula has no stable answer for these views.
///
/// Reported in this order. Each replacement is taken from the views themselves, never from the world's
/// axes, so that moving the world still changes nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fallback {
    /// There is one view: the mean camera is that view.
    SingleView,
    /// Views look in opposite directions, so that their forward axes cancel (mean shorter than 0.01):
    /// the forward axis is the first context view's.
    ForwardsCancel,
    /// The down axes cancel, or their mean is parallel to the forward axis (what is left across it,
    /// times the length of the mean forward axis, is shorter than 0.01): the first context view's down
    /// axis takes the mean's place.
    DownsCancel,
    /// That view's down axis is within 30° of the forward axis too: its right axis decides instead.
    FirstDownAlongForward,
    /// All centres that the scale is measured on coincide (closer than 1e-9 of their distance from the
    /// world's origin, which is as exactly as files state them): lengths keep their scale.
    CoincidentCentres,
}

/// A trial's cameras in their normalised world, and how they came there.
#[derive(Clone, Debug, PartialEq)]
pub struct Normalised {
    /// Context cameras, in the order given.
    pub context: Vec<WorldFromCamera>,
    /// Target cameras, in the order given.
    pub targets: Vec<WorldFromCamera>,
    /// From the dataset's world to the normalised world; its `scale` is the factor on all lengths.
    pub new_from_old: Similarity,
    /// What a dataset's near and far planes are multiplied with. The rules that divide by a baseline
    /// scale them along (pixelSplat `dataset_re10k.py:141-154`); the mean-camera methods state near and
    /// far in normalised units, so theirs is 1.
    pub near_far_multiplier: f64,
    /// What had to be done differently; empty for ordinary views.
    pub fallbacks: Vec<Fallback>,
}

/// What one rule decides; applying it is the same for all.
struct Step {
    new_from_old: Similarity,
    near_far_multiplier: f64,
    fallbacks: Vec<Fallback>,
}

impl Step {
    const UNCHANGED: Self =
        Self { new_from_old: Similarity::IDENTITY, near_far_multiplier: 1.0, fallbacks: Vec::new() };

    /// Lengths and both planes divided by `distance`.
    fn divided_by(distance: f64) -> Self {
        let scale = distance.recip();
        Self {
            new_from_old: Similarity { scale, ..Similarity::IDENTITY },
            near_far_multiplier: scale,
            ..Self::UNCHANGED
        }
    }
}

/// Applies `rule` to the cameras of one trial. The rule looks at the context views; targets are moved
/// along (only [`MeanCameraScale::Lvsm`] looks at them too, as LVSM does).
///
/// First-view-relative, the mean camera under any scale but [`MeanCameraScale::IlrmMain`], and a sequence
/// that ends in one of them give the same cameras however the dataset's world is moved. The bound is
/// 1e-12 relative to the larger of the normalised scene and its distance from the old origin in
/// normalised units: f64 poses far from their origin carry no more.
///
/// # Errors
/// [`CameraError::TooFewPoses`] without context views, [`CameraError::BaselineOutOfRange`] where the
/// papers skip the scene, [`CameraError::NotPositive`] or [`CameraError::NonFinite`] for a scale that
/// is no scale or for poses so large that they overflow.
pub fn normalise(
    context: &[WorldFromCamera],
    targets: &[WorldFromCamera],
    rule: &PoseNormalisation,
) -> Result<Normalised, CameraError> {
    if let PoseNormalisation::Sequence { steps } = rule {
        let unchanged = PoseNormalisation::None;
        let start = normalise(context, targets, &unchanged)?;
        return steps.iter().try_fold(start, |before, step| {
            let after = normalise(&before.context, &before.targets, step)?;
            Ok(Normalised {
                new_from_old: before.new_from_old.then(&after.new_from_old),
                near_far_multiplier: before.near_far_multiplier * after.near_far_multiplier,
                fallbacks: [before.fallbacks, after.fallbacks].concat(),
                ..after
            })
        });
    }
    let Some((first, last)) = context.first().zip(context.last()) else {
        return Err(CameraError::TooFewPoses { what: "pose normalisation", expected: 1, found: 0 });
    };
    let step = match rule {
        PoseNormalisation::None | PoseNormalisation::Sequence { .. } => {
            return Ok(Normalised {
                context: context.to_vec(),
                targets: targets.to_vec(),
                new_from_old: Similarity::IDENTITY,
                near_far_multiplier: 1.0,
                fallbacks: Vec::new(),
            });
        }
        PoseNormalisation::BaselineOne { minimum, maximum } => baseline_one::step(first, last, *minimum, *maximum)?,
        PoseNormalisation::FirstViewRelative => first_view_relative::step(first),
        PoseNormalisation::MaxPairwise { minimum, maximum } => max_pairwise::step(context, *minimum, *maximum)?,
        PoseNormalisation::MeanCamera { scale, scene_scale } => {
            mean_camera::step(first, context, targets, *scale, *scene_scale)?
        }
    };
    let moved = |poses: &[WorldFromCamera]| -> Result<Vec<_>, CameraError> {
        poses.iter().map(|pose| step.new_from_old.new_pose_from_old(pose)).collect()
    };
    Ok(Normalised {
        context: moved(context)?,
        targets: moved(targets)?,
        new_from_old: step.new_from_old,
        near_far_multiplier: step.near_far_multiplier,
        fallbacks: step.fallbacks,
    })
}

impl PoseNormalisation {
    /// pixelSplat's: baseline 1, the dataset's axes.
    pub const fn pixelsplat() -> Self {
        Self::BaselineOne { minimum: BASELINE_MINIMUM, maximum: None }
    }

    /// NoPoSplat's: baseline 1, then relative to the first context view.
    pub fn noposplat() -> Self {
        Self::Sequence { steps: vec![Self::pixelsplat(), Self::FirstViewRelative] }
    }

    /// YoNoSplat's: largest pairwise distance 1, then relative to the first context view.
    pub fn yonosplat() -> Self {
        let scale = Self::MaxPairwise { minimum: BASELINE_MINIMUM, maximum: None };
        Self::Sequence { steps: vec![scale, Self::FirstViewRelative] }
    }

    /// The mean camera under one of the published scales.
    pub const fn mean_camera(scale: MeanCameraScale) -> Self {
        Self::MeanCamera { scale, scene_scale: 1.0 }
    }

    /// The rule's name as in a file; a sequence is named by its steps.
    pub fn name(&self) -> String {
        match self {
            Self::None => "none".to_owned(),
            Self::BaselineOne { .. } => baseline_one::NAME.to_owned(),
            Self::FirstViewRelative => "first-view-relative".to_owned(),
            Self::MaxPairwise { .. } => max_pairwise::NAME.to_owned(),
            Self::MeanCamera { scale, .. } => format!("mean-camera ({})", scale.name()),
            Self::Sequence { steps } => steps.iter().map(Self::name).collect::<Vec<_>>().join(", then "),
        }
    }
}

/// `distance` where it is inside the accepted range.
fn accepted(rule: &'static str, distance: f64, minimum: f64, maximum: Option<f64>) -> Result<f64, CameraError> {
    let maximum = maximum.unwrap_or(f64::MAX);
    // At zero there is nothing to divide by, whatever the minimum says.
    if distance >= minimum && distance <= maximum && distance.recip().is_normal() {
        Ok(distance)
    } else {
        Err(CameraError::BaselineOutOfRange { rule, found: distance, minimum, maximum })
    }
}
