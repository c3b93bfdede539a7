use std::path::PathBuf;

use atsplat_pickle::TorchError;
use thiserror::Error;

/// Errors of files of tensors.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TensorError {
    /// A file could not be read or written.
    #[error("{action}: {source} ({})", path.display())]
    Io {
        /// What was being done.
        action: &'static str,
        /// To which file.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// A file or tensor is malformed.
    #[error("{what}: {location}: expected {expected}, found {found}")]
    Malformed {
        /// What was being read, e.g. "safetensors file".
        what: &'static str,
        /// Line and column, byte, or tensor.
        location: String,
        /// What was expected.
        expected: String,
        /// What was found, shortened.
        found: String,
    },
    /// A checkpoint is not a file of `torch.save`.
    #[error("checkpoint: {0}")]
    Torch(#[from] TorchError),
    /// A weights file is absent.
    #[error("weights: expected {expected}, found no file ({})", path.display())]
    Missing {
        /// What the file is, where users get it, and its SHA-256 if that is known.
        expected: String,
        /// Where it was expected.
        path: PathBuf,
    },
    /// Another error, with the file that caused it.
    #[error("{source} ({})", path.display())]
    InFile {
        /// The file.
        path: PathBuf,
        /// The error.
        source: Box<TensorError>,
    },
}

impl TensorError {
    #[expect(clippy::needless_pass_by_value, reason = "callers pass numbers and new strings as often as borrowed ones")]
    pub(crate) fn malformed(
        what: &'static str,
        location: impl Into<String>,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        let found = shortened(&found.to_string());
        Self::Malformed { what, location: location.into(), expected: expected.into(), found }
    }

    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { action, path, source }
    }

    /// The same error with its file.
    #[must_use]
    pub fn in_file(self, path: impl Into<PathBuf>) -> Self {
        Self::InFile { path: path.into(), source: Box::new(self) }
    }
}

/// At most 200 characters of untrusted text.
pub fn shortened(text: &str) -> String {
    const SHOWN: usize = 200;
    match text.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}
