mod arc_length;
mod segment;

use glam::DQuat;
use serde::{Deserialize, Serialize};

use crate::error::finite;
use crate::so3::quaternion_from_matrix;
use crate::{CameraError, WorldFromCamera};
use segment::Segment;

/// The spacing of samples of a resampled trajectory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Spacing {
    /// Even in time.
    #[default]
    Time,
    /// Even along the path of the camera centre, so that a pause gets no samples; if the centre never moves, even in time.
    ArcLength,
}

/// A cubic spline through camera poses at strictly increasing times, with continuous velocity and angular velocity (C¹). It
/// passes through every pose exactly, rotates the shorter way, and is equivariant to rigid motions of the world. For a
/// rotation by 180° a fixed rule chooses the direction: the axis, in the camera's frame, is on the side of (∛4, ∛2, 1). Only for
/// an axis that is perpendicular to that up to rounding does rounding choose.
///
/// At an inner pose the velocity is that of the parabola through it and its neighbours (Bessel tangents; Catmull–Rom for even
/// times), limited to three times that of the slower side, which avoids overshooting and preserves pauses; at the ends it is
/// the mean velocity to the adjacent pose. The centre follows the cubic, the rotation Shoemake's Bézier curve of quaternions
/// (SIGGRAPH 1985), by de Casteljau's construction with slerps, which is symmetric in time.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    times: Vec<f64>,
    poses: Vec<WorldFromCamera>,
    segments: Vec<Segment>,
}

impl Trajectory {
    /// A trajectory with poses at the given times, in any unit.
    ///
    /// # Errors
    /// [`CameraError::TooFewPoses`] without poses, [`CameraError::TimesMismatch`],
    /// [`CameraError::TimesNotIncreasing`], [`CameraError::NonFinite`] for a time, or a time from the first to the last
    /// pose, that is not finite.
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
        if let (Some(first), Some(last)) = (times.first(), times.last()) {
            finite("time from the first to the last pose", last - first)?;
        }
        // Adding zero converts −0 to 0, so that times are also ordered by `total_cmp`.
        let times: Vec<f64> = times.into_iter().map(|time| time + 0.0).collect();
        let segments = segment::through(&times, &poses);
        Ok(Self { times, poses, segments })
    }

    /// A trajectory with poses at the times 0, 1, 2, …
    ///
    /// # Errors
    /// [`CameraError::TooFewPoses`] without poses.
    pub fn evenly_timed(poses: Vec<WorldFromCamera>) -> Result<Self, CameraError> {
        Self::new((0..poses.len()).map(|index| index as f64).collect(), poses)
    }

    /// A closed trajectory with poses at the times 0, 1, 2, … and the first pose again at the end, with continuous
    /// velocity also there.
    ///
    /// # Errors
    /// [`CameraError::TooFewPoses`] for fewer than two poses.
    pub fn closed(mut poses: Vec<WorldFromCamera>) -> Result<Self, CameraError> {
        at_least(2, poses.len(), "closed trajectory")?;
        let count = poses.len();
        let times: Vec<f64> = (0..=count).map(|index| index as f64).collect();
        // Tangents depend on one pose on either side.
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

    /// The pose at `time`; at the time of a stored pose, that pose bit for bit. Between poses the rotation is orthonormal
    /// even if stored poses are rounded.
    ///
    /// # Errors
    /// [`CameraError::OutsideTrajectory`] for a time before the first or after the last pose, or NaN.
    pub fn at(&self, time: f64) -> Result<WorldFromCamera, CameraError> {
        let found = match self.times.binary_search_by(|known| known.total_cmp(&(time + 0.0))) {
            Ok(index) => self.poses.get(index).copied(),
            Err(after) => {
                let segment = after.checked_sub(1).and_then(|index| self.segments.get(index));
                segment.map(|segment| segment.pose_at(time))
            }
        };
        found.ok_or_else(|| self.outside(time))
    }

    /// `count` poses from the first to the last, inclusive, evenly spaced in time or along the path. A single sample is
    /// the first pose.
    ///
    /// # Errors
    /// [`CameraError::TooFewPoses`] for a count of zero, or more than one sample of a single pose; [`CameraError::NonFinite`] for
    /// samples along a path whose length is not finite.
    pub fn resampled(&self, count: usize, spacing: Spacing) -> Result<Self, CameraError> {
        at_least(1, count, "samples of a trajectory")?;
        at_least(count.clamp(1, 2), self.poses.len(), "trajectory to sample")?;
        let times = match spacing {
            Spacing::Time => self.even_times(count),
            Spacing::ArcLength => {
                let end = self.span().1;
                arc_length::even_times(&self.segments, end, count)?.unwrap_or_else(|| self.even_times(count))
            }
        };
        let poses = times.iter().map(|time| self.at(*time)).collect::<Result<_, _>>()?;
        Self::new(times, poses)
    }

    /// Length of the path of the camera centre, in scene units; infinite if it overflows, NaN if a pose is not known.
    pub fn arc_length(&self) -> f64 {
        arc_length::total(&self.segments)
    }

    fn even_times(&self, count: usize) -> Vec<f64> {
        let (start, end) = self.span();
        shares(count).map(|share| if share >= 1.0 { end } else { start + share * (end - start) }).collect()
    }

    fn outside(&self, found: f64) -> CameraError {
        let (start, end) = self.span();
        CameraError::OutsideTrajectory { found, start, end }
    }

    /// Times of the first and last pose.
    fn span(&self) -> (f64, f64) {
        let span = self.times.first().copied().zip(self.times.last().copied());
        span.unwrap_or_else(|| unreachable!("a trajectory has at least one pose"))
    }
}

/// `count` evenly spaced numbers from 0 to 1, inclusive.
pub(crate) fn shares(count: usize) -> impl Iterator<Item = f64> {
    let last = count.saturating_sub(1);
    (0..count).map(move |index| if index == 0 { 0.0 } else { index as f64 / last as f64 })
}

pub(crate) fn at_least(expected: usize, found: usize, what: &'static str) -> Result<(), CameraError> {
    if found >= expected { Ok(()) } else { Err(CameraError::TooFewPoses { what, expected, found }) }
}

/// The unit quaternion of the rotation nearest to a pose's.
fn quaternion(pose: &WorldFromCamera) -> DQuat {
    quaternion_from_matrix(pose.rotation())
}

#[cfg(test)]
mod tests;
