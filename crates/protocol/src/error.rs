use std::path::{Path, PathBuf};
use std::sync::Arc;

use atsplat_files::{FileError, Malformed};
use atsplat_scene::SceneError;
use atsplat_scene::preprocess::PreprocessError;
use thiserror::Error;

/// An error while reading, building or running a protocol.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum ProtocolError {
    /// A file system operation failed.
    #[error(transparent)]
    Io(#[from] FileError),
    /// An index or preset violates its format.
    #[error(transparent)]
    Malformed(#[from] Malformed),
    /// A scene cannot be loaded or decoded.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// An image of a trial cannot be read, decoded or preprocessed; every request returns this same error.
    #[error(transparent)]
    Image(Arc<Self>),
    /// A decoded image does not fit the preprocessing planned for it.
    #[error("frame {frame} of scene {scene:?}: {source}")]
    Preprocess {
        scene: String,
        /// Position of the frame in the scene.
        frame: usize,
        source: PreprocessError,
    },
    /// The overlap of two views cannot be computed.
    #[error("overlap ({estimator}): {reason}")]
    Overlap {
        /// The estimator's [`crate::overlap::OverlapEstimator::name`].
        estimator: &'static str,
        reason: String,
    },
    /// An error with the file in which it occurred.
    #[error("{source} ({})", path.display())]
    InFile { path: PathBuf, source: Box<Self> },
    /// The names and edges do not define valid overlap bins.
    #[error("overlap bins: expected {expected}, found {found}")]
    Bins {
        /// What names and edges have to satisfy.
        expected: &'static str,
        found: String,
    },
    /// There is no built-in preset of this name.
    #[error("expected one of the presets {}, or the path of a TOML file, found {name:?}", known.join(", "))]
    UnknownPreset { name: String, known: Vec<&'static str> },
}

impl ProtocolError {
    /// Adds the file's path, unless the error already names it.
    #[must_use]
    pub fn in_file(self, path: &Path) -> Self {
        match self {
            Self::Io(_) | Self::InFile { .. } => self,
            other => Self::InFile { path: path.to_owned(), source: Box::new(other) },
        }
    }
}
