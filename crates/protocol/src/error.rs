use std::path::PathBuf;

use atsplat_scene::SceneError;
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
    /// The overlap of two views cannot be computed.
    #[error("overlap ({estimator}): {reason}")]
    Overlap {
        /// Which estimator, as [`crate::overlap::OverlapEstimator::name`].
        estimator: &'static str,
        /// What is missing or wrong.
        reason: String,
    },
}
