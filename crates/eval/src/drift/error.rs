use std::fmt::Display;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// Why a baseline cannot be read, compared with or replaced.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DriftError {
    /// A file operation failed.
    #[error("{action}: {source} ({})", path.display())]
    Io {
        /// What was being done.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// A file that is not a valid baseline.
    #[error("{}: expected {expected}, found {found}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// An invalid value.
    #[error("{what}: expected {expected}, found {found}")]
    Invalid {
        /// Which value.
        what: &'static str,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// A stage of the probe failed.
    #[error("the probe's stage {stage}: {reason}")]
    Stage {
        /// Name of the stage.
        stage: &'static str,
        /// The stage's own error.
        reason: String,
    },
}

impl DriftError {
    pub(super) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io { action, path: path.to_owned(), source }
    }

    pub(super) fn malformed(path: &Path, expected: impl Into<String>, found: impl Display) -> Self {
        let found = found.to_string().chars().take(200).collect();
        Self::Malformed { path: path.to_owned(), expected: expected.into(), found }
    }

    pub(super) fn invalid(what: &'static str, expected: impl Into<String>, found: impl Display) -> Self {
        Self::Invalid { what, expected: expected.into(), found: found.to_string() }
    }
}
