use std::path::PathBuf;

use arrow_schema::ArrowError;
use atsplat_files::FileError;
use polars::error::PolarsError;
use thiserror::Error;

use crate::columns::ColumnsError;

/// Why a camera table cannot be written to a file.
#[derive(Debug, Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum ExportError {
    /// The path's extension is not that of a supported format.
    #[error("expected a file named .parquet, .arrow, .feather, .ipc or .csv ({})", path.display())]
    UnknownExtension { path: PathBuf },
    /// A file system operation failed.
    #[error(transparent)]
    Io(#[from] FileError),
    /// A scene cannot be converted to columns.
    #[error(transparent)]
    Columns(#[from] ColumnsError),
    /// Arrow could not encode a batch.
    #[error("encoding Arrow: {0}")]
    Arrow(#[from] ArrowError),
    /// Polars could not encode a batch.
    #[error("encoding a table: {0}")]
    Polars(#[from] PolarsError),
}

impl ExportError {
    pub(super) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        FileError::during(action, path)
    }
}
