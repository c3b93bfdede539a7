use atsplat_numeric::Extremes;

use crate::{Camera, CameraError, CameraFromWorld, NormalizedIntrinsics, Spacing, Trajectory};

/// A smooth motion through key cameras, at the times 0, 1, 2, …: a [`Trajectory`] for the poses, a monotone
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
        let poses = keys.iter().map(|key| key.camera_from_world.inverse()).collect();
        Self::along(Trajectory::evenly_timed(poses)?, keys, false)
    }

    /// A closed spline through all cameras and back to the first.
    ///
    /// # Errors
    /// [`CameraError::TooFewPoses`] for fewer than two cameras, [`CameraError::DifferentLens`].
    pub fn closed(keys: Vec<Camera>) -> Result<Self, CameraError> {
        let poses = keys.iter().map(|key| key.camera_from_world.inverse()).collect();
        Self::along(Trajectory::closed(poses)?, keys, true)
    }

    fn along(trajectory: Trajectory, keys: Vec<Camera>, closed: bool) -> Result<Self, CameraError> {
        if let Some((first, rest)) = keys.split_first()
            && let Some(at) = rest.iter().position(|key| key.distortion != first.distortion)
        {
            return Err(CameraError::DifferentLens { position: at + 1 });
        }
        let around = keys.iter().chain(keys.first().filter(|_| closed));
        let intrinsics: Vec<[f64; 4]> = around.map(|key| numbers(&key.intrinsics)).collect();
        let slopes = slopes(&intrinsics, closed);
        Ok(Self { keys, intrinsics, slopes, trajectory, closed })
    }

    /// The camera at `time`, from 0 to the number of keys, minus one if the spline is open.
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
    /// [`CameraError::TooFewPoses`] for a count of zero, or more than one sample of a single camera.
    pub fn resampled(&self, count: usize, spacing: Spacing) -> Result<Vec<Camera>, CameraError> {
        let steps = if self.closed && count > 0 { count + 1 } else { count };
        let samples = self.trajectory.resampled(steps, spacing)?;
        let cameras = samples.times().iter().zip(samples.poses()).take(count);
        cameras.map(|(time, pose)| self.camera(*time, pose.inverse())).collect()
    }

    fn camera(&self, time: f64, camera_from_world: CameraFromWorld) -> Result<Camera, CameraError> {
        let (before, share) = (time.floor(), time - time.floor());
        let key = index(before);
        if share <= 0.0
            && let Some(camera) = self.keys.get(key).or_else(|| self.keys.first().filter(|_| self.closed))
        {
            return Ok(*camera);
        }
        let end = (self.intrinsics.len() - 1) as f64;
        let outside = CameraError::OutsideTrajectory { found: time, start: 0.0, end };
        let of = |list: &[[f64; 4]], at: usize| list.get(at).copied().ok_or_else(|| outside.clone());
        let (from, to) = (of(&self.intrinsics, key)?, of(&self.intrinsics, key + 1)?);
        let (start_slope, end_slope) = (of(&self.slopes, key)?, of(&self.slopes, key + 1)?);
        let mut mixed = [0.0; 4];
        for (at, value) in mixed.iter_mut().enumerate() {
            let step = to[at] - from[at];
            let bend = (start_slope[at] - step) * (1.0 - share) - (end_slope[at] - step) * share;
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

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a time on the spline, at least 0")]
const fn index(time: f64) -> usize {
    time as usize
}

/// Slopes for which the cubic between two keys is monotone: at each key the mean of the adjacent steps, 0 if they have
/// opposite signs, and at most three times the smaller.
fn slopes(values: &[[f64; 4]], closed: bool) -> Vec<[f64; 4]> {
    let steps: Vec<[f64; 4]> =
        values.windows(2).map(|pair| [0, 1, 2, 3].map(|number| pair[1][number] - pair[0][number])).collect();
    let across = |before: Option<&[f64; 4]>, after: Option<&[f64; 4]>| match (before, after) {
        (Some(before), Some(after)) => [0, 1, 2, 3].map(|number| {
            let (a, b) = (before[number], after[number]);
            let limit = 3.0 * a.abs().minimum_of(b.abs());
            if a * b > 0.0 { (0.5 * (a + b)).clamp(-limit, limit) } else { 0.0 }
        }),
        (Some(only), None) | (None, Some(only)) => *only,
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
