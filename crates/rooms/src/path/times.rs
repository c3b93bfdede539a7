//! Times of a scene's frames.

use atsplat_camera::Camera;
use atsplat_scene::{Scene, Times};

/// A scene's cameras with their times in microseconds: of a scene without times, with 30 frames per second. Frames without a
/// usable pose are left out, and take their time. `times` are those of the scene's dataset.
pub(crate) fn timed_cameras(scene: &Scene, times: Times) -> Vec<(i64, Camera)> {
    let timed = scene.has_times(times);
    let posed = scene.frames.iter().zip(0i64..).filter(|(frame, _)| frame.has_pose());
    let cameras = posed.map(|(frame, at)| {
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

    /// The second of three, with stated times and with assumed ones.
    #[test]
    fn a_frame_without_a_pose_is_not_on_the_route() {
        let intrinsics = NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).unwrap();
        let camera = Camera::pinhole(CameraFromWorld::IDENTITY, intrinsics);
        for (times, expected) in [([0, 50_000, 80_000], [0, 80_000]), ([1, 2, 3], [0, 66_666])] {
            let frame = |(at, time): (usize, i64)| Frame {
                name: "frame".to_owned(),
                timestamp_micros: Some(time),
                camera,
                stated_size: None,
                image: if at == 1 { FrameImage::Unposed("no rotation".to_owned()) } else { FrameImage::Absent },
            };
            let frames = times.into_iter().enumerate().map(frame).collect();
            let scene = Scene { key: "route".to_owned(), url: None, frames };
            assert_eq!(timed_cameras(&scene, Times::Given), expected.map(|micros| (micros, camera)));
        }
    }

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
            assert_eq!(scene.has_times(Times::Given), timed, "{stated:?}");
            let route = |micros: [i64; 3]| Route::Given(micros.map(|micros| (micros, camera)).to_vec());
            assert_eq!(Route::of_scene(&scene, Times::Given), route(expected));
            assert_eq!(Route::of_scene(&scene, Times::FromNames), route(assumed), "{stated:?} in names");
        }
    }
}
