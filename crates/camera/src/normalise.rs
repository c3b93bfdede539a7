mod mean_camera;

use std::fmt;

use atsplat_numeric::{Extremes, Tolerance};
use serde::{Deserialize, Serialize};

use crate::{CameraError, Similarity, WorldFromCamera, no_fields};
pub use mean_camera::MeanCameraScale;

/// Smallest baseline that pixelSplat and NoPoSplat accept (`baseline_epsilon`, `baseline_min`).
const BASELINE_MINIMUM: f64 = 1e-3;

const BASELINE_ONE: &str = "baseline-one";
const MAX_PAIRWISE: &str = "max-pairwise";

/// How a trial's world is transformed before it is passed to a method.
///
/// In a file this is a table: `{ rule = "mean-camera", scale = "long-lrm" }`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "rule", rename_all = "kebab-case", deny_unknown_fields)]
pub enum PoseNormalisation {
    /// The dataset's own world: MVSplat, DepthSplat.
    #[default]
    #[serde(deserialize_with = "no_fields")]
    None,
    /// Divides lengths by the distance between the first and the last context view, without moving the world.
    /// pixelSplat `src/dataset/dataset_re10k.py:141-154`, NoPoSplat `:163-179`.
    BaselineOne {
        /// Shorter baselines are an error, in scene units.
        #[serde(default = "baseline_minimum")]
        minimum: f64,
        /// Longer baselines are an error, in scene units (NoPoSplat: 1e10 on RE10K, 1e2 on DL3DV).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        maximum: Option<f64>,
    },
    /// The first context view becomes the world: `E ← E₀⁻¹ · E`. NoPoSplat `misc/cam_utils.py:27-41`.
    #[serde(deserialize_with = "no_fields")]
    FirstViewRelative,
    /// Divides lengths by the largest distance between two context views, without moving the world. YoNoSplat
    /// `src/dataset/norm_scale.py:20-55`, method `max_pairwise_d`.
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
    /// If that is numerically unstable, the [`Fallback`]s apply; the published code divides whatever the scale is.
    MeanCamera {
        /// How lengths are scaled afterwards.
        #[serde(default)]
        scale: MeanCameraScale,
        /// All lengths are divided by this too: Long-LRM's `scene_scale`, a factor of the length that becomes 1; > 0.
        #[serde(default = "one", skip_serializing_if = "is_one")]
        scene_scale: f64,
    },
    /// Several rules in order; factors multiply. NoPoSplat is baseline-one, then first-view-relative.
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

/// A replacement in a rule because its published formula is undefined or unstable for these views, or a doubt about its result.
///
/// Reported in this order. Replacements never depend on the world's axes, and only [`Self::CoincidentCentres`] on the distance from its
/// origin, so that the result is still invariant to moving the world as far as the poses are precise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fallback {
    /// There is only one view, which is the mean camera.
    SingleView,
    /// The forward axes of opposite views cancel (mean shorter than 0.01): the forward axis is the first context view's.
    ForwardsCancel,
    /// The down axes cancel, or their mean is parallel to the forward axis (its orthogonal part, times the length of the
    /// mean forward axis, is shorter than 0.01): the mean is replaced by the first context view's down axis.
    DownsCancel,
    /// That view's down axis is within 30° of the forward axis: its right axis is used instead.
    FirstDownAlongForward,
    /// All centres that determine the scale coincide within the precision of their poses ([`crate::CentreSpread`]): lengths
    /// keep their scale.
    CoincidentCentres,
    /// All centres that determine the scale are closer together than 1e-6 of their distance from the world's origin, but farther apart
    /// than their precision ([`crate::CentreSpread::Close`]). Nothing is replaced.
    CloseCentres,
}

