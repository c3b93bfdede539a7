use std::f64::consts::PI;

use atsplat_numeric::{Extremes, nearest_quantile};
use glam::DVec3;

use crate::error::positive;
use crate::{CameraError, ImageSize, NormalizedIntrinsics};

/// A sphere in scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Its centre.
    pub centre: DVec3,
    /// Its radius; ≥ 0.
    pub radius: f64,
}

impl Sphere {
    /// A sphere around most of the points, robust to a few far outliers: its centre is the middle of the range of the
    /// central `share` (in (0, 1]) of each coordinate, its radius the smallest that contains `share` of the points. Points
    /// that are not finite are ignored; `None` if there are no others.
    pub fn around_bulk(points: impl IntoIterator<Item = DVec3>, share: f64) -> Option<Self> {
        let points: Vec<DVec3> = points.into_iter().filter(|point| point.is_finite()).collect();
        let tail = 0.5 * (1.0 - share);
        let middle = |coordinate: fn(&DVec3) -> f64| {
            let mut values: Vec<f64> = points.iter().map(coordinate).collect();
            Some(nearest_quantile(&mut values, tail)?.midpoint(nearest_quantile(&mut values, 1.0 - tail)?))
        };
        let centre = DVec3::new(middle(|point| point.x)?, middle(|point| point.y)?, middle(|point| point.z)?);
        let mut distances: Vec<f64> = points.iter().map(|point| point.distance(centre)).collect();
        Some(Self { centre, radius: nearest_quantile(&mut distances, share)? })
    }
}

impl NormalizedIntrinsics {
    /// A camera with a centred principal point, square pixels and a horizontal field of view of `angle` radians.
    ///
    /// # Errors
    /// [`CameraError::NotPositive`] for an angle outside (0, π) or an empty image, [`CameraError::NonFinite`].
    pub fn with_horizontal_view(angle: f64, size: ImageSize) -> Result<Self, CameraError> {
        let (width, height) = (positive("width", f64::from(size.width))?, positive("height", f64::from(size.height))?);
        positive("field of view", angle)?;
        positive("half a turn minus the field of view", PI - angle)?;
        let fx = 0.5 / (0.5 * angle).tan();
        Self::new(fx, fx * width / height, 0.5, 0.5)
    }

    /// The distance along the optical axis at which a sphere of this radius just fits between all four edges.
    ///
    /// # Errors
    /// [`CameraError::NotPositive`] for a radius of zero, or if the optical axis is outside the image.
    pub fn distance_that_frames(&self, radius: f64) -> Result<f64, CameraError> {
        let nearest = |focal: f64, centre: f64| centre.minimum_of(1.0 - centre) / focal;
        let tangent = nearest(self.fx, self.cx).minimum_of(nearest(self.fy, self.cy));
        let tangent = positive("distance of the optical axis from the nearest edge", tangent)?;
        Ok(positive("radius", radius)? / tangent.atan().sin())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    #[test]
    fn outliers_and_nan_do_not_move_the_sphere() {
        let cube = (0..1000).map(|i| DVec3::new(f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100)));
        let outliers = [DVec3::splat(1e9), DVec3::NAN, DVec3::new(-1e7, 0.0, 0.0)];
        let sphere = Sphere::around_bulk(cube.clone().chain(outliers), 0.98).unwrap();
        let clean = Sphere::around_bulk(cube, 0.98).unwrap();
        Tolerance::absolute(0.5).assert(sphere.centre.to_array(), [4.5; 3], "in the middle");
        Tolerance::absolute(0.1).assert([sphere.radius], [clean.radius], "as without outliers");
        assert_eq!(Sphere::around_bulk([DVec3::NAN], 0.98), None);
        let one = Sphere::around_bulk([DVec3::ONE], 0.98).unwrap();
        assert_eq!(one, Sphere { centre: DVec3::ONE, radius: 0.0 });
    }

    #[test]
    fn a_share_of_one_contains_all_points() {
        let line = (0..5).map(|i| DVec3::new(f64::from(i), 0.0, 0.0));
        assert_eq!(Sphere::around_bulk(line, 1.0), Some(Sphere { centre: DVec3::new(2.0, 0.0, 0.0), radius: 2.0 }));
    }

    #[test]
    fn a_framed_sphere_touches_the_nearest_edges() {
        let size = ImageSize { width: 400, height: 200 };
        let camera = NormalizedIntrinsics::with_horizontal_view(std::f64::consts::FRAC_PI_2, size).unwrap();
        Tolerance::F64.assert([camera.fx, camera.fy], [0.5, 1.0], "square pixels");
        let distance = camera.distance_that_frames(3.0).unwrap();
        // The plane of the upper edge passes through the camera centre at the angle arctan ½ to the axis.
        Tolerance::F64.assert([distance * 0.5f64.atan().sin()], [3.0], "touches the upper and lower edges");
        let narrow = NormalizedIntrinsics::new(2.0, 2.5, 0.5, 0.5).unwrap();
        let distance = narrow.distance_that_frames(1.0).unwrap();
        Tolerance::F64.assert([distance * 0.2f64.atan().sin()], [1.0], "half a height over the focal length");
    }

    #[test]
    fn angles_and_radii_are_checked() {
        let size = ImageSize { width: 4, height: 4 };
        // The last is more than a turn: the tangent of its half is positive.
        for angle in [0.0, -1.0, f64::NAN, 3.2, PI, 7.0] {
            assert!(NormalizedIntrinsics::with_horizontal_view(angle, size).is_err(), "{angle}");
        }
        assert!(NormalizedIntrinsics::with_horizontal_view(1.0, ImageSize { width: 0, height: 4 }).is_err());
        let off_axis = NormalizedIntrinsics::new(1.0, 1.0, 1.5, 0.5).unwrap();
        assert!(off_axis.distance_that_frames(1.0).is_err());
        assert!(NormalizedIntrinsics { cx: 0.5, ..off_axis }.distance_that_frames(0.0).is_err());
    }
}
