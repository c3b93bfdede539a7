use std::fmt::Display;
use std::path::Path;

use atsplat_files::{FileError, Malformed};
use thiserror::Error;

/// Why a baseline cannot be read, compared with or replaced.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
#[non_exhaustive]
pub enum DriftError {
    /// A file operation failed.
    #[error(transparent)]
    Io(#[from] FileError),
    /// A file that is not a valid baseline or recipe.
    #[error(transparent)]
    Malformed(#[from] Malformed),
    /// An invalid value.
    #[error("{what}: expected {expected}, found {found}")]
    Invalid { what: &'static str, expected: String, found: String },
    /// Results that cannot become a baseline.
    #[error("expected {expected}, found {found}")]
    Unacceptable { expected: &'static str, found: String },
    /// A stage of the probe failed.
    #[error("the probe's stage {stage}: {reason}")]
    Stage { stage: &'static str, reason: String },
}

impl DriftError {
    pub(super) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        FileError::during(action, path)
    }

    pub(super) fn malformed(path: &Path, location: &str, expected: impl Into<String>, found: impl Display) -> Self {
        Malformed::new("baseline", location, expected, found).in_file(path).into()
    }

    pub(super) fn invalid(what: &'static str, expected: impl Into<String>, found: impl Display) -> Self {
        Self::Invalid { what, expected: expected.into(), found: found.to_string() }
    }
}
