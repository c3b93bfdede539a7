use std::path::{Path, PathBuf};

use atsplat_camera::{CameraError, ImageSize};
use atsplat_pixels::PixelError;
use thiserror::Error;

use crate::Misfit;
use crate::torch::TorchError;

/// Why a scene cannot be read. The message says where, what was expected and what was found; the path comes last.
#[derive(Debug, Error)]
pub enum SceneError {
    /// A file system operation failed.
    #[error("{action}: {source} ({})", path.display())]
    Io {
        /// What was being done, e.g. "reading a trajectory".
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A text or binary file breaks its format.
    #[error("{format}: {location}: expected {expected}, found {found} ({})", path.display())]
    Malformed {
        /// Name of the format, e.g. "RE10K trajectory".
        format: &'static str,
        /// The file.
        path: PathBuf,
        /// Line, field, byte offset or frame inside the file.
        location: String,
        /// What the format requires.
        expected: String,
        /// What the file holds, shortened.
        found: String,
    },
    /// A camera's numbers are invalid.
    #[error("{location}: {source} ({})", path.display())]
    Camera {
        /// The file.
        path: PathBuf,
        /// Line or frame inside the file.
        location: String,
        /// What is wrong with the numbers.
        source: CameraError,
    },
    /// A frame has no picture to decode.
    #[error("frame {frame} of scene {scene:?} has no picture: {reason}")]
    NoPicture {
        /// Scene key.
        scene: String,
        /// Position of the frame in the scene.
        frame: usize,
        /// Why: the trajectory has no pictures, or the file is missing.
        reason: String,
    },
    /// A picture cannot be decoded or preprocessed.
    #[error("frame {frame} of scene {scene:?}: {source}")]
    Pixels {
        /// Scene key.
        scene: String,
        /// Position of the frame in the scene.
        frame: usize,
        /// The reason.
        source: PixelError,
    },
    /// A picture does not fit its camera's intrinsics.
    #[error("frame {frame} of scene {scene:?}: {source}")]
    Misfit {
        /// Scene key.
        scene: String,
        /// Position of the frame in the scene.
        frame: usize,
        /// Both sizes.
        source: Misfit,
    },
    /// A file is a Git LFS pointer: the content was not fetched.
    #[error(
        "{action}: found a Git LFS pointer instead of the file: run `git lfs pull` in its repository ({})", path.display()
    )]
    LfsPointer {
        /// What was being done, e.g. "reading a trajectory".
        action: &'static str,
        /// The file.
        path: PathBuf,
    },
    /// A scene key is not in the dataset.
    #[error("no scene {key:?} in the dataset ({})", path.display())]
    UnknownScene {
        /// The requested key.
        key: String,
        /// The dataset.
        path: PathBuf,
    },
    /// A generated scene could not be generated.
    #[error("generating scene {scene:?}: {source}")]
    Making {
        /// Key of the scene.
        scene: String,
        /// The generator's error.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A path holds none of the supported formats.
    #[error("expected {expected}, found {found} ({})", path.display())]
    Unrecognized {
        /// The supported content.
        expected: String,
        /// What the path holds.
        found: String,
        /// The file or folder.
        path: PathBuf,
    },
    /// A file refers to a picture outside its scene's folder.
    #[error("{location}: expected a path inside the scene's folder, found {found:?} ({})", path.display())]
    OutsideScene {
        /// Frame or line inside the file.
        location: String,
        /// The path as written.
        found: String,
        /// The file that holds the path.
        path: PathBuf,
    },
    /// A camera model that cannot be expressed as a [`atsplat_camera::Distortion`].
    #[error("{location}: camera model {model} is not supported: {reason} ({})", path.display())]
    UnsupportedCameraModel {
        /// Frame or line inside the file.
        location: String,
        /// The model's name in the file.
        model: String,
        /// Why it is not a case of pinhole, `OPENCV` or `OPENCV_FISHEYE`.
        reason: String,
        /// The file.
        path: PathBuf,
    },
    /// A file was not written by `torch.save`, or is not a chunk of scenes.
    #[error("{source} ({})", path.display())]
    Torch {
        /// The file.
        path: PathBuf,
        /// What is wrong with it, and where.
        source: TorchError,
    },
    /// An OpenCV call failed.
    #[cfg(feature = "opencv")]
    #[error("{action}: {source}")]
    OpenCv {
        /// What was being done, e.g. "detecting features".
        action: &'static str,
        /// OpenCV's error.
        source: ::opencv::Error,
    },
    /// Pictures of a camera cannot be undistorted: its lens or intrinsics are invalid.
    #[error("lens: {source}")]
    Lens {
        /// What is wrong with the numbers.
        source: CameraError,
    },
    /// A picture does not have the size that an undistortion map was computed for.
    #[error("picture size: expected {expected}, found {found}")]
    PictureSize {
        /// The map's size.
        expected: ImageSize,
        /// The picture's size.
        found: ImageSize,
    },
}

impl SceneError {
    /// [`Self::Torch`] for `map_err`.
    pub(crate) fn torch(path: impl Into<PathBuf>) -> impl FnOnce(TorchError) -> Self {
        let path = path.into();
        move |source| Self::Torch { path, source }
    }

    /// [`Self::Io`] for `map_err`.
    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { action, path, source }
    }

    /// [`Self::Camera`] for `map_err`.
    pub(crate) fn camera(path: &Path, location: impl Into<String>) -> impl FnOnce(CameraError) -> Self {
        let (path, location) = (path.to_owned(), location.into());
        move |source| Self::Camera { path, location, source }
    }

    pub(crate) fn malformed(
        format: &'static str,
        path: &Path,
        location: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        let (location, expected, found) = (location.into(), expected.into(), found.into());
        Self::Malformed { format, path: path.to_owned(), location, expected, found }
    }

    pub(crate) fn unrecognized(path: &Path, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Unrecognized { expected: expected.into(), found: found.into(), path: path.to_owned() }
    }

    pub(crate) fn unknown_scene(key: &str, path: &Path) -> Self {
        Self::UnknownScene { key: key.to_owned(), path: path.to_owned() }
    }

    pub(crate) fn unsupported_model(
        path: &Path,
        location: impl Into<String>,
        model: impl Into<String>,
        reason: impl Into<String>,
    ) -> Self {
        let (location, model, reason) = (location.into(), model.into(), reason.into());
        Self::UnsupportedCameraModel { location, model, reason, path: path.to_owned() }
    }
}
