use atsplat_numeric::Extremes;
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use super::{Fallback, Step};
use crate::axes::rotation_from_forward_and_down;
use crate::error::positive;
use crate::{CameraError, CentreSpread, Similarity, WorldFromCamera};

/// Means shorter than this count as cancelled. One rounding of a pose rotates the mean axes by about 2e-16 over their
/// length, which keeps the result within 1e-12.
const CANCELLED: f64 = 1e-2;
/// sin 30°: if an axis is closer than this to forward, the next one is at least 60° away.
const AXIS_SEPARATION: f64 = 0.5;
/// LVSM's `scene_scale_factor`.
const LVSM_MARGIN: f64 = 1.35;

/// How lengths are scaled in the mean camera's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeanCameraScale {
    /// The largest absolute coordinate of a normalised context centre becomes 1: Long-LRM
    /// `data/dataset.py:192-205`, iLRM's branch `wide`.
    #[default]
    LongLrm,
    /// Divides by the largest absolute coordinate of the *original* context centres: iLRM's branch `main`
    /// (`dataset_re10k.py:163,176-180`). The result depends on the dataset's origin.
    IlrmMain,
    /// The mean is taken over context *and* target views, and 1.35 times the largest absolute
    /// coordinate of all their normalised centres becomes 1: LVSM `data/dataset_scene.py:97-131`.
    Lvsm,
    /// Lengths are unchanged.
    None,
}

impl MeanCameraScale {
    /// The name as in a file.
    pub const fn name(self) -> &'static str {
        match self {
            Self::LongLrm => "long-lrm",
            Self::IlrmMain => "ilrm-main",
            Self::Lvsm => "lvsm",
            Self::None => "none",
        }
    }
}

/// `first` is the first of `context`.
pub(super) fn step(
    first: &WorldFromCamera,
    context: &[WorldFromCamera],
    targets: &[WorldFromCamera],
    scale: MeanCameraScale,
    scene_scale: f64,
) -> Result<Step, CameraError> {
    let scene_scale = positive("scene_scale", scene_scale)?;
    let others = if scale == MeanCameraScale::Lvsm { targets } else { &[] };
    let views = || context.iter().chain(others);

    let mut fallbacks = Vec::new();
    if views().count() == 1 {
        fallbacks.push(Fallback::SingleView);
    }
    let mean_camera = mean_rotation(first, views, &mut fallbacks);
    let new_from_old = Similarity { rotation: mean_camera.transpose(), origin: mean_centre(first, views), scale: 1.0 };

    let largest = |points: &mut dyn Iterator<Item = DVec3>| {
        points.fold(0.0f64, |largest, point| largest.maximum_of(point.abs().max_element()))
    };
    let original = largest(&mut views().map(WorldFromCamera::centre));
    let normalised = largest(&mut views().map(|view| new_from_old.new_from_old(view.centre())));
    let spread = CentreSpread::of(views());
    let coincide = spread == CentreSpread::Coincident;
    let factor = match scale {
        MeanCameraScale::None => 1.0,
        MeanCameraScale::IlrmMain if original > 0.0 => original.recip(),
        MeanCameraScale::LongLrm if !coincide => normalised.recip(),
        MeanCameraScale::Lvsm if !coincide => (LVSM_MARGIN * normalised).recip(),
        MeanCameraScale::IlrmMain | MeanCameraScale::LongLrm | MeanCameraScale::Lvsm => {
            fallbacks.push(Fallback::CoincidentCentres);
            1.0
        }
    };
    if spread == CentreSpread::Close && matches!(scale, MeanCameraScale::LongLrm | MeanCameraScale::Lvsm) {
        fallbacks.push(Fallback::CloseCentres);
    }
    let scale = positive("pose scale", factor / scene_scale)?;
    Ok(Step { new_from_old: Similarity { scale, ..new_from_old }, near_far_multiplier: 1.0, fallbacks })
}

/// The mean of offsets from the first centre, which avoids cancellation in a world far from its origin.
fn mean_centre<'a, I>(first: &WorldFromCamera, views: impl Fn() -> I) -> DVec3
where
    I: Iterator<Item = &'a WorldFromCamera>,
{
    first.centre() + mean(views().map(|view| view.centre() - first.centre()))
}

/// Axes of the mean camera as columns. LVSM defines them as `r = normalize(m_y × f)`, `d = f × r`, which are the same.
fn mean_rotation<'a, I>(first: &WorldFromCamera, views: impl Fn() -> I, fallbacks: &mut Vec<Fallback>) -> DMat3
where
    I: Iterator<Item = &'a WorldFromCamera>,
{
    let mean_forward = mean(views().map(WorldFromCamera::forward));
    let mean_down = mean(views().map(WorldFromCamera::down));
    let length = mean_forward.length();
    let (forward, certainty) = if length >= CANCELLED {
        (mean_forward, length)
    } else {
        fallbacks.push(Fallback::ForwardsCancel);
        (first.forward(), 1.0)
    };
    // The forward axis has an error of a rounding over `certainty`, which is amplified if the orthogonal part of the
    // down axis is short: the threshold applies to their product.
    if let Some(rotation) = rotation_from_forward_and_down(forward, mean_down, CANCELLED / certainty) {
        return rotation;
    }
    fallbacks.push(Fallback::DownsCancel);
    if let Some(rotation) = rotation_from_forward_and_down(forward, first.down(), AXIS_SEPARATION) {
        return rotation;
    }
    fallbacks.push(Fallback::FirstDownAlongForward);
    let unit = forward.normalize();
    let rotation = rotation_from_forward_and_down(forward, unit.cross(first.right()), 0.0);
    rotation.unwrap_or_else(|| unreachable!("the right axis is not parallel to forward, as the down axis is"))
}

fn mean(vectors: impl Iterator<Item = DVec3>) -> DVec3 {
    let (sum, count) = vectors.fold((DVec3::ZERO, 0.0), |(sum, count), vector| (sum + vector, count + 1.0));
    sum / count
}
