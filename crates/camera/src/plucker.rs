use serde::{Deserialize, Serialize};

use crate::{Camera, CameraError, DirectionScale, ImageSize, Ray};

/// The channels of a ray in a network's input, in order. `o` is the camera's centre, `d` the unit direction, `o × d` the
/// moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PluckerLayout {
    /// `[o × d, d]`, 6 channels: iLRM `scalable/scaler.py:121-136`, Long-LRM `model/llrm.py:279-293`,
    /// TokenGS `utils/data.py:126-158`.
    #[default]
    MomentDirection,
    /// `[d, o × d]`, 6 channels: Plücker coordinates of Light Field Networks (Sitzmann et al. 2021, section 3) and Cameras
    /// as Rays (Zhang et al. 2024, section 3.1).
    DirectionMoment,
    /// `[o, d, o × d]`, 9 channels: LVSM and iLRM's branch `wide`.
    OriginDirectionMoment,
}

impl PluckerLayout {
    /// Number of channels.
    pub const fn channels(self) -> usize {
        match self {
            Self::MomentDirection | Self::DirectionMoment => 6,
            Self::OriginDirectionMoment => 9,
        }
    }

    /// The channels of one ray, whose direction must have unit length.
    pub fn values(self, ray: &Ray) -> impl Iterator<Item = f64> + use<> {
        let (origin, direction) = (ray.origin, ray.direction);
        let moment = origin.cross(direction);
        let vectors = match self {
            Self::MomentDirection => [moment, direction, direction],
            Self::DirectionMoment => [direction, moment, moment],
            Self::OriginDirectionMoment => [origin, direction, moment],
        };
        vectors.into_iter().flat_map(|vector| vector.to_array()).take(self.channels())
    }
}

impl Camera {
    /// Plücker coordinates of the rays through all pixel centres, height × width × channels, row-major, channels last;
    /// computed in f64 and rounded to f32 at the end.
    ///
    /// # Errors
    /// Those of [`Camera::pixel_rays`].
    pub fn plucker_map(&self, size: ImageSize, layout: PluckerLayout) -> Result<Vec<f32>, CameraError> {
        let rays = self.projector()?.pixel_rays(size, DirectionScale::UnitLength)?;
        let mut map = Vec::with_capacity(rays.size_hint().0.saturating_mul(layout.channels()));
        for ray in rays {
            map.extend(layout.values(&ray?).map(f32_from_f64));
        }
        Ok(map)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to the networks' precision")]
fn f32_from_f64(value: f64) -> f32 {
    value as f32
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
    fn layouts_have_the_published_order() {
        let values = |layout: PluckerLayout| layout.values(&ray()).collect::<Vec<_>>();
        // (1, 2, 3) × (0, 0, 1) = (2, −1, 0)
        assert_eq!(values(PluckerLayout::MomentDirection), [2.0, -1.0, 0.0, 0.0, 0.0, 1.0]);
        assert_eq!(values(PluckerLayout::DirectionMoment), [0.0, 0.0, 1.0, 2.0, -1.0, 0.0]);
        assert_eq!(values(PluckerLayout::OriginDirectionMoment), [1.0, 2.0, 3.0, 0.0, 0.0, 1.0, 2.0, -1.0, 0.0]);
    }

    #[test]
    fn the_moment_is_the_same_for_every_point_of_the_ray() {
        let further = Ray { origin: ray().at(7.5), ..ray() };
        let values = |ray: &Ray| PluckerLayout::MomentDirection.values(ray).collect::<Vec<_>>();
        Tolerance::F64.assert(values(&further), values(&ray()), "moment and direction");
    }

    #[test]
    fn the_map_is_row_major_with_channels_last() {
        let pose = WorldFromCamera::new(DMat3::from_rotation_z(0.2), DVec3::new(0.5, 0.0, 1.0)).unwrap();
        let camera = Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.7, 1.1, 0.5, 0.5).unwrap());
        let size = ImageSize { width: 5, height: 2 };
        let map = camera.plucker_map(size, PluckerLayout::default()).unwrap();
        assert_eq!(map.len(), 2 * 5 * 6);
        let rays = camera.pixel_rays(size, DirectionScale::UnitLength).unwrap();
        for (found, ray) in map.chunks_exact(6).zip(&rays) {
            let expected = PluckerLayout::default().values(ray);
            Tolerance::F32_ROUND_TRIP.assert(found.iter().map(|&v| f64::from(v)), expected, "pixel");
        }
    }
}
