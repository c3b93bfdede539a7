use atsplat_eval::EvalError;
use atsplat_files::FileError;
use atsplat_pixels::PixelError;
use atsplat_protocol::ProtocolError;

/// An error while making a report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// There is no built-in table of this name.
    #[error("expected one of the tables {expected}, found {found:?}")]
    UnknownTable {
        /// Names of the built-in tables.
        expected: String,
        /// The requested name.
        found: String,
    },
    /// A table's definition is inconsistent.
    #[error("table {table}: expected {expected}, found {found}")]
    Definition {
        /// Name of the table.
        table: String,
        /// What the definition requires.
        expected: String,
        /// What was found instead.
        found: String,
    },
    /// A table's definition is not valid TOML, or has wrong fields.
    #[error("table {table}: {source}")]
    Toml {
        /// Name of the table.
        table: String,
        /// The parser's error.
        source: toml::de::Error,
    },
    /// A CSV file of published numbers is malformed.
    #[error("eval/published/{file}: {problem}")]
    Csv {
        /// Its name.
        file: String,
        /// Line, what was expected and what was found.
        problem: String,
    },
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
    Store(#[from] EvalError),
    /// A value cannot be represented in JSON.
    #[error("writing JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// A file cannot be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
}
