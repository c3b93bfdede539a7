//! Times of a scene's frames.

use atsplat_camera::Camera;
use atsplat_scene::Scene;

/// Whether the timestamps of a scene can be microseconds: captures number their frames consecutively.
pub fn has_times(scene: &Scene) -> bool {
    const MIN_STEP_MICROS: i64 = 1000;
    let times: Option<Vec<i64>> = scene.frames.iter().map(|frame| frame.timestamp_micros).collect();
    let Some(times) = times else { return false };
    let span = times.iter().max().zip(times.iter().min()).map_or(0, |(last, first)| last - first);
    (1i64..).zip(&times).last().is_none_or(|(count, _)| span >= MIN_STEP_MICROS * (count - 1))
}

/// A scene's cameras with their times in microseconds: of a scene without times, with 30 frames per second.
pub(crate) fn timed_cameras(scene: &Scene) -> Vec<(i64, Camera)> {
    let timed = has_times(scene);
    let cameras = scene.frames.iter().zip(0i64..).map(|(frame, at)| {
        let micros = frame.timestamp_micros.filter(|_| timed).unwrap_or(at * 1_000_000 / 30);
        (micros, frame.camera)
    });
    cameras.collect()
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{CameraFromWorld, NormalizedIntrinsics};
    use atsplat_scene::{Frame, FrameImage};

    use super::*;
    use crate::Route;

    /// Numbers of frames are not microseconds, and a frame without a time leaves the whole clip without.
    #[test]
    fn a_route_without_times_has_30_frames_per_second() {
        let intrinsics = NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).unwrap();
        let camera = Camera::pinhole(CameraFromWorld::IDENTITY, intrinsics);
        let frame = |timestamp_micros| Frame {
            name: "frame".to_owned(),
            timestamp_micros,
            camera,
            stated_size: None,
            image: FrameImage::Absent,
        };
        let assumed = [0, 33_333, 66_666];
        for (stated, expected, timed) in [
            ([Some(0), Some(40_000), Some(80_000)], [0, 40_000, 80_000], true),
            ([Some(1), Some(2), Some(3)], assumed, false),
            ([None, None, None], assumed, false),
            ([Some(0), None, Some(80_000)], assumed, false),
        ] {
            let frames = stated.map(frame).to_vec();
            let scene = Scene { key: "route".to_owned(), url: None, frames };
            assert_eq!(has_times(&scene), timed, "{stated:?}");
            assert_eq!(Route::of_scene(&scene), Route::Given(expected.map(|micros| (micros, camera)).to_vec()));
        }
    }
}
