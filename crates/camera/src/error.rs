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
    /// A point or ray lies behind the camera, or at a right angle to its axis.
    #[error("depth along the optical axis: expected a positive number, found {depth}")]
    BehindCamera {
        /// Its z coordinate in the camera's frame.
        depth: f64,
    },
    /// The lens model has no unique answer here: the point lies beyond the angle at which its
    /// polynomial folds over, or no ray inside that angle lands there.
    #[error("({x}, {y}) lies outside the invertible range of the lens, which ends at {angle_limit} rad from its axis")]
    OutsideLens {
        /// First coordinate on the z = 1 plane, before or after the lens as the method takes it.
        x: f64,
        /// Second coordinate.
        y: f64,
        /// Where the invertible range ends, in radians from the optical axis.
        angle_limit: f64,
    },
    /// There are fewer views or poses than the operation needs.
    #[error("{what}: expected at least {expected} poses, found {found}")]
    TooFewPoses {
        /// What needed them.
        what: &'static str,
        /// How many it needs.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// The distance that a pose normalisation divides by is outside the accepted range. The papers'
    /// loaders skip such a scene.
    #[error("{rule}: expected a distance between {minimum} and {maximum}, found {found}")]
    BaselineOutOfRange {
        /// Which normalisation.
        rule: &'static str,
        /// The distance, in scene units.
        found: f64,
        /// Smallest distance accepted.
        minimum: f64,
        /// Largest distance accepted.
        maximum: f64,
    },
    /// A trajectory has a different number of times and poses.
    #[error("trajectory: expected one time for each of {poses} poses, found {times}")]
    TimesMismatch {
        /// Number of times.
        times: usize,
        /// Number of poses.
        poses: usize,
    },
    /// Times of a trajectory do not increase strictly.
    #[error("trajectory: expected time {index} to come after {previous}, found {found}")]
    TimesNotIncreasing {
        /// Position of the offending time, from 0.
        index: usize,
        /// The time before it.
        previous: f64,
        /// The time found.
        found: f64,
    },
    /// A time before the first or after the last pose of a trajectory.
    #[error("trajectory: expected a time from {start} to {end}, found {found}")]
    OutsideTrajectory {
        /// The time asked for.
        found: f64,
        /// Time of the first pose.
        start: f64,
        /// Time of the last pose.
        end: f64,
    },
    /// Cameras that are to be interpolated have different lenses.
    #[error("camera {position}: expected the lens of the first camera, found another")]
    DifferentLens {
        /// Position of the first camera that differs, from 0.
        position: usize,
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
