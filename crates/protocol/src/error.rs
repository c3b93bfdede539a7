use std::path::{Path, PathBuf};
use std::sync::Arc;

use atsplat_scene::SceneError;
use atsplat_scene::preprocess::PreprocessError;
use thiserror::Error;

/// Why a protocol cannot be read, built or run.
#[derive(Debug, Error)]
pub enum ProtocolError {
    /// The file system refused.
    #[error("{action}: {source} ({})", path.display())]
    Io {
        /// What was being done.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// An index or preset breaks its format.
    #[error("{what}: {location}: expected {expected}, found {found}")]
    Malformed {
        /// "evaluation index" or "preset".
        what: &'static str,
        /// Scene key and field, or line and column.
        location: String,
        /// What the format asks for.
        expected: String,
        /// What stands there, shortened.
        found: String,
    },
    /// A scene cannot be loaded or decoded.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A picture of a trial cannot be had; the same error for everyone who asks for it.
    #[error(transparent)]
    Picture(Arc<Self>),
    /// A picture does not fit the preprocessing that was planned for it.
    #[error("frame {frame} of scene {scene:?}: {source}")]
    Preprocess {
        /// Scene key.
        scene: String,
        /// Position of the frame in the scene.
        frame: usize,
        /// The reason.
        source: PreprocessError,
    },
    /// The overlap of two views cannot be computed.
    #[error("overlap ({estimator}): {reason}")]
    Overlap {
        /// Which estimator, as [`crate::overlap::OverlapEstimator::name`].
        estimator: &'static str,
        /// What is missing or wrong.
        reason: String,
    },
    /// What is wrong with one file among several that were asked for.
    #[error("{source} ({})", path.display())]
    InFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: Box<Self>,
    },
    /// Overlap bins whose edges make no bins.
    #[error("overlap bins: expected {expected}, found {found}")]
    Bins {
        /// What edges and names have to satisfy.
        expected: &'static str,
        /// What was given.
        found: String,
    },
    /// No preset of this name is built in.
    #[error("expected one of the presets {}, or the path of a TOML file, found {name:?}", known.join(", "))]
    UnknownPreset {
        /// The name asked for.
        name: String,
        /// The names that exist.
        known: Vec<&'static str>,
    },
}

impl ProtocolError {
    /// This error with the file that it is about, unless that is said already.
    pub(crate) fn in_file(self, path: &Path) -> Self {
        match self {
            Self::Io { .. } | Self::InFile { .. } => self,
            other => Self::InFile { path: path.to_owned(), source: Box::new(other) },
        }
    }
}
