use atsplat_numeric::narrowed;

use crate::{Camera, CameraError, DirectionScale, ImageSize, Ray};

impl Ray {
    /// Plücker coordinates of a ray whose direction `d` has unit length: the moment `o × d` of its origin `o`, then `d`, as in
    /// iLRM `scalable/scaler.py:121-136`, Long-LRM `model/llrm.py:279-293` and TokenGS `utils/data.py:126-158`.
    pub fn plucker(&self) -> [f64; 6] {
        let (moment, direction) = (self.origin.cross(self.direction), self.direction);
        [moment.x, moment.y, moment.z, direction.x, direction.y, direction.z]
    }
}

impl Camera {
    /// [`Ray::plucker`] of the rays through all pixel centres, height × width × 6, row-major, channels last; computed in f64
    /// and rounded to f32 at the end.
    ///
    /// # Errors
    /// Those of [`Camera::pixel_rays`].
    pub fn plucker_map(&self, size: ImageSize) -> Result<Vec<f32>, CameraError> {
        let rays = self.projector()?.pixel_rays(size, DirectionScale::UnitLength)?;
        let mut map = Vec::with_capacity(rays.size_hint().0.saturating_mul(6));
        for ray in rays {
            map.extend(ray?.plucker().map(narrowed));
        }
        Ok(map)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{NormalizedIntrinsics, WorldFromCamera};
    use atsplat_numeric::Tolerance;
    use glam::{DMat3, DVec3};

    fn ray() -> Ray {
        Ray { origin: DVec3::new(1.0, 2.0, 3.0), direction: DVec3::Z }
    }

    #[test]
    fn channels_have_the_published_order() {
        // (1, 2, 3) × (0, 0, 1) = (2, −1, 0)
        Tolerance::EXACT.assert(ray().plucker(), [2.0, -1.0, 0.0, 0.0, 0.0, 1.0], "moment and direction");
    }

    #[test]
    fn the_moment_is_the_same_for_every_point_of_the_ray() {
        let further = Ray { origin: ray().at(7.5), ..ray() };
        Tolerance::F64.assert(further.plucker(), ray().plucker(), "moment and direction");
    }

    #[test]
    fn the_map_is_row_major_with_channels_last() {
        let pose = WorldFromCamera::new(DMat3::from_rotation_z(0.2), DVec3::new(0.5, 0.0, 1.0)).unwrap();
        let camera = Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.7, 1.1, 0.5, 0.5).unwrap());
        let size = ImageSize { width: 5, height: 2 };
        let map = camera.plucker_map(size).unwrap();
        assert_eq!(map.len(), 2 * 5 * 6);
        let rays = camera.pixel_rays(size, DirectionScale::UnitLength).unwrap();
        for (found, ray) in map.chunks_exact(6).zip(&rays) {
            Tolerance::F32_ROUND_TRIP.assert(found.iter().map(|&v| f64::from(v)), ray.plucker(), "pixel");
        }
    }
}
