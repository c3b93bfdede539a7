use std::f64::consts::PI;

use glam::{DMat2, DVec2, DVec3};

use crate::CameraError;
use crate::polynomial::{evaluate, positive_up_to, solve_increasing};

/// OpenCV's fisheye model (`cv::fisheye`, Kannala–Brandt): a ray at the angle θ from the axis is mapped to the radius
/// `θ_d = θ·(1 + k1·θ² + k2·θ⁴ + k3·θ⁶ + k4·θ⁸)`, at the same azimuth.
///
/// It is one-to-one as long as `θ_d` increases: up to the first zero of `1 + 3k1·θ² + 5k2·θ⁴ + 7k3·θ⁶ + 9k4·θ⁸`, and
/// always below θ = π, where the azimuth is undefined. Unlike in OpenCV's functions, which divide by z, rays at 90° and
/// beyond are mapped too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fisheye {
    k: [f64; 4],
    angle_limit: f64,
}

impl Fisheye {
    /// From finite k1 … k4.
    pub(super) fn new(k: [f64; 4]) -> Self {
        let [k1, k2, k3, k4] = k;
        let squared = positive_up_to(&[1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4], PI * PI);
        Self { k, angle_limit: squared.sqrt() }
    }

    pub(super) fn angle_limit(&self) -> f64 {
        self.angle_limit
    }

    /// The image of a ray of any length.
    pub(super) fn distort(&self, direction: DVec3) -> Result<DVec2, CameraError> {
        let scale = direction.abs().max_element();
        let ray = if scale > 0.0 { direction / scale } else { direction };
        let lateral = ray.truncate();
        let radius = lateral.length();
        let angle = radius.atan2(ray.z);
        let image = if radius == 0.0 { DVec2::ZERO } else { lateral * (self.radius(angle).0 / radius) };
        if scale > 0.0 && angle < self.angle_limit && image.is_finite() {
            Ok(image)
        } else {
            Err(self.outside(direction.truncate()))
        }
    }

    /// The unit ray with the image `image`.
    pub(super) fn undistort(&self, image: DVec2) -> Result<DVec3, CameraError> {
        let radius = image.length();
        if radius == 0.0 {
            return Ok(DVec3::Z);
        }
        let angle = solve_increasing(|angle| self.radius(angle), radius, self.angle_limit)
            .ok_or_else(|| self.outside(image))?;
        Ok((image * (angle.sin() / radius)).extend(angle.cos()))
    }

    /// With `u = x/r`: `dθ_d/dr · uuᵀ + θ_d/r · (I − uuᵀ)`, and `dθ/dr = 1/(1 + r²)`.
    pub(super) fn jacobian(&self, point: DVec2) -> Result<DMat2, CameraError> {
        let r = point.length();
        let angle = r.atan();
        if r == 0.0 {
            return Ok(DMat2::IDENTITY);
        }
        if angle >= self.angle_limit {
            return Err(self.outside(point));
        }
        let (radius, slope) = self.radius(angle);
        let (radial, tangential) = (slope / (1.0 + r * r), radius / r);
        let u = point / r;
        let column = |e: DVec2| u * ((radial - tangential) * u.dot(e)) + e * tangential;
        Ok(DMat2::from_cols(column(DVec2::X), column(DVec2::Y)))
    }

    fn outside(&self, point: DVec2) -> CameraError {
        CameraError::OutsideLens { x: point.x, y: point.y, angle_limit: self.angle_limit }
    }

    /// `θ_d` and its derivative with respect to θ.
    fn radius(&self, angle: f64) -> (f64, f64) {
        let [k1, k2, k3, k4] = self.k;
        let squared = angle * angle;
        let radius = angle * evaluate(&[1.0, k1, k2, k3, k4], squared);
        (radius, evaluate(&[1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4], squared))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    #[test]
    fn without_coefficients_the_radius_is_the_angle() {
        let lens = Fisheye::new([0.0; 4]);
        Tolerance::relative(1e-15).assert([lens.angle_limit()], [PI], "limit");
        let sideways = lens.distort(DVec3::new(0.0, -3.0, 0.0)).unwrap();
        Tolerance::F64.assert(sideways.to_array(), [0.0, -PI / 2.0], "90°");
        assert!(lens.distort(DVec3::NEG_Z).is_err(), "the backward axis has no azimuth");
        assert!(lens.distort(DVec3::ZERO).is_err(), "no direction");
        assert!(lens.undistort(DVec2::new(3.2, 0.0)).is_err(), "beyond π");
    }

    #[test]
    fn the_fold_limits_the_angle() {
        // θ − 0.2·θ³ peaks where 1 = 0.6·θ².
        let lens = Fisheye::new([-0.2, 0.0, 0.0, 0.0]);
        let peak = (1.0f64 / 0.6).sqrt();
        Tolerance::relative(1e-14).assert([lens.angle_limit()], [peak], "fold");
        assert!(lens.undistort(DVec2::new(peak - 0.2 * peak.powi(3) + 1e-6, 0.0)).is_err());
        assert!(lens.distort(DVec3::new((peak + 1e-6).sin(), 0.0, (peak + 1e-6).cos())).is_err());
    }
}
