use serde::{Deserialize, Serialize};

/// Lens distortion, as coefficients of OpenCV's models.
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
