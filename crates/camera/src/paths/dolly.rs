use glam::DVec3;

use crate::WorldFromCamera;

/// `view` moved along its optical axis.
pub(super) fn moved(view: &WorldFromCamera, distance: f64) -> WorldFromCamera {
    WorldFromCamera::from_parts(view.rotation(), view.transform_point(DVec3::Z * distance))
}
