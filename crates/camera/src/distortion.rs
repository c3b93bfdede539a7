mod fisheye;
mod opencv;

use std::fmt;

use glam::{DMat2, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::CameraError;
use crate::error::finite;
use fisheye::Fisheye;
use opencv::OpenCv;

/// Lens distortion, as coefficients of OpenCV's models.
///
/// The stored form; [`Lens`] is the same model prepared for mapping points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Distortion {
    /// A pinhole.
    #[default]
    None,
    /// Radial k1, k2, k3 and tangential p1, p2 (COLMAP's and nerfstudio's `OPENCV`).
    OpenCv {
        /// Radial, second order.
        k1: f64,
        /// Radial, fourth order.
        k2: f64,
        /// Radial, sixth order.
        k3: f64,
        /// Tangential, first.
        p1: f64,
        /// Tangential, second.
        p2: f64,
    },
    /// Equidistant fisheye with a polynomial in the angle (`OPENCV_FISHEYE`).
    Fisheye {
        /// Coefficients of θ³, θ⁵, θ⁷, θ⁹.
        k: [f64; 4],
    },
}

impl fmt::Display for Distortion {
    /// `OpenCV's model, k1 -0.02, p2 0.001`, without the coefficients that are 0.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (model, coefficients): (&str, &[(&str, f64)]) = match *self {
            Self::None => ("a pinhole", &[]),
            Self::OpenCv { k1, k2, k3, p1, p2 } => {
                ("OpenCV's model", &[("k1", k1), ("k2", k2), ("k3", k3), ("p1", p1), ("p2", p2)])
            }
            Self::Fisheye { k: [k1, k2, k3, k4] } => {
                ("OpenCV's fisheye model", &[("k1", k1), ("k2", k2), ("k3", k3), ("k4", k4)])
            }
        };
        f.write_str(model)?;
        coefficients
            .iter()
            .filter(|(_, value)| *value != 0.0)
            .try_for_each(|(name, value)| write!(f, ", {name} {value}"))
    }
}

impl Distortion {
    /// The name of the model and its coefficients in OpenCV's order: `opencv` with k1, k2, p1, p2, k3, or `fisheye`; `None` for a
    /// pinhole.
    pub fn in_opencv_order(&self) -> Option<(&'static str, Vec<f64>)> {
        match *self {
            Self::None => None,
            Self::OpenCv { k1, k2, k3, p1, p2 } => Some(("opencv", vec![k1, k2, p1, p2, k3])),
            Self::Fisheye { k } => Some(("fisheye", k.to_vec())),
        }
    }

    /// The model of this name with these coefficients, as [`Self::in_opencv_order`] has them, or `pinhole` without any; `None` for
    /// another name or number of coefficients.
    pub fn from_opencv_order(model: &str, coefficients: &[f64]) -> Option<Self> {
        match (model, coefficients) {
            ("pinhole", []) => Some(Self::None),
            ("opencv", &[k1, k2, p1, p2, k3]) => Some(Self::OpenCv { k1, k2, k3, p1, p2 }),
            ("fisheye", &[k1, k2, k3, k4]) => Some(Self::Fisheye { k: [k1, k2, k3, k4] }),
            _ => None,
        }
    }

    /// The lens with its invertible range, for mapping points.
    ///
    /// # Errors
    /// [`CameraError::NonFinite`] for a coefficient that is NaN or infinite.
    pub fn lens(&self) -> Result<Lens, CameraError> {
        Ok(Lens(match *self {
            Self::None => Model::None,
            Self::OpenCv { k1, k2, k3, p1, p2 } => {
                for (field, value) in [("k1", k1), ("k2", k2), ("k3", k3), ("p1", p1), ("p2", p2)] {
                    finite(field, value)?;
                }
                Model::OpenCv(OpenCv::new([k1, k2, k3], DVec2::new(p2, p1)))
            }
            Self::Fisheye { k } => {
                for (field, value) in ["k1", "k2", "k3", "k4"].into_iter().zip(k) {
                    finite(field, value)?;
                }
                Model::Fisheye(Fisheye::new(k))
            }
        }))
    }
}

