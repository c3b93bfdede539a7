use thiserror::Error;

/// Why a camera, pose or trajectory is invalid, or a point cannot be mapped.
#[derive(Clone, Debug, Error, PartialEq)]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum CameraError {
    /// A number is NaN or infinite.
    #[error("{field}: expected a finite number, found {found}")]
    NonFinite { field: &'static str, found: f64 },
    /// A focal length or a size is zero or negative.
    #[error("{field}: expected a positive number, found {found}")]
    NotPositive { field: &'static str, found: f64 },
    /// Text that is not the size of an image.
    #[error("expected WIDTHxHEIGHT of 1 to {} pixels, found {found:?}", crate::ImageSize::MAX_SIDE)]
    InvalidSize { found: String },
    /// The 3×3 part of a pose is not a rotation, not even roughly.
    #[error(
        "rotation: expected orthonormal rows and determinant 1, found determinant {determinant} and a residual of {residual}"
    )]
    NotARotation {
        determinant: f64,
        /// Largest absolute entry of `R Rᵀ − I`.
        residual: f64,
    },
    /// A crop is not inside the image, or empty.
    #[error("crop of {crop:?} does not fit into an image of {width}×{height}")]
    CropOutside {
        crop: crate::CropRect,
        /// Image width in pixels.
        width: u32,
        /// Image height in pixels.
        height: u32,
    },
    /// A point or ray is behind the camera, or at a right angle to its axis.
    #[error("depth along the optical axis: expected a positive number, found {depth}")]
    BehindCamera {
        /// Its z coordinate in the camera's frame.
        depth: f64,
    },
    /// A point outside the invertible range of the lens model: beyond the angle at which its polynomial folds over, or
    /// not the image of any ray inside that angle.
    #[error("({x}, {y}) is outside the invertible range of the lens, which ends at {angle_limit} rad from its axis")]
    OutsideLens {
        /// First coordinate on the z = 1 plane, distorted or undistorted as passed to the method.
        x: f64,
        y: f64,
        /// End of the invertible range, in radians from the optical axis.
        angle_limit: f64,
    },
    /// There are fewer views or poses than the operation needs.
    #[error("{what}: expected at least {expected}, found {found}")]
    TooFewPoses { what: &'static str, expected: usize, found: usize },
    /// The distance that a pose normalisation divides by is outside the accepted range. The papers' loaders skip such
    /// scenes.
    #[error("{rule}: expected a distance {}, found {found}", in_words(*minimum, *maximum))]
    BaselineOutOfRange {
        rule: &'static str,
        /// The distance, in scene units.
        found: f64,
        minimum: f64,
        /// Largest distance accepted; `None` without a limit.
        maximum: Option<f64>,
    },
    /// A trajectory has a different number of times and poses.
    #[error("trajectory: expected one time for each of {poses} poses, found {times}")]
    TimesMismatch { times: usize, poses: usize },
    /// Times of a trajectory do not increase strictly.
    #[error("trajectory: expected time {index} to be after {previous}, found {found}")]
    TimesNotIncreasing {
        /// Position of the offending time, from 0.
        index: usize,
        previous: f64,
        found: f64,
    },
    /// A time is before the first or after the last pose of a trajectory.
    #[error("trajectory: expected a time from {start} to {end}, found {found}")]
    OutsideTrajectory { found: f64, start: f64, end: f64 },
    /// Cameras to be interpolated have different lenses.
    #[error("camera {position}: expected the lens of the first camera, found another")]
    DifferentLens {
        /// Position of the first camera that differs, from 0.
        position: usize,
    },
}

/// `value` if it is finite.
pub(crate) fn finite(field: &'static str, value: f64) -> Result<f64, CameraError> {
    if value.is_finite() { Ok(value) } else { Err(CameraError::NonFinite { field, found: value }) }
}

/// `value` if it is finite and above zero.
pub(crate) fn positive(field: &'static str, value: f64) -> Result<f64, CameraError> {
    if finite(field, value)? > 0.0 { Ok(value) } else { Err(CameraError::NotPositive { field, found: value }) }
}

/// The accepted range of a distance.
fn in_words(minimum: f64, maximum: Option<f64>) -> String {
    match maximum {
        Some(maximum) => format!("between {minimum} and {maximum}"),
        None => format!("of at least {minimum}"),
    }
}
