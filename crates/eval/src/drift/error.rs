use std::path::{Path, PathBuf};

use thiserror::Error;

/// Why a baseline cannot be read, compared with or replaced.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DriftError {
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
    /// A file that is no baseline.
    #[error("{}: expected {expected}, found {found}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What should stand there.
        expected: String,
        /// What does.
        found: String,
    },
    /// What was asked for does not fit.
    #[error("{what}: expected {expected}, found {found}")]
    Unfit {
        /// What was asked for.
        what: &'static str,
        /// What would fit.
        expected: String,
        /// What was given.
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

    pub(super) fn malformed(path: &Path, expected: impl Into<String>, found: impl Into<Text>) -> Self {
        let found = found.into().0.chars().take(200).collect();
        Self::Malformed { path: path.to_owned(), expected: expected.into(), found }
    }

    pub(super) fn unfit(what: &'static str, expected: impl Into<String>, found: impl Into<Text>) -> Self {
        Self::Unfit { what, expected: expected.into(), found: found.into().0 }
    }
}

/// What was found, in words: text, a number, or an error.
pub(super) struct Text(String);

impl<T: std::fmt::Display> From<T> for Text {
    fn from(value: T) -> Self {
        Self(value.to_string())
    }
}
