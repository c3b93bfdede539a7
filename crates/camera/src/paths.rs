mod pivot;

use std::f64::consts::TAU;

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::axes::rotation_from_forward_and_down;
use crate::error::{finite, positive};
use crate::trajectory::{at_least, shares};
use crate::{CameraError, Interpolation, Spacing, Trajectory, WorldFromCamera};
pub use pivot::pivot_interpolation;

/// A camera path for a flythrough, around or between given views.
///
/// Distances are in units of the *baseline*, the distance between the centres of the first and last view, as in
/// pixelSplat's videos; if it is zero, in scene units. Paths are defined by the views' own axes, so they move with the
/// world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "path", rename_all = "kebab-case", deny_unknown_fields)]
pub enum CameraPath {
    /// From the first view to the last, rotating about the point where their optical axes are closest: pixelSplat's
    /// interpolation video (`src/visualization/camera_trajectory/interpolation.py`, eased in and out). See
    /// [`pivot_interpolation`].
    Interpolation,
    /// Extrapolates the way from the first view to the last by twice its length in either direction, with five circles
    /// in the image plane: pixelSplat's exaggerated video (`src/model/model_wrapper.py`, `t·5 − 2`, radius half a
    /// baseline).
    InterpolationWithWobble {
        /// Radius of the circles.
        #[serde(default = "half")]
        radius: f64,
    },
    /// Moves the first view on a circle of growing radius in its image plane, without rotation: pixelSplat's wobble video
    /// (`camera_trajectory/wobble.py`), radius a quarter baseline.
    Wobble {
        /// Radius at the end.
        #[serde(default = "quarter")]
        radius: f64,
    },
    /// Moves the first view on an ellipsoidal spiral, always looking at one point ahead:
    /// `render_path_spiral` of LLFF and of the original `NeRF` (`load_llff.py`; two turns, depth at half the rate).
    Spiral {
        /// Half-axes to the right, down and forward.
        #[serde(default = "spiral_radii")]
        radii: [f64; 3],
        /// Distance of that point.
        #[serde(default = "two")]
        focus: f64,
    },
    /// A circle about the point `focus` ahead of the first view, around the view's own down axis, always
    /// looking at that point.
    Orbit {
        /// Distance of that point.
        #[serde(default = "two")]
        focus: f64,
        /// Angle of the arc in degrees; positive moves the camera to its left first. 360 is a full circle, whose last
        /// frame equals the first.
        #[serde(default = "full_circle")]
        degrees: f64,
    },
    /// Straight along the first view's optical axis.
    Dolly {
        /// Distance travelled; negative is backwards.
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
    /// `frames` poses along the path; a single frame is its start.
    ///
    /// # Errors
    /// [`CameraError::TooFewPoses`] without views or frames, or for a single view if the path needs two;
    /// [`CameraError::NonFinite`] or [`CameraError::NotPositive`] for a parameter out of range.
    pub fn poses(&self, views: &[WorldFromCamera], frames: usize) -> Result<Vec<WorldFromCamera>, CameraError> {
        at_least(1, frames, "frames of a camera path")?;
        let Some((first, last)) = views.first().zip(views.last()) else {
            return Err(CameraError::TooFewPoses { what: "views of a camera path", expected: 1, found: 0 });
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
                Ok(base.iter().zip(times).map(|(view, t)| wobble(view, radius, 5.0 * t)).collect())
            }
            Self::Wobble { radius } => {
                let radius = finite("radius", radius)? * unit;
                Ok(times.into_iter().map(|t| wobble(first, radius * t, t)).collect())
            }
            Self::Spiral { radii, focus } => {
                for radius in radii {
                    finite("radii", radius)?;
                }
                let focus = positive("focus", focus)? * unit;
                Ok(times.into_iter().map(|t| spiral(first, radii.map(|r| r * unit), focus, t)).collect())
            }
            Self::Orbit { focus, degrees } => {
                let focus = positive("focus", focus)? * unit;
                let angle = finite("degrees", degrees)?.to_radians();
                Ok(times.into_iter().map(|t| orbit(first, focus, angle * t)).collect())
            }
            Self::Dolly { distance } => {
                let distance = finite("distance", distance)? * unit;
                Ok(times.into_iter().map(|t| translated(first, DVec3::Z * (distance * t))).collect())
            }
            Self::ThroughViews => {
                let trajectory = Trajectory::evenly_timed(views.to_vec())?;
                let samples = trajectory.resampled(frames, Spacing::ArcLength, Interpolation::Spline)?;
                Ok(samples.poses().to_vec())
            }
        }
    }
}

/// `view` moved by `offset` in its own axes.
fn translated(view: &WorldFromCamera, offset: DVec3) -> WorldFromCamera {
    WorldFromCamera::from_parts(view.rotation(), view.transform_point(offset))
}

/// `view` moved in its image plane by `radius`, `turns` from straight up, clockwise in its picture.
fn wobble(view: &WorldFromCamera, radius: f64, turns: f64) -> WorldFromCamera {
    let angle = TAU * turns;
    translated(view, DVec3::new(angle.sin(), -angle.cos(), 0.0) * radius)
}

/// `view` rotated by `angle` radians about its down axis through the point `focus` ahead.
fn orbit(view: &WorldFromCamera, focus: f64, angle: f64) -> WorldFromCamera {
    let rotation = DMat3::from_rotation_y(angle);
    let pivot = DVec3::new(0.0, 0.0, focus);
    WorldFromCamera::from_parts(view.rotation() * rotation, view.transform_point(pivot - rotation * pivot))
}

/// `view` moved to the point `t` of the spiral, looking at the point `focus` ahead of its original position.
fn spiral(view: &WorldFromCamera, radii: [f64; 3], focus: f64, t: f64) -> WorldFromCamera {
    const TURNS: f64 = 2.0;
    /// `zrate` of `load_llff.py`.
    const DEPTH_RATE: f64 = 0.5;
    let angle = TAU * TURNS * t;
    let offset = DVec3::new(angle.cos(), angle.sin(), (angle * DEPTH_RATE).sin()) * DVec3::from_array(radii);
    let forward = DVec3::new(0.0, 0.0, focus) - offset;
    // Directly above or below the focus, the view's own axes are used.
    let rotation = rotation_from_forward_and_down(forward, DVec3::Y, 0.0).unwrap_or(DMat3::IDENTITY);
    WorldFromCamera::from_parts(view.rotation() * rotation, view.transform_point(offset))
}

/// Ease in and out: `(1 − cos πt) / 2`, as in pixelSplat's videos.
pub fn eased(share: f64) -> f64 {
    0.5 * (1.0 - (std::f64::consts::PI * share).cos())
}

/// The path forwards and backwards without repeating its two ends, for a looping video.
pub fn there_and_back(poses: &[WorldFromCamera]) -> Vec<WorldFromCamera> {
    let inner = poses.get(1..poses.len().saturating_sub(1)).unwrap_or_default();
    poses.iter().chain(inner.iter().rev()).copied().collect()
}

#[cfg(test)]
mod tests;
