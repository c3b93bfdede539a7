use std::f64::consts::TAU;

use glam::DVec3;

use crate::WorldFromCamera;

/// `view` moved in its image plane by `radius`, `turns` after straight up, clockwise as it sees it.
pub(super) fn moved(view: &WorldFromCamera, radius: f64, turns: f64) -> WorldFromCamera {
    let angle = TAU * turns;
    let offset = DVec3::new(angle.sin(), -angle.cos(), 0.0) * radius;
    WorldFromCamera::from_parts(view.rotation(), view.transform_point(offset))
}
