//! Motion blur: samples of a pixel are taken at different times while the shutter is open.

use glam::DVec3;

use super::{Conditions, Effect, EffectKind, SceneContext};
use crate::path::Shot;

#[derive(Debug)]
pub(super) struct MotionBlur {
    shutter: f64,
}

/// Largest motion in an image 256 pixels wide that counts as still, in pixels.
const STILL: f64 = 0.1;
/// How close a camera comes to objects, in metres.
const NEAR: f64 = 0.5;

pub(super) fn needed_by(scene: &SceneContext<'_>) -> Option<String> {
    // A seed must give the same images as in earlier versions: sampled routes keep their rule, which sees no motion along the
    // optical axis and no roll.
    let motion: fn(&Shot, &Shot) -> f64 = if scene.is_given { motion_anywhere } else { motion_at_centre };
    let smears = scene.shots.windows(2).map(|pair| motion(&pair[0], &pair[1]) * 256.0 * scene.conditions.shutter);
    let largest = largest(smears);
    (largest > STILL).then(|| format!("up to {:.1} % of the image width while the shutter is open", largest / 2.56))
}

/// How far a camera turns and moves sideways: a bound of the motion at the image's centre, in image widths.
fn motion_at_centre(from: &Shot, to: &Shot) -> f64 {
    let [start, end] = [from, to].map(|shot| shot.camera.camera_from_world.inverse());
    let turn = start.forward().angle_between(end.forward());
    let parallax = (end.centre() - start.centre()).cross(start.forward()).length() / NEAR;
    (turn + parallax) * from.camera.intrinsics.fx
}

/// Largest motion of what is seen at the image's centre and corners, near and infinitely far, in image widths. Beyond one width,
/// as for points that end up behind the camera, it is 1.
fn motion_anywhere(from: &Shot, to: &Shot) -> f64 {
    let (k, start, end) =
        (from.camera.intrinsics, from.camera.camera_from_world.inverse(), to.camera.camera_from_world);
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

impl MotionBlur {
    pub(super) const fn new(conditions: &Conditions) -> Self {
        Self { shutter: conditions.shutter }
    }
}

impl Effect for MotionBlur {
    fn kind(&self) -> EffectKind {
        EffectKind::MotionBlur
    }

    fn shutter(&self) -> Option<f64> {
        Some(self.shutter)
    }
}
