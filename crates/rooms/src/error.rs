use std::path::PathBuf;

use atsplat_camera::CameraError;
use atsplat_pixels::PixelError;
use atsplat_scene::SceneError;

/// What can go wrong while a scene is simulated or written.
#[derive(Debug, thiserror::Error)]
pub enum RoomsError {
    /// A request that no scene can answer.
    #[error("{field}: expected {expected}, found {found}")]
    Request {
        /// Which field of the request.
        field: &'static str,
        /// What it may be.
        expected: &'static str,
        /// What it is.
        found: String,
    },
    /// A frame past the last.
    #[error("scene {key:?} has {frames} frames, so no frame {frame}")]
    NoFrame {
        /// The scene.
        key: String,
        /// How many frames it has.
        frames: usize,
        /// The frame that was asked for.
        frame: usize,
    },
    /// A camera that cannot be.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// A picture that cannot be encoded.
    #[error(transparent)]
    Pixels(#[from] PixelError),
    /// A scene that cannot be stored.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Carried figures of real clips that cannot be read.
    #[error("reading the motion of real clips: {0}")]
    Motion(#[from] serde_json::Error),
    /// A file that cannot be written.
    #[error("{action} {}: {source}", path.display())]
    Io {
        /// What was being done.
        action: &'static str,
        /// To which file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}
