use glam::{DMat3, DVec3};

use crate::WorldFromCamera;

/// `view` turned by `angle` radians about its down axis through the point `focus` ahead.
pub(super) fn moved(view: &WorldFromCamera, focus: f64, angle: f64) -> WorldFromCamera {
    let turn = DMat3::from_rotation_y(angle);
    let pivot = DVec3::new(0.0, 0.0, focus);
    WorldFromCamera::from_parts(view.rotation() * turn, view.transform_point(pivot - turn * pivot))
}