/// A lens model with the range on which it can be inverted.
///
/// Points are on the camera's z = 1 plane: `(X/Z, Y/Z)` before the lens (*undistorted*), and after it (*distorted*), to
/// which intrinsics then apply. Every model is a polynomial that was fitted inside the image; further out it usually
/// folds over, and a point there has a second, wrong preimage that plain fixed-point iteration (`cv2.undistortPoints`)
/// may return. All methods here return [`CameraError::OutsideLens`] beyond the fold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens(Model);

#[derive(Clone, Copy, Debug, PartialEq)]
enum Model {
    None,
    OpenCv(OpenCv),
    Fisheye(Fisheye),
}

impl Lens {
    /// Distorts a point of the z = 1 plane (`cv2.projectPoints`, `cv2.fisheye.distortPoints` with an identity camera
    /// matrix).
    ///
    /// # Errors
    /// [`CameraError::OutsideLens`] beyond the fold, [`CameraError::NonFinite`] for NaN or infinity.
    pub fn distorted_from_undistorted(&self, point: DVec2) -> Result<DVec2, CameraError> {
        let point = finite_point(point)?;
        match &self.0 {
            Model::None => Ok(point),
            Model::OpenCv(lens) => lens.distort(point),
            Model::Fisheye(lens) => lens.distort(point.extend(1.0)),
        }
    }

    /// The unique point inside the invertible range that is distorted to `point` (`cv2.undistortPoints`,
    /// `cv2.fisheye.undistortPoints` with an identity camera matrix).
    ///
    /// # Errors
    /// [`CameraError::OutsideLens`] if there is no such point inside the fold, [`CameraError::BehindCamera`] if a fisheye
    /// sees `point` at 90° or more from its axis, so that it has no counterpart on the z = 1 plane,
    /// [`CameraError::NonFinite`] for NaN or infinity.
    pub fn undistorted_from_distorted(&self, point: DVec2) -> Result<DVec2, CameraError> {
        let point = finite_point(point)?;
        match &self.0 {
            Model::None => Ok(point),
            Model::OpenCv(lens) => lens.undistort(point),
            Model::Fisheye(lens) => on_plane(lens.undistort(point)?),
        }
    }

    /// The distorted point of a ray in the camera's frame, of any length. The perspective models are limited to rays with
    /// z > 0; a fisheye also sees rays beyond 90°.
    ///
    /// # Errors
    /// Those of [`Self::distorted_from_undistorted`], and [`CameraError::BehindCamera`] for a ray that a perspective
    /// model cannot see.
    pub fn distorted_from_direction(&self, direction: DVec3) -> Result<DVec2, CameraError> {
        match &self.0 {
            Model::Fisheye(lens) => lens.distort(finite_direction(direction)?),
            Model::None | Model::OpenCv(_) => self.distorted_from_undistorted(on_plane(direction)?),
        }
    }

    /// The unit ray in the camera's frame of a distorted point.
    ///
    /// # Errors
    /// [`CameraError::OutsideLens`], [`CameraError::NonFinite`].
    pub fn direction_from_distorted(&self, point: DVec2) -> Result<DVec3, CameraError> {
        match &self.0 {
            Model::Fisheye(lens) => lens.undistort(finite_point(point)?),
            Model::None | Model::OpenCv(_) => Ok(self.undistorted_from_distorted(point)?.extend(1.0).normalize()),
        }
    }

    /// Jacobian of [`Self::distorted_from_undistorted`] at an undistorted point: column 0 is the
    /// derivative with respect to x, column 1 to y. It is symmetric and, inside the range, positive definite.
    ///
    /// # Errors
    /// Those of [`Self::distorted_from_undistorted`].
    pub fn jacobian(&self, point: DVec2) -> Result<DMat2, CameraError> {
        let point = finite_point(point)?;
        match &self.0 {
            Model::None => Ok(DMat2::IDENTITY),
            Model::OpenCv(lens) => lens.jacobian(point),
            Model::Fisheye(lens) => lens.jacobian(point),
        }
    }

