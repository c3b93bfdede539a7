use thiserror::Error;

/// Why numbers do not make a camera.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum CameraError {
    /// A number is NaN or infinite.
    #[error("{field}: expected a finite number, found {found}")]
    NonFinite {
        /// Which number.
        field: &'static str,
        /// Its value.
        found: f64,
    },
    /// A focal length or a size is zero or negative.
    #[error("{field}: expected a positive number, found {found}")]
    NotPositive {
        /// Which number.
        field: &'static str,
        /// Its value.
        found: f64,
    },
    /// The 3×3 part of a pose is not a rotation, not even roughly.
    #[error(
        "rotation: expected orthonormal rows and determinant 1, found determinant {determinant} and a residual of {residual}"
    )]
    NotARotation {
        /// Determinant of the 3×3 part.
        determinant: f64,
        /// Largest absolute entry of `R Rᵀ − I`.
        residual: f64,
    },
    /// A crop reaches outside the picture, or a size is empty.
    #[error("crop of {crop:?} does not fit into a picture of {width}×{height}")]
    CropOutside {
        /// The rectangle asked for.
        crop: crate::CropRect,
        /// Picture width in pixels.
        width: u32,
        /// Picture height in pixels.
        height: u32,
    },
}

/// `value` itself where it is finite.
pub(crate) fn finite(field: &'static str, value: f64) -> Result<f64, CameraError> {
    if value.is_finite() { Ok(value) } else { Err(CameraError::NonFinite { field, found: value }) }
}

/// `value` itself where it is finite and above zero.
pub(crate) fn positive(field: &'static str, value: f64) -> Result<f64, CameraError> {
    if finite(field, value)? > 0.0 { Ok(value) } else { Err(CameraError::NotPositive { field, found: value }) }
}
