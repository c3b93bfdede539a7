use std::path::PathBuf;

use atsplat_camera::{CameraError, ImageSize};
use atsplat_files::FileError;
use thiserror::Error;

/// Errors of OpenCV and of its inputs.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum OpenCvError {
    /// An OpenCV call failed.
    #[error("{action}: {source}")]
    Call {
        /// What was being done, e.g. "detecting features".
        action: &'static str,
        /// OpenCV's error.
        source: ::opencv::Error,
    },
    /// Images of a camera cannot be undistorted: its lens or intrinsics are invalid.
    #[error("lens: {source}")]
    Lens {
        /// What is invalid.
        source: CameraError,
    },
    /// An image does not have the size that an undistortion map was computed for.
    #[error("image size: expected {expected}, found {found}")]
    ImageSize {
        /// The map's size.
        expected: ImageSize,
        /// The image's size.
        found: ImageSize,
    },
    /// An image has more columns or rows than OpenCV can count.
    #[error("image size: expected at most {} pixels per side, found {found}", i32::MAX)]
    Side {
        /// Its columns or rows.
        found: u32,
    },
    /// An image cannot be encoded.
    #[error(transparent)]
    Pixels(#[from] atsplat_pixels::PixelError),
    /// A video, or the name of its scene, is malformed.
    #[error("video: {location}: expected {expected}, found {found} ({})", path.display())]
    Video {
        /// The video.
        path: PathBuf,
        /// Part of the video, or `key`.
        location: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
}

impl OpenCvError {
    /// [`Self::Io`] for `map_err`.
    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        FileError::during(action, path)
    }
}
