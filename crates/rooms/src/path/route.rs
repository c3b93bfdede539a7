//! A scene's cameras as a route.

use atsplat_camera::{Camera, ImageSize, NormalizedIntrinsics};
use atsplat_scene::{Frame, Scene, TimestampSource};

/// A scene's cameras with their times in microseconds: of a scene without times, with 30 frames per second. Frames without a
/// usable pose are left out, and take their time. `times` are those of the scene's dataset.
pub(crate) fn timed_cameras(scene: &Scene, times: TimestampSource) -> Vec<(i64, Camera)> {
    timed_frames(scene, times).map(|(micros, frame)| (micros, frame.camera)).collect()
}

/// As [`timed_cameras`], for images of `size`. A frame of known size keeps its view from top to bottom and the shape of its
/// pixels; at the sides, it shows more or less. Of a frame of unknown size, normalised intrinsics are kept.
pub(crate) fn route_cameras(scene: &Scene, times: TimestampSource, size: ImageSize) -> Vec<(i64, Camera)> {
    let intrinsics = |frame: &Frame| {
        let k = frame.camera.intrinsics;
        frame.stated_size.map_or(k, |stated| widened(k, stated, size))
    };
    let camera = |frame: &Frame| Camera { intrinsics: intrinsics(frame), ..frame.camera };
    timed_frames(scene, times).map(|(micros, frame)| (micros, camera(frame))).collect()
}

fn timed_frames(scene: &Scene, times: TimestampSource) -> impl Iterator<Item = (i64, &Frame)> {
    let timed = scene.has_times(times);
    let posed = scene.frames.iter().zip(0i64..).filter(|(frame, _)| frame.has_pose());
    posed.map(move |(frame, at)| (frame.timestamp_micros.filter(|_| timed).unwrap_or(at * 1_000_000 / 30), frame))
}

/// The intrinsics of an image with its sides cut off, or continued by as much on both, to another aspect ratio.
fn widened(k: NormalizedIntrinsics, from: ImageSize, to: ImageSize) -> NormalizedIntrinsics {
    let aspect = |size: ImageSize| f64::from(size.width) / f64::from(size.height);
    let share = aspect(from) / aspect(to);
    NormalizedIntrinsics { fx: k.fx * share, cx: 0.5 + (k.cx - 0.5) * share, ..k }
}

#[cfg(test)]
mod tests {
    use atsplat_camera::CameraFromWorld;
    use atsplat_numeric::Tolerance;
    use atsplat_scene::FrameImage;

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
                image: if at == 1 { FrameImage::Absent.unposed("no rotation") } else { FrameImage::Absent },
            };
            let frames = times.into_iter().enumerate().map(frame).collect();
            let scene = Scene { key: "route".to_owned(), url: None, frames };
            assert_eq!(timed_cameras(&scene, TimestampSource::Given), expected.map(|micros| (micros, camera)));
        }
    }

    /// From 4:3, with a principal point left of the centre, to a wider and a higher image.
    #[test]
    fn a_route_of_known_size_keeps_its_vertical_view_and_square_pixels() {
        let (stated, fy, [cx, cy]) = (ImageSize { width: 400, height: 300 }, 1.2, [0.4, 0.55]);
        let intrinsics = NormalizedIntrinsics::new(0.9, fy, cx, cy).unwrap();
        let camera = Camera::pinhole(CameraFromWorld::IDENTITY, intrinsics);
        let frame = |stated_size| Frame {
            name: "frame".to_owned(),
            timestamp_micros: None,
            camera,
            stated_size,
            image: FrameImage::Absent,
        };
        let scene = Scene { key: "route".to_owned(), url: None, frames: vec![frame(Some(stated)), frame(None)] };
        for (width, height) in [(640, 360), (256, 256), (800, 600)] {
            let size = ImageSize { width, height };
            let [known, unknown] = <[_; 2]>::try_from(route_cameras(&scene, TimestampSource::Given, size)).unwrap();
            assert_eq!(unknown.1, camera, "{size}");
            let k = known.1.intrinsics.pixel_from_normalized(size);
            let scale = f64::from(height) / 300.0;
            // In pixels of the route, the principal point is 40 left of the centre and 15 below it.
            let [middle, centre] = [width, height].map(|side| f64::from(side) / 2.0);
            let expected = [360.0 * scale, 360.0 * scale, middle - 40.0 * scale, centre + 15.0 * scale];
            Tolerance::absolute(1e-9).assert([k.fx, k.fy, k.cx, k.cy], expected, &size.to_string());
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
            assert_eq!(scene.has_times(TimestampSource::Given), timed, "{stated:?}");
            let route = |micros: [i64; 3]| Route::Given(micros.map(|micros| (micros, camera)).to_vec());
            let found = |times| Route::of_scene(&scene, times, ImageSize { width: 64, height: 36 });
            assert_eq!(found(TimestampSource::Given), route(expected));
            assert_eq!(found(TimestampSource::FromNames), route(assumed), "{stated:?} in names");
        }
    }
}
