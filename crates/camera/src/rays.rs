use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::error::positive;
use crate::{Camera, CameraError, ImageSize, Projector};

/// The length of a ray's direction, which determines the meaning of "depth" along it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DirectionScale {
    /// Length 1: depth is distance from the camera. iLRM `scalable/scaler.py`, Long-LRM
    /// `model/llrm.py:279-293`, TokenGS `utils/data.py:126-158`.
    #[default]
    UnitLength,
    /// z = 1 in the camera's frame: depth is along the optical axis. pixelSplat and DepthSplat
    /// (`src/geometry/projection.py get_world_rays`).
    UnitDepth,
}

/// A half-line in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// The camera's centre, in scene units.
    pub origin: DVec3,
    /// Direction with the length of the requested [`DirectionScale`].
    pub direction: DVec3,
}

impl Ray {
    /// The point at `depth` times the direction.
    pub fn at(&self, depth: f64) -> DVec3 {
        self.origin + depth * self.direction
    }
}

impl Camera {
    /// Rays through all pixel centres of an image of `size`, row by row.
    ///
    /// # Errors
    /// Those of [`Projector::pixel_rays`], and the error of the first ray that does not exist.
    pub fn pixel_rays(&self, size: ImageSize, scale: DirectionScale) -> Result<Vec<Ray>, CameraError> {
        self.projector()?.pixel_rays(size, scale)?.collect()
    }
}

impl Projector {
    /// The undistorted ray through a position in units of the image's width and height.
    ///
    /// As in the papers, the direction is scaled in the camera's frame and then rotated, so the accuracy of its length
    /// depends on that of the pose's rotation.
    ///
    /// # Errors
    /// [`CameraError::OutsideLens`] if there is no such ray, [`CameraError::BehindCamera`] if a fisheye's ray has no point
    /// at z = 1, [`CameraError::NonFinite`].
    pub fn ray(&self, position: DVec2, scale: DirectionScale) -> Result<Ray, CameraError> {
        let unit = self.camera_direction(position)?;
        let direction = match scale {
            DirectionScale::UnitLength => unit,
            DirectionScale::UnitDepth if unit.z > 0.0 => unit / unit.z,
            DirectionScale::UnitDepth => return Err(CameraError::BehindCamera { depth: unit.z }),
        };
        Ok(Ray {
            origin: self.world_from_camera.centre(),
            direction: self.world_from_camera.transform_vector(direction),
        })
    }

    /// Rays through the pixel centres `((column + 0.5) / width, (row + 0.5) / height)`, row by row.
    ///
    /// With the size of a patch grid instead of an image, these are the rays through the patch centres.
    ///
    /// # Errors
    /// [`CameraError::NotPositive`] for an empty image. Each item has the errors of [`Self::ray`].
    pub fn pixel_rays(&self, size: ImageSize, scale: DirectionScale) -> Result<PixelRays, CameraError> {
        positive("width", f64::from(size.width))?;
        positive("height", f64::from(size.height))?;
        Ok(PixelRays { projector: *self, size, scale, row: 0, column: 0 })
    }
}

/// Iterator over the rays of an image in row-major order; see [`Projector::pixel_rays`].
#[derive(Clone, Debug)]
pub struct PixelRays {
    projector: Projector,
    size: ImageSize,
    scale: DirectionScale,
    /// Of the next ray.
    row: u32,
    column: u32,
}

impl Iterator for PixelRays {
    type Item = Result<Ray, CameraError>;

    fn next(&mut self) -> Option<Self::Item> {
        let ImageSize { width, height } = self.size;
        if self.row >= height {
            return None;
        }
        let at = |pixel: u32, side: u32| (f64::from(pixel) + 0.5) / f64::from(side);
        let position = DVec2::new(at(self.column, width), at(self.row, height));
        self.column += 1;
        if self.column == width {
            (self.row, self.column) = (self.row + 1, 0);
        }
        Some(self.projector.ray(position, self.scale))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = u64::from(self.size.width) * u64::from(self.size.height - self.row) - u64::from(self.column);
        usize::try_from(left).map_or((usize::MAX, None), |left| (left, Some(left)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{NormalizedIntrinsics, WorldFromCamera};
    use atsplat_numeric::Tolerance;
    use glam::DMat3;

    fn camera() -> Camera {
        let pose = WorldFromCamera::new(DMat3::from_rotation_x(-0.4), DVec3::new(3.0, 0.0, -1.0)).unwrap();
        Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.7, 1.1, 0.48, 0.51).unwrap())
    }

    const SIZE: ImageSize = ImageSize { width: 4, height: 3 };

    #[test]
    fn rays_pass_through_pixel_centres_row_by_row() {
        let camera = camera();
        let rays = camera.pixel_rays(SIZE, DirectionScale::UnitDepth).unwrap();
        assert_eq!(rays.len(), 12);
        for (index, ray) in (0u32..).zip(&rays) {
            let seen = camera.project(ray.at(2.5)).unwrap();
            let centre = [f64::from(index % 4) + 0.5, f64::from(index / 4) + 0.5];
            Tolerance::F64.assert(seen.pixel(SIZE).to_array(), centre, "pixel");
            Tolerance::F64.assert([seen.depth], [2.5], "z-depth");
        }
    }

    #[test]
    fn unit_rays_measure_distance() {
        let camera = camera();
        for ray in camera.pixel_rays(SIZE, DirectionScale::UnitLength).unwrap() {
            Tolerance::ORTHONORMAL.assert([ray.direction.length()], [1.0], "length");
            Tolerance::F64.assert([camera.project(ray.at(2.5)).unwrap().distance], [2.5], "distance");
        }
    }

    #[test]
    fn an_empty_image_has_no_rays() {
        let empty = ImageSize { width: 0, height: 3 };
        assert!(camera().pixel_rays(empty, DirectionScale::UnitLength).is_err());
    }

    #[test]
    fn the_size_hint_is_exact() {
        let mut rays = camera().projector().unwrap().pixel_rays(SIZE, DirectionScale::UnitLength).unwrap();
        rays.nth(4);
        assert_eq!(rays.size_hint(), (7, Some(7)));
        assert_eq!(rays.count(), 7);
    }
}
