mod dolly;
mod orbit;
mod pivot;
mod spiral;
mod wobble;

use serde::{Deserialize, Serialize};

use crate::error::{finite, positive};
use crate::trajectory::{at_least, shares};
use crate::{CameraError, Interpolation, Spacing, Trajectory, WorldFromCamera};
pub use pivot::pivot_interpolation;

/// A camera path for a flythrough, around or between given views.
///
/// Distances are in units of the *baseline*, the distance between the first and the last view's
/// centres, as pixelSplat's videos measure their wobble; for a single view, or views that all stand in
/// one place, in scene units. Paths are built from the views' own axes, so moving the world moves the
/// path along.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "path", rename_all = "kebab-case", deny_unknown_fields)]
pub enum CameraPath {
    /// From the first view to the last, turning about the point where their optical axes come closest:
    /// pixelSplat's interpolation video (`src/visualization/camera_trajectory/interpolation.py`,
    /// eased in and out). See [`pivot_interpolation`].
    Interpolation,
    /// Twice the way from the first view to the last in either direction, five circles in the image
    /// plane on the way: pixelSplat's exaggerated video (`src/model/model_wrapper.py`,
    /// `t·5 − 2`, radius half a baseline).
    InterpolationWithWobble {
        /// Radius of the circles.
        #[serde(default = "half")]
        radius: f64,
    },
    /// The first view moved on a circle in its image plane that grows from nothing, orientation
    /// unchanged: pixelSplat's wobble video (`camera_trajectory/wobble.py`), radius a quarter baseline.
    Wobble {
        /// Radius at the end.
        #[serde(default = "quarter")]
        radius: f64,
    },
    /// The first view moved on an ellipsoidal spiral while it keeps looking at one point ahead:
    /// `render_path_spiral` of LLFF and of the original `NeRF` (`load_llff.py`; two turns, depth at half the rate).
    Spiral {
        /// Half-axes to the right, down and forward.
        #[serde(default = "spiral_radii")]
        radii: [f64; 3],
        /// Distance of the point looked at.
        #[serde(default = "two")]
        focus: f64,
    },
    /// A circle about the point `focus` ahead of the first view, around the view's own down axis, always
    /// looking at that point.
    Orbit {
        /// Distance of the point circled.
        #[serde(default = "two")]
        focus: f64,
        /// How far around, in degrees; positive moves the camera to its left first. 360 is a full
        /// circle, whose last frame is the first again.
        #[serde(default = "full_circle")]
        degrees: f64,
    },
    /// Straight along the first view's optical axis.
    Dolly {
        /// Distance travelled; negative backs off.
        #[serde(default = "one")]
        distance: f64,
    },
    /// A smooth spline through all views at constant speed along the path.
    ThroughViews,
}

const fn quarter() -> f64 {
    0.25
}
const fn half() -> f64 {
    0.5
}
const fn one() -> f64 {
    1.0
}
const fn two() -> f64 {
    2.0
}
const fn full_circle() -> f64 {
    360.0
}
const fn spiral_radii() -> [f64; 3] {
    [0.25, 0.25, 0.1]
}

impl CameraPath {
    /// `frames` poses along the path; one frame is its start.
    ///
    /// # Errors
    /// [`CameraError::TooFewPoses`] without views or frames, or where the path needs two views;
    /// [`CameraError::NonFinite`] or [`CameraError::NotPositive`] for a parameter out of range.
    pub fn poses(&self, views: &[WorldFromCamera], frames: usize) -> Result<Vec<WorldFromCamera>, CameraError> {
        at_least(1, frames, "frames of a camera path")?;
        let Some((first, last)) = views.first().zip(views.last()) else {
            return Err(CameraError::TooFewPoses { what: "camera path", expected: 1, found: 0 });
        };
        let baseline = first.centre().distance(last.centre());
        let unit = if baseline > 0.0 { baseline } else { 1.0 };
        let times: Vec<f64> = shares(frames).collect();
        match *self {
            Self::Interpolation => {
                at_least(2, views.len(), "interpolation between views")?;
                let eased: Vec<f64> = times.into_iter().map(eased).collect();
                Ok(pivot_interpolation(first, last, &eased))
            }
            Self::InterpolationWithWobble { radius } => {
                at_least(2, views.len(), "interpolation between views")?;
                let radius = finite("radius", radius)? * unit;
                let stretched: Vec<f64> = times.iter().map(|t| t * 5.0 - 2.0).collect();
                let base = pivot_interpolation(first, last, &stretched);
                Ok(base.iter().zip(times).map(|(view, t)| wobble::moved(view, radius, 5.0 * t)).collect())
            }
            Self::Wobble { radius } => {
                let radius = finite("radius", radius)? * unit;
                Ok(times.into_iter().map(|t| wobble::moved(first, radius * t, t)).collect())
            }
            Self::Spiral { radii, focus } => {
                for radius in radii {
                    finite("radii", radius)?;
                }
                let focus = positive("focus", focus)? * unit;
                Ok(times.into_iter().map(|t| spiral::moved(first, radii.map(|r| r * unit), focus, t)).collect())
            }
            Self::Orbit { focus, degrees } => {
                let focus = positive("focus", focus)? * unit;
                let angle = finite("degrees", degrees)?.to_radians();
                Ok(times.into_iter().map(|t| orbit::moved(first, focus, angle * t)).collect())
            }
            Self::Dolly { distance } => {
                let distance = finite("distance", distance)? * unit;
                Ok(times.into_iter().map(|t| dolly::moved(first, distance * t)).collect())
            }
            Self::ThroughViews => {
                let trajectory = Trajectory::evenly_timed(views.to_vec())?;
                let samples = trajectory.resampled(frames, Spacing::ArcLength, Interpolation::Spline)?;
                Ok(samples.poses().to_vec())
            }
        }
    }
}

/// Slow at both ends, fast in the middle: `(1 − cos πt) / 2`, as pixelSplat eases its videos.
pub fn eased(share: f64) -> f64 {
    0.5 * (1.0 - (std::f64::consts::PI * share).cos())
}

/// The path and back again without repeating its two ends, so that a video loops.
pub fn there_and_back(poses: &[WorldFromCamera]) -> Vec<WorldFromCamera> {
    let inner = poses.get(1..poses.len().saturating_sub(1)).unwrap_or_default();
    poses.iter().chain(inner.iter().rev()).copied().collect()
}

#[cfg(test)]
mod tests;