    /// Largest angle from the optical axis, in radians, at which the model is invertible: π/2 for a pinhole, less if the
    /// model folds over, up to π for a fisheye.
    pub fn angle_limit(&self) -> f64 {
        match &self.0 {
            Model::None => std::f64::consts::FRAC_PI_2,
            Model::OpenCv(lens) => lens.radius_limit().atan(),
            Model::Fisheye(lens) => lens.angle_limit(),
        }
    }
}

fn finite_point(point: DVec2) -> Result<DVec2, CameraError> {
    Ok(DVec2::new(finite("x", point.x)?, finite("y", point.y)?))
}

fn finite_direction(direction: DVec3) -> Result<DVec3, CameraError> {
    Ok(DVec3::new(finite("x", direction.x)?, finite("y", direction.y)?, finite("z", direction.z)?))
}

/// `(X/Z, Y/Z)` of a ray that points forward.
fn on_plane(direction: DVec3) -> Result<DVec2, CameraError> {
    let direction = finite_direction(direction)?;
    if direction.z > 0.0 {
        finite_point(direction.truncate() / direction.z)
    } else {
        Err(CameraError::BehindCamera { depth: direction.z })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;
    use proptest::prelude::*;

    /// Central differences lose half the digits, and a few more due to the curvature of the test lenses.
    const FINITE_DIFFERENCE: Tolerance = Tolerance { absolute: 1e-7, relative: 1e-7 };

    fn opencv() -> impl Strategy<Value = Distortion> {
        let radial = -0.4..0.4;
        let tangential = -0.02..0.02;
        (radial.clone(), radial.clone(), radial, tangential.clone(), tangential)
            .prop_map(|(k1, k2, k3, p1, p2)| Distortion::OpenCv { k1, k2, k3, p1, p2 })
    }

    fn fisheye() -> impl Strategy<Value = Distortion> {
        prop::array::uniform4(-0.1..0.1).prop_map(|k| Distortion::Fisheye { k })
    }

    fn any_lens() -> impl Strategy<Value = Lens> {
        prop_oneof![opencv(), fisheye(), Just(Distortion::None)].prop_map(|d| d.lens().unwrap())
    }

    proptest! {
        #[test]
        fn undistorting_inverts_distorting_up_to_the_fold(
            lens in any_lens(), share in 0.0..0.98, azimuth in 0.0..std::f64::consts::TAU,
        ) {
            let angle: f64 = share * if lens.angle_limit() > 1.5 { 1.5 } else { lens.angle_limit() };
            let point = angle.tan() * DVec2::from_angle(azimuth);
            let distorted = lens.distorted_from_undistorted(point).unwrap();
            let back = lens.undistorted_from_distorted(distorted).unwrap();
            // One rounding of `distorted` is amplified by the inverse of the Jacobian.
            let stretch: f64 = lens.jacobian(point).unwrap().inverse().to_cols_array().iter().map(|e| e.abs()).sum();
            let slack = Tolerance::absolute(1e-13 * (1.0 + stretch) * (1.0 + point.length_squared()));
            prop_assert!(slack.check(back.to_array(), point.to_array()).is_ok(), "{point} → {distorted} → {back}");
        }

        #[test]
        fn fisheye_rays_round_trip_beyond_a_right_angle(
            distortion in fisheye(), share in 0.0..0.98, azimuth in 0.0..std::f64::consts::TAU,
        ) {
            let lens = distortion.lens().unwrap();
            let angle: f64 = share * lens.angle_limit();
            let ray = (angle.sin() * DVec2::from_angle(azimuth)).extend(angle.cos());
            let back = lens.direction_from_distorted(lens.distorted_from_direction(ray * 7.0).unwrap()).unwrap();
            prop_assert!(Tolerance::absolute(1e-11).check(back.to_array(), ray.to_array()).is_ok(), "{ray} → {back}");
        }

        #[test]
        fn the_jacobian_matches_finite_differences(
            lens in any_lens(), share in 0.0..0.9, azimuth in 0.0..std::f64::consts::TAU,
        ) {
            let angle: f64 = share * if lens.angle_limit() > 1.2 { 1.2 } else { lens.angle_limit() };
            let point = angle.tan() * DVec2::from_angle(azimuth);
            let step = 1e-5;
            let slope = |axis: DVec2| {
                let at = |offset: f64| lens.distorted_from_undistorted(point + offset * axis);
                (at(step).unwrap() - at(-step).unwrap()) / (2.0 * step)
            };
            let numeric = DMat2::from_cols(slope(DVec2::X), slope(DVec2::Y));
            let exact = lens.jacobian(point).unwrap();
            prop_assert!(
                FINITE_DIFFERENCE.check(exact.to_cols_array(), numeric.to_cols_array()).is_ok(), "{exact} {numeric}"
            );
            prop_assert!(exact.determinant() > 0.0 && exact.x_axis.x > 0.0, "not positive definite: {exact}");
        }

        #[test]
        fn any_numbers_give_a_point_inside_the_range_or_an_error(
            k in prop::array::uniform5(prop::num::f64::ANY), x in prop::num::f64::ANY, y in prop::num::f64::ANY,
        ) {
            let [k1, k2, k3, p1, p2] = k;
            for distortion in [Distortion::OpenCv { k1, k2, k3, p1, p2 }, Distortion::Fisheye { k: [k1, k2, k3, p1] }] {
                let Ok(lens) = distortion.lens() else { continue };
                let point = DVec2::new(x, y);
                for result in [lens.distorted_from_undistorted(point), lens.undistorted_from_distorted(point)] {
                    prop_assert!(result.is_err() || result.is_ok_and(DVec2::is_finite), "{distortion:?} at {point}");
                }
            }
        }
    }

    #[test]
    fn zero_coefficients_are_a_pinhole_at_any_radius() {
        let zero = Distortion::OpenCv { k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 }.lens().unwrap();
        for point in [DVec2::ZERO, DVec2::new(0.3, -2.0), DVec2::new(1e12, 1.0)] {
            assert_eq!(zero.distorted_from_undistorted(point).unwrap(), point);
            let back = zero.undistorted_from_distorted(point).unwrap();
            Tolerance::relative(1e-15).assert(back.to_array(), point.to_array(), "zero lens");
        }
    }

    #[test]
    fn nan_coefficients_and_points_are_errors() {
        assert!(Distortion::Fisheye { k: [0.0, f64::NAN, 0.0, 0.0] }.lens().is_err());
        assert!(Distortion::OpenCv { k1: f64::INFINITY, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 }.lens().is_err());
        let lens = Distortion::None.lens().unwrap();
        assert!(lens.distorted_from_undistorted(DVec2::NAN).is_err());
        assert!(matches!(lens.distorted_from_direction(-DVec3::Z), Err(CameraError::BehindCamera { .. })));
    }

    /// The wildcard of reading names hides a model that only writing knows.
    #[test]
    fn models_are_read_as_they_are_written_in_opencvs_order() {
        let opencv = Distortion::OpenCv { k1: 0.1, k2: 0.2, k3: 0.3, p1: 0.4, p2: 0.5 };
        let (name, coefficients) = opencv.in_opencv_order().unwrap();
        assert_eq!((name, coefficients.as_slice()), ("opencv", &[0.1, 0.2, 0.4, 0.5, 0.3][..]));
        for lens in [Distortion::None, opencv, Distortion::Fisheye { k: [0.1, 0.2, 0.3, 0.4] }] {
            let (name, coefficients) = lens.in_opencv_order().unwrap_or(("pinhole", Vec::new()));
            assert_eq!(Distortion::from_opencv_order(name, &coefficients), Some(lens));
            assert_eq!(Distortion::from_opencv_order(name, &[&coefficients[..], &[0.0]].concat()), None);
        }
        assert_eq!(Distortion::from_opencv_order("equirectangular", &[]), None);
    }

    #[test]
    fn coefficients_print_in_order_without_zeros() {
        let lens = Distortion::OpenCv { k1: -0.02, k2: 0.0, k3: 0.5, p1: 0.0, p2: 0.001 };
        assert_eq!(lens.to_string(), "OpenCV's model, k1 -0.02, k3 0.5, p2 0.001");
        assert_eq!(
            Distortion::Fisheye { k: [0.0, 0.25, 0.0, -1.0] }.to_string(),
            "OpenCV's fisheye model, k2 0.25, k4 -1"
        );
        assert_eq!(Distortion::None.to_string(), "a pinhole");
    }
}
