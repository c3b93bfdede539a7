use atsplat_camera::{CameraError, ImageSize};
use atsplat_pixels::PixelError;
use thiserror::Error;

/// Why a picture or its intrinsics cannot be preprocessed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PreprocessError {
    /// The protocol requires another picture size.
    #[error("picture size: the protocol expects {expected}, found {found}")]
    UnexpectedSize {
        /// The size that the protocol states.
        expected: ImageSize,
        /// The picture's size.
        found: ImageSize,
    },
    /// A step would have to enlarge the picture.
    #[error("{step}: expected a picture of at least {wanted}, found {found}")]
    TooSmall {
        /// The step's name.
        step: &'static str,
        /// The size of the crop.
        wanted: ImageSize,
        /// The picture's size before the step.
        found: ImageSize,
    },
    /// A step's output would have too many pixels.
    #[error("{step}: expected at most {limit} pixels, found {wanted}")]
    TooLarge {
        /// The step's name.
        step: &'static str,
        /// The output size.
        wanted: ImageSize,
        /// [`super::Plan::MAX_PIXELS`].
        limit: u64,
    },
    /// A width or height is odd, but the centre has to lie between two pixels.
    #[error("{step}: expected even width and height, found {found}")]
    OddSize {
        /// The step's name.
        step: &'static str,
        /// The picture's size before the step.
        found: ImageSize,
    },
    /// A picture or parameter has no pixels.
    #[error("{what}: expected at least one pixel a side, found {found}")]
    Empty {
        /// What the size belongs to.
        what: &'static str,
        /// The size.
        found: ImageSize,
    },
    /// A plan made for one size was applied to a picture of another.
    #[error("plan for a picture of {expected} applied to one of {found}")]
    WrongPicture {
        /// The size that the plan was made for.
        expected: ImageSize,
        /// The picture's size.
        found: ImageSize,
    },
    /// Intrinsics or a crop are invalid.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Resampling or cropping failed.
    #[error(transparent)]
    Pixels(#[from] PixelError),
}
