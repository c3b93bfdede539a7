use atsplat_camera::{Camera, WorldFromCamera};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::{RoomsError, Shot};

/// Camera motion of one clip, as measured by `data/measure_motion.py`. Lengths are in the clip's own units: for real clips
/// those of structure from motion, whose scale differs between clips.
///
/// Speeds are path length over time, so that subsampling frames does not change them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct ClipMotion {
    /// The clip's name.
    pub clip: String,
    /// Number of frames.
    pub frames: usize,
    /// Seconds from the first frame to the last; `None` for a clip without times.
    pub seconds: Option<f64>,
    /// Focal length of the first frame over the image's width.
    pub fx: f64,
    /// Focal length of the first frame over the image's height.
    pub fy: f64,
    /// Units per second along the path through positions a quarter of a second apart: closer ones would measure the noise
    /// of structure from motion. `None` for a clip without times.
    pub speed: Option<f64>,
    /// Rotation between the frames nearest to half seconds; `None` for a clip without times.
    pub turn_degrees_per_second: Option<f64>,
    /// Distance between the ends over length of the path, in [0, 1]; `None` for a static camera.
    pub straightness: Option<f64>,
    /// Angle between the vector from the first position to the last and the mean optical axis, in [0, 180]; `None` for a
    /// camera that ends where it started.
    pub travel_to_axis_degrees: Option<f64>,
    /// Mean distance of positions 45 frames of 1/30 s apart; `None` for a shorter clip.
    pub baseline_45: Option<f64>,
    /// The same for 90 frames.
    pub baseline_90: Option<f64>,
    /// The same for 135 frames.
    pub baseline_135: Option<f64>,
}

/// Seconds between the positions of a path, between directions, and between the starts of baselines.
const PATH_STEP: f64 = 0.25;
const TURN_STEP: f64 = 0.5;
const BASELINE_STEP: f64 = 0.1;

/// Eleven days: no clip is longer, and the path of one would not fit into memory.
const LONGEST: f64 = 1e6;

impl ClipMotion {
    /// Measures cameras with their times in microseconds, in any order. `None` if they last less than half a second,
    /// or more than a million.
    pub fn of(clip: &str, cameras: impl IntoIterator<Item = (i64, Camera)>) -> Option<Self> {
        let mut cameras: Vec<(i64, Camera)> = cameras.into_iter().collect();
        cameras.sort_by_key(|(micros, _)| *micros);
        let (first, k) = cameras.first().map(|(micros, camera)| (*micros, camera.intrinsics))?;
        let track = Track {
            seconds: cameras.iter().map(|(micros, _)| micros.abs_diff(first) as f64 / 1e6).collect(),
            poses: cameras.iter().map(|(_, camera)| camera.camera_from_world.inverse()).collect(),
        };
        let seconds = track.seconds.last().copied().filter(|seconds| (TURN_STEP..=LONGEST).contains(seconds))?;

        let times = arange(seconds, PATH_STEP);
        let positions: Vec<DVec3> = times.iter().map(|time| track.position(*time)).collect();
        let arc: f64 = positions.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
        let near: Vec<usize> = arange(seconds, TURN_STEP).iter().map(|time| track.nearest(*time)).collect();
        let turned: f64 =
            near.windows(2).map(|pair| degrees_between(&track.poses[pair[0]], &track.poses[pair[1]])).sum();
        let chord = |path: &[DVec3]| path.last().zip(path.first()).map(|(last, first)| *last - *first);
        let between_ends = chord(&positions)?.length();
        let centres: Vec<DVec3> = track.poses.iter().map(WorldFromCamera::centre).collect();
        let travelled = chord(&centres)?;
        let axis: DVec3 = track.poses.iter().map(WorldFromCamera::forward).sum();
        let cosine = travelled.dot(axis) / (travelled.length() * axis.length());
        let turned_for = near.last().and_then(|at| track.seconds.get(*at)).copied()?;
        Some(Self {
            clip: clip.to_owned(),
            frames: cameras.len(),
            seconds: Some(seconds),
            fx: k.fx,
            fy: k.fy,
            speed: Some(arc / times.last()?),
            turn_degrees_per_second: Some(if turned_for > 0.0 { turned / turned_for } else { 0.0 }),
            straightness: (arc > 0.0).then(|| between_ends / arc),
            travel_to_axis_degrees: cosine.is_finite().then(|| cosine.clamp(-1.0, 1.0).acos().to_degrees()),
            baseline_45: track.baseline(45),
            baseline_90: track.baseline(90),
            baseline_135: track.baseline(135),
        })
    }

