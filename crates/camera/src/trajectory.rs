mod arc_length;
mod segment;

use glam::DQuat;
use serde::{Deserialize, Serialize};

use crate::error::finite;
use crate::so3::quaternion_from_matrix;
use crate::{CameraError, WorldFromCamera};
use segment::Segment;

/// How a camera moves between two poses. Both kinds pass through every pose exactly, turn the shorter
/// way, and give the same motion however the world is moved. A half turn, which has no shorter way,
/// turns about a fixed choice of its two axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// The geodesic of SO(3) × ℝ³: the centre moves in a straight line at constant speed, the rotation
    /// turns about one axis at constant rate ("slerp"). Velocity jumps at the poses.
    Geodesic,
    /// Cubic splines through all poses, with continuous velocity and angular velocity (C¹). At a pose
    /// between two others the velocity is that of the parabola through the three (Bessel's tangents;
    /// Catmull–Rom's where times are even), but at most three times that of the slower side, so that
    /// nothing overshoots and a pause is a pause; at the ends it is the geodesic's. The centre follows the
    /// ordinary cubic, the rotation Shoemake's Bézier curve of quaternions (SIGGRAPH 1985), by de
    /// Casteljau's construction with slerps, which is the same forwards and backwards in time.
    #[default]
    Spline,
}

/// What is even between the samples of a resampled trajectory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Spacing {
    /// Time.
    #[default]
    Time,
    /// The length of the path that the centre takes. A pause takes no samples; where the centre never
    /// moves, time is even instead.
    ArcLength,
}

/// Camera poses at strictly increasing times, with a motion between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    times: Vec<f64>,
    poses: Vec<WorldFromCamera>,
    segments: Vec<Segment>,
}

impl Trajectory {
    /// Poses at the given times, in any unit.
    ///
    /// # Errors
    /// [`CameraError::TooFewPoses`] without poses, [`CameraError::TimesMismatch`],
    /// [`CameraError::TimesNotIncreasing`], [`CameraError::NonFinite`] for a time that is not finite.
    pub fn new(times: Vec<f64>, poses: Vec<WorldFromCamera>) -> Result<Self, CameraError> {
        if times.len() != poses.len() {
            return Err(CameraError::TimesMismatch { times: times.len(), poses: poses.len() });
        }
        at_least(1, poses.len(), "trajectory")?;
        for time in &times {
            finite("time", *time)?;
        }
        for (index, pair) in times.windows(2).enumerate() {
            if let [previous, found] = *pair
                && !(found > previous && (found - previous).recip().is_finite())
            {
                return Err(CameraError::TimesNotIncreasing { index: index + 1, previous, found });
            }
        }
        // Adding zero turns −0 into 0, so that the order of times is also their total order.
        let times: Vec<f64> = times.into_iter().map(|time| time + 0.0).collect();
        let segments = segment::through(&times, &poses);
        Ok(Self { times, poses, segments })
    }

    /// Poses at the times 0, 1, 2, …
    ///
    /// # Errors
    /// [`CameraError::TooFewPoses`] without poses.
    pub fn evenly_timed(poses: Vec<WorldFromCamera>) -> Result<Self, CameraError> {
        Self::new((0..poses.len()).map(|index| index as f64).collect(), poses)
    }

    /// A loop: poses at the times 0, 1, 2, … and the first of them again at the end, where the velocity of
    /// [`Interpolation::Spline`] is continuous as everywhere.
    ///
    /// # Errors
    /// [`CameraError::TooFewPoses`] for fewer than two poses.
    pub fn closed(mut poses: Vec<WorldFromCamera>) -> Result<Self, CameraError> {
        at_least(2, poses.len(), "closed trajectory")?;
        let count = poses.len();
        let times: Vec<f64> = (0..=count).map(|index| index as f64).collect();
        // Tangents look one pose to either side.
        let around: Vec<WorldFromCamera> = poses.iter().copied().cycle().skip(count - 1).take(count + 3).collect();
        let around_times: Vec<f64> = (0..count + 3).map(|index| index as f64 - 1.0).collect();
        let segments = segment::through(&around_times, &around).into_iter().skip(1).take(count).collect();
        poses.extend(poses.first().copied());
        Ok(Self { times, poses, segments })
    }

