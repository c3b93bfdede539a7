use std::ffi::OsStr;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::ExportError;

/// A file format of camera tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExportFormat {
    /// Apache Parquet, zstd-compressed pages, statistics; the schema's metadata as key-value pairs.
    Parquet,
    /// Arrow's IPC file format (Feather 2), uncompressed, so that it can be memory-mapped; keeps the complete schema
    /// with its metadata.
    ArrowIpc,
    /// Comma-separated text with a header, without metadata; floats have the fewest digits that round-trip, null is an
    /// empty cell.
    Csv,
}

impl ExportFormat {
    /// The format of a path's extension: `parquet`; `arrow`, `feather` or `ipc`; `csv`.
    ///
    /// # Errors
    /// [`ExportError::UnknownExtension`].
    pub fn of_path(path: &Path) -> Result<Self, ExportError> {
        let extension = path.extension().map(OsStr::to_ascii_lowercase);
        match extension.as_ref().and_then(|extension| extension.to_str()) {
            Some("parquet") => Ok(Self::Parquet),
            Some("arrow" | "feather" | "ipc") => Ok(Self::ArrowIpc),
            Some("csv") => Ok(Self::Csv),
            _ => Err(ExportError::UnknownExtension { path: path.to_owned() }),
        }
    }
}
