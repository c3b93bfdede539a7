use atsplat_files::{FileError, LockError};
use atsplat_pixels::PixelError;
use atsplat_protocol::ProtocolError;
use atsplat_results::ResultsError;

/// An error while making a report.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum ReportError {
    /// There is no built-in table of this name.
    #[error("expected one of the tables {expected}, found {found:?}")]
    UnknownTable { expected: String, found: String },
    /// A choice names a method that no store has, or by a title that several share.
    #[error("{option}: expected one of the methods {expected}, found {found:?}")]
    Method { option: &'static str, expected: String, found: String },
    /// A table's definition is inconsistent.
    #[error("table {table}: expected {expected}, found {found}")]
    Definition { table: String, expected: String, found: String },
    /// A table's definition is not valid TOML, or has wrong fields.
    #[error("table {table}: {source}")]
    Toml { table: String, source: toml::de::Error },
    /// A CSV file of published numbers is malformed.
    #[error("eval/published/{file}: {problem}")]
    Csv { file: String, problem: String },
    /// The bundled font cannot be read.
    #[error("the bundled font cannot be read")]
    Font,
    /// A plot cannot be drawn.
    #[error("drawing: {0}")]
    Plot(String),
    /// An image cannot be read or written.
    #[error(transparent)]
    Image(#[from] PixelError),
    /// A protocol in the store is invalid.
    #[error(transparent)]
    Protocol(#[from] ProtocolError),
    /// A store is invalid.
    #[error(transparent)]
    Store(#[from] ResultsError),
    /// A value cannot be represented in JSON.
    #[error("writing JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// A file that the report would replace is not of a report, or was changed since.
    #[error("{}: expected a file that a report wrote, found another, or one that was changed since: move it away, or choose another folder", path.display())]
    NotOfReport { path: std::path::PathBuf },
    /// Another process writes into the folder.
    #[error("{} is being written by {by}", folder.display())]
    InUse { folder: std::path::PathBuf, by: String },
    /// A file cannot be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
}

impl From<LockError> for ReportError {
    fn from(error: LockError) -> Self {
        match error {
            LockError::Io(error) => Self::Io(error),
            LockError::InUse { folder, by } => Self::InUse { folder, by },
        }
    }
}
