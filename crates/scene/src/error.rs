use std::path::PathBuf;

use atsplat_camera::{CameraError, ImageSize};
use atsplat_pixels::PixelError;
use thiserror::Error;

use crate::Misfit;
use crate::torch::TorchError;

/// Why files do not make a scene. The message says where, what was expected and what was found;
/// the path comes last.
#[derive(Debug, Error)]
pub enum SceneError {
    /// The file system refused.
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
        /// What the format asks for.
        expected: String,
        /// What stands there, shortened.
        found: String,
    },
    /// A camera's numbers break its rules.
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
        /// Why: the trajectory came alone, or the file is missing.
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
    /// A picture is not the one that its camera's intrinsics belong to.
    #[error("frame {frame} of scene {scene:?}: {source}")]
    Misfit {
        /// Scene key.
        scene: String,
        /// Position of the frame in the scene.
        frame: usize,
        /// Both sizes.
        source: Misfit,
    },
    /// A file is what Git LFS leaves in the place of one that was not fetched.
    #[error(
        "{action}: found a Git LFS pointer in place of the file: run `git lfs pull` in the repository that it came from \
         ({})", path.display()
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
        /// The key asked for.
        key: String,
        /// The dataset.
        path: PathBuf,
    },
    /// A scene that comes from no file could not be made.
    #[error("making scene {scene:?}: {source}")]
    Making {
        /// Key of the scene.
        scene: String,
        /// What its maker says.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A path holds none of the formats that were looked for.
    #[error("expected {expected}, found {found} ({})", path.display())]
    Unrecognized {
        /// What would have been recognised.
        expected: String,
        /// What is there.
        found: String,
        /// The file or folder.
        path: PathBuf,
    },
    /// A file points at a picture outside its own scene's folder.
    #[error("{location}: expected a path inside the scene's folder, found {found:?} ({})", path.display())]
    OutsideScene {
        /// Frame or line inside the file.
        location: String,
        /// The path as written.
        found: String,
        /// The file that holds the path.
        path: PathBuf,
    },
    /// A camera model that has no counterpart among the toolkit's lenses.
    #[error("{location}: camera model {model} is not supported: {reason} ({})", path.display())]
    UnsupportedCameraModel {
        /// Frame or line inside the file.
        location: String,
        /// The model as its own toolkit names it.
        model: String,
        /// What it has that pinhole, `OPENCV` and `OPENCV_FISHEYE` have not.
        reason: String,
        /// The file.
        path: PathBuf,
    },
    /// A file is not what `torch.save` writes, or not a chunk of scenes.
    #[error("{source} ({})", path.display())]
    Torch {
        /// The file.
        path: PathBuf,
        /// What is wrong with it, and where.
        source: TorchError,
    },
    /// OpenCV refused.
    #[cfg(feature = "opencv")]
    #[error("{action}: {source}")]
    OpenCv {
        /// What was being done, e.g. "detecting features".
        action: &'static str,
        /// OpenCV's own words.
        source: ::opencv::Error,
    },
    /// A camera's lens or intrinsics cannot be undistorted.
    #[error("lens: {source}")]
    Lens {
        /// What is wrong with the numbers.
        source: CameraError,
    },
    /// A picture is not of the size that was prepared for.
    #[error("picture size: expected {expected}, found {found}")]
    PictureSize {
        /// What was prepared for.
        expected: ImageSize,
        /// What the picture has.
        found: ImageSize,
    },
}

impl SceneError {
    /// What is wrong with a `.torch` file, and which.
    pub(crate) fn torch(path: impl Into<PathBuf>) -> impl FnOnce(TorchError) -> Self {
        let path = path.into();
        move |source| Self::Torch { path, source }
    }

    /// An I/O error with what was being done and where.
    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { action, path, source }
    }
}