    /// The motion of a clip whose times are assumed, without them and without rates.
    pub(crate) fn without_times(self) -> Self {
        Self { seconds: None, speed: None, turn_degrees_per_second: None, ..self }
    }

    /// Measures a simulated clip or some of its shots. `None` as [`Self::of`].
    pub fn of_shots(clip: &str, shots: &[Shot]) -> Option<Self> {
        Self::of(clip, shots.iter().map(|shot| (shot.timestamp_micros, shot.camera)))
    }

    /// The eleven real RE10K clips of `data/re10k_motion.json`, from whose statistics trajectories are drawn.
    ///
    /// # Errors
    /// [`RoomsError::Motion`] if the embedded file is malformed.
    pub fn real() -> Result<Vec<Self>, RoomsError> {
        #[derive(Deserialize)]
        struct File {
            clips: Vec<ClipMotion>,
        }
        let file: File = serde_json::from_str(include_str!("../../data/re10k_motion.json"))?;
        Ok(file.clips)
    }
}

/// Poses at increasing times, in seconds from the first; at least two.
struct Track {
    seconds: Vec<f64>,
    poses: Vec<WorldFromCamera>,
}

impl Track {
    /// The camera's position at a time of the clip, interpolated linearly between two frames.
    fn position(&self, time: f64) -> DVec3 {
        let later = self.seconds.partition_point(|second| *second <= time).clamp(1, self.seconds.len() - 1);
        let (from, to) = (self.seconds[later - 1], self.seconds[later]);
        let share = if to > from { ((time - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 };
        self.poses[later - 1].centre().lerp(self.poses[later].centre(), share)
    }

    /// The first of the frames nearest to a time.
    fn nearest(&self, time: f64) -> usize {
        let far = |at: usize| (self.seconds[at] - time).abs();
        (0..self.seconds.len()).fold(0, |best, at| if far(at) < far(best) { at } else { best })
    }

    fn baseline(&self, frames: u32) -> Option<f64> {
        let span = f64::from(frames) / 30.0;
        let starts = arange(self.seconds.last()? - span, BASELINE_STEP);
        let distances = starts.iter().map(|start| self.position(start + span).distance(self.position(*start)));
        (!starts.is_empty()).then(|| distances.sum::<f64>() / starts.len() as f64)
    }
}

/// Multiples of `step` from 0 to `last`, as `numpy.arange(0, last + 1e-9, step)`.
fn arange(last: f64, step: f64) -> Vec<f64> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number of steps; floats saturate")]
    let count = ((last + 1e-9) / step).ceil() as usize;
    (0..count).map(|at| at as f64 * step).collect()
}

fn degrees_between(a: &WorldFromCamera, b: &WorldFromCamera) -> f64 {
    let turn = a.rotation().transpose() * b.rotation();
    let trace = turn.x_axis.x + turn.y_axis.y + turn.z_axis.z;
    (0.5 * (trace - 1.0)).clamp(-1.0, 1.0).acos().to_degrees()
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{CameraFromWorld, NormalizedIntrinsics};

    use super::*;

    #[test]
    fn clips_of_impossible_lengths_are_not_measured() {
        let intrinsics = NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).unwrap();
        let camera = Camera::pinhole(CameraFromWorld::IDENTITY, intrinsics);
        let seconds = |times: [i64; 2]| ClipMotion::of("clip", times.map(|micros| (micros, camera)))?.seconds;
        assert_eq!(seconds([1_250_000, -250_000]), Some(1.5));
        for times in [[0, 499_999], [0, 1_000_000_000_001], [i64::MIN, 0], [i64::MIN, i64::MAX]] {
            assert_eq!(seconds(times), None, "{times:?}");
        }
    }
}
