use atsplat_camera::{CameraError, ImageSize};
use atsplat_pixels::PixelError;
use thiserror::Error;

/// Why an image or its intrinsics cannot be preprocessed.
#[derive(Debug, Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum PreprocessError {
    /// The protocol requires another image size.
    #[error("image size: the protocol expects {expected}, found {found}")]
    UnexpectedSize { expected: ImageSize, found: ImageSize },
    /// A step would have to enlarge the image.
    #[error("{step}: expected an image of at least {wanted}, found {found}")]
    TooSmall { step: &'static str, wanted: ImageSize, found: ImageSize },
    /// A step's output would have too many pixels.
    #[error("{step}: expected at most {limit} pixels, found {wanted}")]
    TooLarge {
        step: &'static str,
        wanted: ImageSize,
        /// [`super::Plan::MAX_PIXELS`].
        limit: u64,
    },
    /// A width or height is odd, but the centre has to be between two pixels.
    #[error("{step}: expected even width and height, found {found}")]
    OddSize { step: &'static str, found: ImageSize },
    /// An image or parameter has no pixels.
    #[error("{what}: expected at least one pixel a side, found {found}")]
    Empty { what: &'static str, found: ImageSize },
    /// A plan made for one size was applied to an image of another.
    #[error("plan for an image of {expected} applied to one of {found}")]
    WrongImage { expected: ImageSize, found: ImageSize },
    /// Intrinsics or a crop are invalid.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Resampling or cropping failed.
    #[error(transparent)]
    Pixels(#[from] PixelError),
}
