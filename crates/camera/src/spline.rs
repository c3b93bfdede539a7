use atsplat_numeric::Extremes;

use crate::{Camera, CameraError, CameraFromWorld, NormalizedIntrinsics, Spacing, Trajectory, WorldFromCamera};

/// A smooth motion through key cameras, at the times 0, 1, 2, … or at given ones: a [`Trajectory`] for the poses, a monotone
/// cubic (Fritsch and Carlson 1980) for each intrinsic, which is also C¹ and stays between the two adjacent keys. Key
/// cameras are reproduced bit for bit.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraSpline {
    keys: Vec<Camera>,
    /// Of the keys, followed by those of the first key if the spline is closed.
    intrinsics: Vec<[f64; 4]>,
    /// Derivatives of `intrinsics` with respect to time.
    slopes: Vec<[f64; 4]>,
    trajectory: Trajectory,
    closed: bool,
}

impl CameraSpline {
    /// A spline from the first camera to the last.
    ///
    /// # Errors
    /// [`CameraError::TooFewPoses`] without cameras, [`CameraError::DifferentLens`] if their lenses differ.
    pub fn open(keys: Vec<Camera>) -> Result<Self, CameraError> {
        Self::along(Trajectory::evenly_timed(poses(&keys))?, keys, false)
    }

    /// A spline from the first camera to the last that is at each of them at a given time, in any unit.
    ///
    /// # Errors
    /// As [`Trajectory::new`], and [`CameraError::DifferentLens`].
    pub fn timed(times: Vec<f64>, keys: Vec<Camera>) -> Result<Self, CameraError> {
        Self::along(Trajectory::new(times, poses(&keys))?, keys, false)
    }

    /// A closed spline through all cameras and back to the first.
    ///
    /// # Errors
    /// [`CameraError::TooFewPoses`] for fewer than two cameras, [`CameraError::DifferentLens`].
    pub fn closed(keys: Vec<Camera>) -> Result<Self, CameraError> {
        Self::along(Trajectory::closed(poses(&keys))?, keys, true)
    }

    fn along(trajectory: Trajectory, keys: Vec<Camera>, closed: bool) -> Result<Self, CameraError> {
        if let Some((first, rest)) = keys.split_first()
            && let Some(at) = rest.iter().position(|key| key.distortion != first.distortion)
        {
            return Err(CameraError::DifferentLens { position: at + 1 });
        }
        let around = keys.iter().chain(keys.first().filter(|_| closed));
        let intrinsics: Vec<[f64; 4]> = around.map(|key| numbers(&key.intrinsics)).collect();
        let slopes = slopes(trajectory.times(), &intrinsics, closed);
        Ok(Self { keys, intrinsics, slopes, trajectory, closed })
    }

    /// The camera at `time`: at a given one, or from 0 to the number of keys, minus one if the spline is open.
    ///
    /// # Errors
    /// [`CameraError::OutsideTrajectory`].
    pub fn at(&self, time: f64) -> Result<Camera, CameraError> {
        let pose = self.trajectory.at(time)?;
        self.camera(time, pose.inverse())
    }

    /// `count` cameras, evenly spaced in time or along the path. An open spline ends with its last key, a closed one a
    /// step before its first key, so that it can be repeated.
    ///
    /// # Errors
    /// As [`Trajectory::resampled`].
    pub fn resampled(&self, count: usize, spacing: Spacing) -> Result<Vec<Camera>, CameraError> {
        let steps = if self.closed && count > 0 { count + 1 } else { count };
        let samples = self.trajectory.resampled(steps, spacing)?;
        let cameras = samples.times().iter().zip(samples.poses()).take(count);
        cameras.map(|(time, pose)| self.camera(*time, pose.inverse())).collect()
    }

    fn camera(&self, time: f64, camera_from_world: CameraFromWorld) -> Result<Camera, CameraError> {
        let times = self.trajectory.times();
        let [start, end] = [times.first(), times.last()].map(|time| time.copied().unwrap_or(f64::NAN));
        let outside = || CameraError::OutsideTrajectory { found: time, start, end };
        let key = times.partition_point(|known| *known <= time).checked_sub(1).ok_or_else(outside)?;
        let since = time - times.get(key).ok_or_else(outside)?;
        if since <= 0.0
            && let Some(camera) = self.keys.get(key).or_else(|| self.keys.first().filter(|_| self.closed))
        {
            return Ok(*camera);
        }
        let duration = times.get(key + 1).zip(times.get(key)).map(|(to, from)| to - from).ok_or_else(outside)?;
        let share = since / duration;
        let of = |list: &[[f64; 4]], at: usize| list.get(at).copied().ok_or_else(outside);
        let (from, to) = (of(&self.intrinsics, key)?, of(&self.intrinsics, key + 1)?);
        let (start_slope, end_slope) = (of(&self.slopes, key)?, of(&self.slopes, key + 1)?);
        let mut mixed = [0.0; 4];
        for (at, value) in mixed.iter_mut().enumerate() {
            let step = to[at] - from[at];
            let bend = (start_slope[at] * duration - step) * (1.0 - share) - (end_slope[at] * duration - step) * share;
            *value = from[at] + step * share + bend * share * (1.0 - share);
        }
        let [fx, fy, cx, cy] = mixed;
        let intrinsics = NormalizedIntrinsics::new(fx, fy, cx, cy)?;
        let first = self.keys.first().unwrap_or_else(|| unreachable!("a spline has keys"));
        Ok(Camera { camera_from_world, intrinsics, distortion: first.distortion })
    }
}

const fn numbers(intrinsics: &NormalizedIntrinsics) -> [f64; 4] {
    [intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy]
}

fn poses(keys: &[Camera]) -> Vec<WorldFromCamera> {
    keys.iter().map(|key| key.camera_from_world.inverse()).collect()
}

/// Duration from one key to the next, and the mean rates of change of the intrinsics.
struct Step {
    duration: f64,
    rates: [f64; 4],
}

/// Slopes for which the cubic between two keys is monotone: at each key that of the parabola through it and its neighbours
/// (for even times, the mean of the adjacent rates), 0 if these have opposite signs, and at most three times the smaller.
fn slopes(times: &[f64], values: &[[f64; 4]], closed: bool) -> Vec<[f64; 4]> {
    let step = |(times, pair): (&[f64], &[[f64; 4]])| {
        let duration = times[1] - times[0];
        Step { duration, rates: [0, 1, 2, 3].map(|number| (pair[1][number] - pair[0][number]) / duration) }
    };
    let steps: Vec<Step> = times.windows(2).zip(values.windows(2)).map(step).collect();
    let across = |before: Option<&Step>, after: Option<&Step>| match (before, after) {
        (Some(before), Some(after)) => [0, 1, 2, 3].map(|number| {
            let (a, b) = (before.rates[number], after.rates[number]);
            let weight = after.duration / (before.duration + after.duration);
            let limit = 3.0 * a.abs().minimum_of(b.abs());
            if a * b > 0.0 { (weight * a + (1.0 - weight) * b).clamp(-limit, limit) } else { 0.0 }
        }),
        (Some(only), None) | (None, Some(only)) => only.rates,
        (None, None) => [0.0; 4],
    };
    let last = values.len().saturating_sub(1);
    let slope = |at: usize| match at {
        _ if closed && (at == 0 || at == last) => across(steps.last(), steps.first()),
        0 => across(None, steps.first()),
        _ => across(steps.get(at - 1), steps.get(at)),
    };
    (0..values.len()).map(slope).collect()
}

#[cfg(test)]
mod tests;