impl fmt::Display for Fallback {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::SingleView => "there is only one context view, which is the mean camera",
            Self::ForwardsCancel => "the views' forward axes cancel; the first view's is used",
            Self::DownsCancel => {
                "the views' down axes cancel or lie along the mean forward axis; the first view's is used"
            }
            Self::FirstDownAlongForward => {
                "the first view's down axis is within 30 degrees of the forward axis; its right axis is used"
            }
            Self::CoincidentCentres => {
                "all camera centres coincide within the precision of their poses; lengths keep their scale"
            }
            Self::CloseCentres => {
                "all camera centres are closer together than 1e-6 of their distance from the origin; lengths are divided \
                 by so small a distance, as published"
            }
        })
    }
}

/// A trial's cameras in the normalised world, and the transform to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Normalised {
    /// Context cameras, in the given order.
    pub context: Vec<WorldFromCamera>,
    /// Target cameras, in the given order.
    pub targets: Vec<WorldFromCamera>,
    /// Transform from the dataset's world to the normalised world; its `scale` is the factor on all lengths.
    pub new_from_old: Similarity,
    /// Factor for a dataset's near and far planes. The rules that divide by a baseline scale them too (pixelSplat
    /// `dataset_re10k.py:141-154`); the mean-camera methods define near and far in normalised units, so theirs is 1.
    pub near_far_multiplier: f64,
    /// Deviations from the published formula; empty for ordinary views.
    pub fallbacks: Vec<Fallback>,
}

/// The result of one rule, before it is applied.
struct Step {
    new_from_old: Similarity,
    near_far_multiplier: f64,
    fallbacks: Vec<Fallback>,
}

impl Step {
    const UNCHANGED: Self =
        Self { new_from_old: Similarity::IDENTITY, near_far_multiplier: 1.0, fallbacks: Vec::new() };

    /// Divides lengths and both planes by `distance`.
    fn divided_by(distance: f64) -> Self {
        let scale = distance.recip();
        Self {
            new_from_old: Similarity { scale, ..Similarity::IDENTITY },
            near_far_multiplier: scale,
            ..Self::UNCHANGED
        }
    }
}

