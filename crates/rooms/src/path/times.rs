//! Times of a scene's frames.

use atsplat_camera::Camera;
use atsplat_scene::Scene;

/// A scene's cameras with their times in microseconds: of a scene without times, with 30 frames per second.
pub(crate) fn timed_cameras(scene: &Scene) -> Vec<(i64, Camera)> {
    let timed = scene.has_times();
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
            assert_eq!(scene.has_times(), timed, "{stated:?}");
            assert_eq!(Route::of_scene(&scene), Route::Given(expected.map(|micros| (micros, camera)).to_vec()));
        }
    }
}
