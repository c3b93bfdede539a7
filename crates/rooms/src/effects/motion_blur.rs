//! Motion blur: samples of a pixel are taken at different times while the shutter is open, half of them before the frame's
//! pose and half after it.

use glam::DVec3;

use super::SceneContext;
use crate::path::Shot;

/// Largest motion in an image 256 pixels wide that counts as still, in pixels.
const STILL: f64 = 0.1;
/// How close a camera comes to objects, in metres.
const NEAR: f64 = 0.5;

pub(super) fn needed_by(scene: &SceneContext<'_>) -> Option<String> {
    let shutter = scene.conditions.shutter;
    let largest = largest(scene.shots.iter().map(|shot| motion(shot) * shot.share_of_motion(shutter)));
    (largest * 256.0 > STILL)
        .then(|| format!("up to {:.1} % of the image width in {:.0} ms of exposure", largest * 100.0, shutter * 1e3))
}

/// Largest motion until the next frame of what is seen at the image's centre and corners, near and infinitely far, in image
/// widths. Beyond one width, as for points that end up behind the camera, it is 1.
fn motion(shot: &Shot) -> f64 {
    let (k, start, end) = (shot.camera.intrinsics, shot.camera.camera_from_world.inverse(), shot.moving_to.inverse());
    let positions = [[0.5, 0.5], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
    largest(positions.into_iter().flat_map(|[x, y]| {
        let ray = DVec3::new((x - k.cx) / k.fx, (y - k.cy) / k.fy, 1.0);
        let near = end.transform_point(start.transform_point(ray.normalize() * NEAR));
        let far = end.transform_vector(start.transform_vector(ray));
        [near, far].map(|seen| {
            let motion = (seen.truncate() / seen.z).distance(ray.truncate()) * k.fx;
            if seen.z > 0.0 && motion < 1.0 { motion } else { 1.0 }
        })
    }))
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |largest, value| if value > largest { value } else { largest })
}
