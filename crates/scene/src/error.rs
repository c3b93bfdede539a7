use std::path::{Path, PathBuf};

use atsplat_camera::CameraError;
use atsplat_files::{FileError, Malformed};
use atsplat_pixels::PixelError;
use thiserror::Error;

use crate::ImageMismatch;
use crate::preprocess::PreprocessError;
use crate::torch::TorchError;

/// Why a scene cannot be read. The message says where, what was expected and what was found; the path comes last.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum SceneError {
    /// A file system operation failed.
    #[error(transparent)]
    Io(#[from] FileError),
    /// A text or binary file breaks its format.
    #[error(transparent)]
    Malformed(#[from] Malformed),
    /// A camera's numbers are invalid.
    #[error("{location}: {source} ({})", path.display())]
    Camera {
        path: PathBuf,
        /// Line or frame inside the file.
        location: String,
        source: CameraError,
    },
    /// A frame has no image to decode.
    #[error("frame {frame} of scene {scene:?} has no image: {reason}")]
    NoImage {
        scene: String,
        frame: usize,
        /// Why: the trajectory has no images, or the file is missing.
        reason: String,
    },
    /// A frame's pose is not finite or not a rotation.
    #[error("frame {frame} of scene {scene:?} has no usable pose: {reason}")]
    NoPose {
        scene: String,
        frame: usize,
        /// Where it is in which file, what was expected and found.
        reason: String,
    },
    /// A frame cannot be stored in a chunk, whose frames have timestamps.
    #[error(
        "frame {frame} of scene {scene:?}: expected a timestamp, or a name that is a number or ends in _ and a number, found \
         the name {name:?}"
    )]
    NoTimestamp { scene: String, frame: usize, name: String },
    /// An image cannot be decoded or preprocessed.
    #[error("frame {frame} of scene {scene:?}: {source} ({place})")]
    Pixels {
        scene: String,
        frame: usize,
        source: PixelError,
        /// The image's file, or that of its chunk.
        place: String,
    },
    /// An image in a chunk was damaged after it was written: its checksum differs.
    #[error("frame {frame} of scene {scene:?}: {source} ({place})")]
    Damaged {
        scene: String,
        frame: usize,
        source: Box<TorchError>,
        /// The chunk's file.
        place: String,
    },
    /// An image does not fit its camera's intrinsics.
    #[error("frame {frame} of scene {scene:?}: {source}")]
    ImageMismatch { scene: String, frame: usize, source: ImageMismatch },
    /// A frame's camera cannot be preprocessed.
    #[error("frame {frame} of scene {scene:?}: {source}")]
    Preprocess { scene: String, frame: usize, source: Box<PreprocessError> },
    /// A file is a Git LFS pointer: the content was not fetched.
    #[error(
        "{action}: found a Git LFS pointer instead of the file: run `git lfs pull` in its repository ({})", path.display()
    )]
    LfsPointer {
        /// What was being done, e.g. "reading a trajectory".
        action: &'static str,
        path: PathBuf,
    },
    /// A scene key is not in the dataset.
    #[error("no scene {key:?} in the dataset ({})", path.display())]
    UnknownScene { key: String, path: PathBuf },
    /// A generated scene could not be generated.
    #[error("generating scene {scene:?}: {source}")]
    Generating { scene: String, source: Box<dyn std::error::Error + Send + Sync> },
    /// A path contains none of the supported formats.
    #[error("expected {expected}, found {found} ({})", path.display())]
    Unrecognized { expected: String, found: String, path: PathBuf },
    /// A file refers to an image outside its scene's folder.
    #[error("{location}: expected a path inside the scene's folder, found {found:?} ({})", path.display())]
    OutsideScene {
        /// Frame or line inside the file.
        location: String,
        found: String,
        path: PathBuf,
    },
    /// A camera model that cannot be expressed as a [`atsplat_camera::Distortion`].
    #[error("{location}: camera model {model} is not supported: {reason} ({})", path.display())]
    UnsupportedCameraModel {
        /// Frame or line inside the file.
        location: String,
        model: String,
        /// Why it is not a case of pinhole, `OPENCV` or `OPENCV_FISHEYE`.
        reason: String,
        path: PathBuf,
    },
    /// A file was not written by `torch.save`, or is not a chunk of scenes.
    #[error("{source} ({})", path.display())]
    Torch { path: PathBuf, source: TorchError },
}

impl SceneError {
    /// [`Self::Torch`] for `map_err`.
    pub(crate) fn torch(path: impl Into<PathBuf>) -> impl FnOnce(TorchError) -> Self {
        let path = path.into();
        move |source| Self::Torch { path, source }
    }

    /// [`Self::Io`] for `map_err`.
    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        FileError::during(action, path)
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
        Malformed::new(format, location, expected, found.into()).in_file(path).into()
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
