//! Noise-free views and matches for tests.

use atsplat_camera::{Camera, ImageSize, NormalizedIntrinsics, WorldFromCamera};
use glam::{DMat3, DQuat, DVec2, DVec3, EulerRot};

use super::{MatchedPair, PointMatch, View};

/// A 640×480 pinhole camera at `centre`, rotated by `angles` about y, x and z.
pub(crate) fn view(angles: [f64; 3], centre: [f64; 3]) -> View {
    let [y, x, z] = angles;
    let rotation = DMat3::from_quat(DQuat::from_euler(EulerRot::YXZ, y, x, z));
    let pose = WorldFromCamera::new(rotation, DVec3::from_array(centre)).unwrap();
    let intrinsics = NormalizedIntrinsics::new(0.8, 0.8 * 640.0 / 480.0, 0.5, 0.5).unwrap();
    View { camera: Camera::pinhole(pose.inverse(), intrinsics), size: ImageSize { width: 640, height: 480 } }
}

/// A world point in distorted pixels of both views; `None` behind a camera.
pub(crate) fn match_of(first: &View, second: &View, point: DVec3) -> Option<PointMatch> {
    Some(PointMatch { first: pixel_of(first, point)?, second: pixel_of(second, point)? })
}

/// Points in front of all views of these tests.
pub(crate) fn cloud() -> Vec<DVec3> {
    let unit = |index: u32, step: f64| (f64::from(index) * step).fract();
    (0..200u32)
        .map(|i| {
            let depth = 4.0 + 12.0 * unit(i, 0.618_034);
            DVec3::new((unit(i, 0.754_878) - 0.5) * depth, (unit(i, 0.569_84) - 0.5) * 0.8 * depth, depth)
        })
        .collect()
}

/// The points of [`cloud`] that both views see.
pub(crate) fn matched(first: View, second: View) -> MatchedPair {
    let matches = cloud().into_iter().filter_map(|point| match_of(&first, &second, point)).collect();
    MatchedPair { first, second, matches }
}

fn pixel_of(view: &View, point: DVec3) -> Option<DVec2> {
    let seen = view.camera.camera_from_world.transform_point(point);
    if seen.z <= 0.0 {
        return None;
    }
    let distorted = view.camera.distortion.lens().ok()?.distorted_from_undistorted(seen.truncate() / seen.z).ok()?;
    Some((view.pixel_from_plane() * distorted.extend(1.0)).truncate())
}