    /// Times of the poses, strictly increasing.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// The poses.
    pub fn poses(&self) -> &[WorldFromCamera] {
        &self.poses
    }

    /// The pose at `time`; at the time of a stored pose, that pose bit for bit. Between poses the
    /// rotation is orthonormal even where stored poses are rounded.
    ///
    /// # Errors
    /// [`CameraError::OutsideTrajectory`] for a time before the first or after the last pose, or NaN.
    pub fn at(&self, time: f64, interpolation: Interpolation) -> Result<WorldFromCamera, CameraError> {
        let found = match self.times.binary_search_by(|known| known.total_cmp(&(time + 0.0))) {
            Ok(index) => self.poses.get(index).copied(),
            Err(after) => {
                let segment = after.checked_sub(1).and_then(|index| self.segments.get(index));
                segment.map(|segment| segment.pose_at(time, interpolation))
            }
        };
        found.ok_or_else(|| self.outside(time))
    }

    /// The poses at the given times.
    ///
    /// # Errors
    /// As [`Self::at`] and [`Self::new`].
    pub fn resampled_at(&self, times: Vec<f64>, interpolation: Interpolation) -> Result<Self, CameraError> {
        let poses = times.iter().map(|time| self.at(*time, interpolation)).collect::<Result<_, _>>()?;
        Self::new(times, poses)
    }

    /// `count` poses from the first to the last, both included, evenly spaced in time or along the path.
    /// One sample is the first pose.
    ///
    /// # Errors
    /// [`CameraError::TooFewPoses`] for a count of zero, or more than one sample of a single pose.
    pub fn resampled(&self, count: usize, spacing: Spacing, interpolation: Interpolation) -> Result<Self, CameraError> {
        at_least(1, count, "samples of a trajectory")?;
        at_least(count.clamp(1, 2), self.poses.len(), "trajectory to sample")?;
        let times = match spacing {
            Spacing::Time => self.even_times(count),
            Spacing::ArcLength => {
                arc_length::even_times(&self.segments, count, interpolation).unwrap_or_else(|| self.even_times(count))
            }
        };
        self.resampled_at(times, interpolation)
    }

    /// Length of the path that the centre takes, in scene units.
    pub fn arc_length(&self, interpolation: Interpolation) -> f64 {
        arc_length::total(&self.segments, interpolation)
    }

    fn even_times(&self, count: usize) -> Vec<f64> {
        let (Some(start), Some(end)) = (self.times.first(), self.times.last()) else { return Vec::new() };
        shares(count).map(|share| if share >= 1.0 { *end } else { start + share * (end - start) }).collect()
    }

    fn outside(&self, found: f64) -> CameraError {
        let end = |time: Option<&f64>| time.copied().unwrap_or(f64::NAN);
        CameraError::OutsideTrajectory { found, start: end(self.times.first()), end: end(self.times.last()) }
    }
}

/// `count` numbers from 0 to 1, both included.
pub(crate) fn shares(count: usize) -> impl Iterator<Item = f64> {
    let last = count.saturating_sub(1);
    (0..count).map(move |index| if index == 0 { 0.0 } else { index as f64 / last as f64 })
}

pub(crate) fn at_least(expected: usize, found: usize, what: &'static str) -> Result<(), CameraError> {
    if found >= expected { Ok(()) } else { Err(CameraError::TooFewPoses { what, expected, found }) }
}

/// Rotation of a pose as the unit quaternion of the nearest true rotation.
fn quaternion(pose: &WorldFromCamera) -> DQuat {
    quaternion_from_matrix(pose.rotation())
}

#[cfg(test)]
mod tests;
