use std::f64::consts::TAU;

use glam::DVec3;

use crate::WorldFromCamera;
use crate::axes::rotation_from_forward_and_down;

const TURNS: f64 = 2.0;
/// `zrate` of `load_llff.py`.
const DEPTH_RATE: f64 = 0.5;

/// `view` moved to the point `t` of the spiral, looking at the point `focus` ahead of where it was.
pub(super) fn moved(view: &WorldFromCamera, radii: [f64; 3], focus: f64, t: f64) -> WorldFromCamera {
    let angle = TAU * TURNS * t;
    let offset = DVec3::new(angle.cos(), angle.sin(), (angle * DEPTH_RATE).sin()) * DVec3::from_array(radii);
    let forward = DVec3::new(0.0, 0.0, focus) - offset;
    // Straight above or below the focus the view's own axes are as good as any.
    let turn = rotation_from_forward_and_down(forward, DVec3::Y, 0.0).unwrap_or(glam::DMat3::IDENTITY);
    WorldFromCamera::from_parts(view.rotation() * turn, view.transform_point(offset))
}