/// Applies `rule` to the cameras of one trial. The rule depends on the context views only; the same transform is applied
/// to the targets ([`MeanCameraScale::Lvsm`] depends on both, as LVSM does).
///
/// First-view-relative, the mean camera under any scale but [`MeanCameraScale::IlrmMain`], and a sequence that ends in
/// one of them are invariant to rigid motions of the dataset's world, up to which [`Fallback::CoincidentCentres`] stays the same. The
/// bound is 1e-12 relative to the larger of the normalised scene and its distance from the old origin in normalised units,
/// the precision of f64 poses far from their origin.
///
/// # Errors
/// [`CameraError::TooFewPoses`] without context views, [`CameraError::BaselineOutOfRange`] if the papers skip the scene,
/// [`CameraError::NotPositive`] or [`CameraError::NonFinite`] for an invalid scale or poses that overflow.
pub fn normalise(
    context: &[WorldFromCamera],
    targets: &[WorldFromCamera],
    rule: &PoseNormalisation,
) -> Result<Normalised, CameraError> {
    let Some((first, last)) = context.first().zip(context.last()) else {
        return Err(CameraError::TooFewPoses { what: "context poses of a pose normalisation", expected: 1, found: 0 });
    };
    let step = match rule {
        PoseNormalisation::None => return Ok(Normalised::unchanged(context, targets)),
        PoseNormalisation::Sequence { steps } => return in_sequence(context, targets, steps),
        PoseNormalisation::BaselineOne { minimum, maximum } => {
            let baseline = first.centre().distance(last.centre());
            Step::divided_by(accepted(BASELINE_ONE, baseline, *minimum, *maximum)?)
        }
        PoseNormalisation::FirstViewRelative => {
            // The inverse rather than the transpose, like `torch.inverse` in the papers: the rounding of the first view
            // cancels.
            let rotation = first.rotation().inverse();
            Step { new_from_old: Similarity { rotation, origin: first.centre(), scale: 1.0 }, ..Step::UNCHANGED }
        }
        PoseNormalisation::MaxPairwise { minimum, maximum } => {
            Step::divided_by(accepted(MAX_PAIRWISE, largest_distance(context), *minimum, *maximum)?)
        }
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

/// Applies several rules, one after the other, to the cameras of a trial with a context view.
fn in_sequence(
    context: &[WorldFromCamera],
    targets: &[WorldFromCamera],
    steps: &[PoseNormalisation],
) -> Result<Normalised, CameraError> {
    steps.iter().try_fold(Normalised::unchanged(context, targets), |before, step| {
        let after = normalise(&before.context, &before.targets, step)?;
        Ok(Normalised {
            new_from_old: before.new_from_old.then(&after.new_from_old),
            near_far_multiplier: before.near_far_multiplier * after.near_far_multiplier,
            fallbacks: [before.fallbacks, after.fallbacks].concat(),
            ..after
        })
    })
}

/// The largest distance between two centres; 0 for a single view.
fn largest_distance(views: &[WorldFromCamera]) -> f64 {
    let pairs = views.iter().enumerate().flat_map(|(i, a)| views[i + 1..].iter().map(move |b| (a, b)));
    pairs.fold(0.0f64, |largest, (a, b)| largest.maximum_of(a.centre().distance(b.centre())))
}

impl Normalised {
    fn unchanged(context: &[WorldFromCamera], targets: &[WorldFromCamera]) -> Self {
        Self {
            context: context.to_vec(),
            targets: targets.to_vec(),
            new_from_old: Similarity::IDENTITY,
            near_far_multiplier: 1.0,
            fallbacks: Vec::new(),
        }
    }
}

impl PoseNormalisation {
    /// pixelSplat's rule: baseline 1, the dataset's axes.
    pub const fn pixelsplat() -> Self {
        Self::BaselineOne { minimum: BASELINE_MINIMUM, maximum: None }
    }

    /// NoPoSplat's rule: baseline 1, then relative to the first context view.
    pub fn noposplat() -> Self {
        let scale = Self::BaselineOne { minimum: BASELINE_MINIMUM, maximum: Some(1e10) };
        Self::Sequence { steps: vec![scale, Self::FirstViewRelative] }
    }

    /// YoNoSplat's rule: largest pairwise distance 1, then relative to the first context view.
    pub fn yonosplat() -> Self {
        let scale = Self::MaxPairwise { minimum: BASELINE_MINIMUM, maximum: Some(100.0) };
        Self::Sequence { steps: vec![scale, Self::FirstViewRelative] }
    }

    /// The mean camera with one of the published scales.
    pub const fn mean_camera(scale: MeanCameraScale) -> Self {
        Self::MeanCamera { scale, scene_scale: 1.0 }
    }

    /// The rule's name as in a file, with what changes lengths; for a sequence, the names of its steps. Rules of the same
    /// name transform a scene equally, unless one rejects it.
    pub fn name(&self) -> String {
        match self {
            Self::None => "none".to_owned(),
            Self::BaselineOne { .. } => BASELINE_ONE.to_owned(),
            Self::FirstViewRelative => "first-view-relative".to_owned(),
            Self::MaxPairwise { .. } => MAX_PAIRWISE.to_owned(),
            Self::MeanCamera { scale, scene_scale } if is_one(scene_scale) => format!("mean-camera ({})", scale.name()),
            Self::MeanCamera { scale, scene_scale } => {
                format!("mean-camera ({}, lengths / {scene_scale})", scale.name())
            }
            Self::Sequence { steps } => steps.iter().map(Self::name).collect::<Vec<_>>().join(", then "),
        }
    }
}

/// `distance` if it is in the accepted range.
fn accepted(rule: &'static str, distance: f64, minimum: f64, maximum: Option<f64>) -> Result<f64, CameraError> {
    let is_far_enough = distance >= minimum && distance <= maximum.unwrap_or(f64::MAX);
    // Never divide by zero, whatever the minimum.
    if is_far_enough && distance.recip().is_normal() {
        Ok(distance)
    } else {
        Err(CameraError::BaselineOutOfRange { rule, found: distance, minimum, maximum })
    }
}
