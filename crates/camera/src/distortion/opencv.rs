use atsplat_numeric::Extremes;
use glam::{DMat2, DVec2};

use crate::CameraError;
use crate::polynomial::{evaluate, positive_up_to, solve_increasing};

/// Beyond this radius (a ray 0.002 arc seconds from the image plane) a polynomial is meaningless.
const RADIUS_MAX: f64 = 1e8;
const NEWTON_STEPS: usize = 60;
const HALVINGS: i32 = 40;
/// Residual below which further steps are noise, in roundings of the largest term.
const NOISE_ROUNDINGS: f64 = 2.0;
/// Maximum residual of an accepted inverse, in roundings of the largest term.
const ACCEPTED_ROUNDINGS: f64 = 64.0;

/// OpenCV's perspective model (`cv::projectPoints`): with `s = |x|²`, `R = 1 + k1·s + k2·s² + k3·s³`
/// and `p = (p2, p1)`,
///
/// `d(x) = R·x + s·p + 2·(p·x)·x`, which is `x·R + 2·p1·xy + p2·(s + 2x²)` in the first component.
///
/// Its Jacobian `R·I + 2R′·xxᵀ + 2(p xᵀ + x pᵀ) + 2(p·x)·I` is symmetric: `d` is the gradient of a potential, and a
/// gradient map whose Jacobian is positive definite on a convex set is one-to-one there. The convex set is the disc in
/// which the smallest eigenvalue is positive in every direction. Split into the radial part, with eigenvalues
/// `R + 2sR′` and `R`, and the tangential part, whose smallest eigenvalue over all directions is `−6·|x|·|p|`, this is
/// the disc where both `R + 2sR′ − 6·r·|p|` and `R − 6·r·|p|` are positive. Without tangential terms the disc is exactly
/// the region inside the fold; with them it is smaller by a margin in proportion to them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct OpenCv {
    radial: [f64; 3],
    tangential: DVec2,
    radius_limit: f64,
}

impl OpenCv {
    /// From finite k1, k2, k3 and `(p2, p1)`.
    pub(super) fn new(radial: [f64; 3], tangential: DVec2) -> Self {
        if radial.iter().all(|k| *k == 0.0) && tangential == DVec2::ZERO {
            return Self { radial, tangential, radius_limit: f64::INFINITY };
        }
        let [k1, k2, k3] = radial;
        let p = -6.0 * tangential.length();
        let radial_limit = positive_up_to(&[1.0, p, 3.0 * k1, 0.0, 5.0 * k2, 0.0, 7.0 * k3], RADIUS_MAX);
        let tangential_limit = positive_up_to(&[1.0, p, k1, 0.0, k2, 0.0, k3], RADIUS_MAX);
        Self { radial, tangential, radius_limit: radial_limit.minimum_of(tangential_limit) }
    }

    pub(super) fn radius_limit(&self) -> f64 {
        self.radius_limit
    }

    pub(super) fn distort(&self, point: DVec2) -> Result<DVec2, CameraError> {
        let image = self.formula(self.inside(point)?);
        if image.is_finite() { Ok(image) } else { Err(self.outside(point)) }
    }

    pub(super) fn jacobian(&self, point: DVec2) -> Result<DMat2, CameraError> {
        Ok(self.slope(self.inside(point)?))
    }

    /// The radial model is solved exactly along the radius; tangential terms then need a few damped Newton steps inside
    /// the disc.
    pub(super) fn undistort(&self, image: DVec2) -> Result<DVec2, CameraError> {
        let radius = image.length();
        if radius == 0.0 || self.radius_limit == f64::INFINITY {
            return Ok(image);
        }
        let radial_inverse = solve_increasing(|r| self.along_radius(r), radius, self.radius_limit);
        if self.tangential == DVec2::ZERO {
            let r = radial_inverse.ok_or_else(|| self.outside(image))?;
            return Ok(image * (r / radius));
        }
        // Slightly inside the fold if the radial model alone has no solution.
        let start = radial_inverse.unwrap_or(0.99 * self.radius_limit);
        self.newton(image, image * (start / radius)).ok_or_else(|| self.outside(image))
    }

    fn newton(&self, image: DVec2, start: DVec2) -> Option<DVec2> {
        let mut point = start;
        let mut residual = self.formula(point) - image;
        for _ in 0..NEWTON_STEPS {
            if residual.length() <= NOISE_ROUNDINGS * f64::EPSILON * self.largest_term(point.length()) {
                break;
            }
            let step = -(self.slope(point).inverse() * residual);
            let better = (0..HALVINGS).map(|halving| point + step * 0.5f64.powi(halving)).find_map(|candidate| {
                let remaining = self.formula(candidate) - image;
                let closer = remaining.length() < residual.length();
                (candidate.length() < self.radius_limit && closer).then_some((candidate, remaining))
            });
            match better {
                Some(next) => (point, residual) = next,
                None => break,
            }
        }
        let converged = residual.length() <= ACCEPTED_ROUNDINGS * f64::EPSILON * self.largest_term(point.length());
        (converged && point.is_finite()).then_some(point)
    }

