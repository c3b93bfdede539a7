use std::path::PathBuf;

use atsplat_files::{FileError, Malformed};
use atsplat_pickle::TorchError;
use thiserror::Error;

/// Errors of files of tensors.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TensorError {
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// A file or tensor is malformed.
    #[error(transparent)]
    Malformed(#[from] Malformed),
    /// A checkpoint is not a file of `torch.save`.
    #[error("checkpoint: {0}")]
    Torch(#[from] TorchError),
    /// A weights file is absent.
    #[error("weights: expected {expected}, found {} ({})", if path.is_dir() { "a folder" } else { "no file" }, path.display())]
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
    /// The same error with its file.
    #[must_use]
    pub fn in_file(self, path: impl Into<PathBuf>) -> Self {
        Self::InFile { path: path.into(), source: Box::new(self) }
    }
}
