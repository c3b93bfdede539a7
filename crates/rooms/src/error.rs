use atsplat_camera::CameraError;
use atsplat_files::FileError;
use atsplat_pixels::PixelError;
use atsplat_scene::SceneError;

/// Errors of simulating and writing scenes.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum RoomsError {
    /// A request is invalid.
    #[error("{field}: expected {expected}, found {found}")]
    Request {
        /// Field of the request.
        field: &'static str,
        expected: &'static str,
        found: String,
    },
    /// A frame does not exist.
    #[error("scene {key:?}: expected a frame below {frames}, found {frame}")]
    NoFrame { key: String, frames: usize, frame: usize },
    /// A scene of a dataset cannot be simulated.
    #[error("simulating scene {key:?}: {source}")]
    Simulating { key: String, source: Box<RoomsError> },
    /// A camera is invalid.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// An image cannot be encoded.
    #[error(transparent)]
    Pixels(#[from] PixelError),
    /// A scene cannot be stored.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The embedded statistics of real clips cannot be read.
    #[error("reading the motion of real clips: {0}")]
    Motion(#[from] serde_json::Error),
    /// A file cannot be written.
    #[error(transparent)]
    Io(#[from] FileError),
}