    fn formula(&self, x: DVec2) -> DVec2 {
        let s = x.length_squared();
        let [k1, k2, k3] = self.radial;
        x * evaluate(&[1.0, k1, k2, k3], s) + self.tangential * s + x * (2.0 * self.tangential.dot(x))
    }

    fn slope(&self, x: DVec2) -> DMat2 {
        let s = x.length_squared();
        let [k1, k2, k3] = self.radial;
        let p = self.tangential;
        let diagonal = evaluate(&[1.0, k1, k2, k3], s) + 2.0 * p.dot(x);
        let bend = 2.0 * evaluate(&[k1, 2.0 * k2, 3.0 * k3], s);
        let column = |e: DVec2| e * diagonal + x * (bend * x.dot(e)) + 2.0 * (p * x.dot(e) + x * p.dot(e));
        DMat2::from_cols(column(DVec2::X), column(DVec2::Y))
    }

    /// Radius after the radial terms only, and its derivative.
    fn along_radius(&self, r: f64) -> (f64, f64) {
        let s = r * r;
        let [k1, k2, k3] = self.radial;
        (r * evaluate(&[1.0, k1, k2, k3], s), evaluate(&[1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3], s))
    }

    /// What rounding errors are relative to: terms may cancel, but their errors do not.
    fn largest_term(&self, r: f64) -> f64 {
        let [k1, k2, k3] = self.radial.map(f64::abs);
        r * evaluate(&[1.0, k1, k2, k3], r * r) + 3.0 * r * r * self.tangential.length()
    }

    fn inside(&self, point: DVec2) -> Result<DVec2, CameraError> {
        if point.length() < self.radius_limit { Ok(point) } else { Err(self.outside(point)) }
    }

    fn outside(&self, point: DVec2) -> CameraError {
        CameraError::OutsideLens { x: point.x, y: point.y, angle_limit: self.radius_limit.atan() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    #[test]
    fn a_barrel_lens_folds_at_its_maximum_radius() {
        // r − 0.3·r³ peaks where 1 = 0.9·r².
        let lens = OpenCv::new([-0.3, 0.0, 0.0], DVec2::ZERO);
        let peak = (1.0f64 / 0.9).sqrt();
        Tolerance::relative(1e-14).assert([lens.radius_limit()], [peak], "fold");
        assert!(lens.distort(DVec2::new(peak * 1.000_001, 0.0)).is_err(), "beyond the fold");
        let reach = peak - 0.3 * peak.powi(3);
        assert!(lens.undistort(DVec2::new(0.0, reach * 1.000_001)).is_err(), "not the image of any ray");
        // 1.2 has the same image as a ray inside the fold; only the latter may be returned.
        let folded = lens.formula(DVec2::new(1.2, 0.0));
        assert!(lens.undistort(folded).unwrap().length() < peak);
    }

    /// With tangential terms the formula is one-to-one in a disc: points beyond it are never returned, though some points
    /// out there have the same image.
    #[test]
    fn only_points_inside_the_disc_are_undistorted() {
        let lens = OpenCv::new([-0.28, 0.07, -0.01], DVec2::new(0.004, -0.03));
        for direction in (0..24).map(|step| DVec2::from_angle(f64::from(step) * std::f64::consts::TAU / 24.0)) {
            for share in [0.01, 0.5, 0.99] {
                let point = share * lens.radius_limit() * direction;
                let back = lens.undistort(lens.formula(point)).unwrap();
                Tolerance::absolute(1e-12).assert(back.to_array(), point.to_array(), "inside");
            }
            for share in [1.01, 1.05, 1.2, 1.5] {
                let beyond = share * lens.radius_limit() * direction;
                if let Ok(inside) = lens.undistort(lens.formula(beyond)) {
                    assert!(inside.length() < lens.radius_limit(), "{inside} for the image of {beyond}");
                }
            }
        }
    }

    #[test]
    fn a_pincushion_lens_does_not_fold() {
        let lens = OpenCv::new([0.3, 0.1, 0.0], DVec2::ZERO);
        Tolerance::EXACT.assert([lens.radius_limit()], [RADIUS_MAX], "no fold");
        let far = DVec2::new(300.0, -40.0);
        let back = lens.undistort(lens.distort(far).unwrap()).unwrap();
        Tolerance::relative(1e-13).assert(back.to_array(), far.to_array(), "far from the axis");
    }

    #[test]
    fn the_jacobian_is_positive_definite_inside_the_disc() {
        let lens = OpenCv::new([-0.28, 0.07, -0.01], DVec2::new(0.004, -0.03));
        for step in 0..3600 {
            let x = 0.999_999 * lens.radius_limit() * DVec2::from_angle(f64::from(step) * 1e-3 * std::f64::consts::TAU);
            let slope = lens.slope(x);
            assert!(slope.determinant() > 0.0 && slope.x_axis.x > 0.0, "at {x}: {slope}");
        }
    }
}
