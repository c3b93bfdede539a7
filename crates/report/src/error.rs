use std::path::PathBuf;

use atsplat_eval::EvalError;
use atsplat_pixels::PixelError;
use atsplat_protocol::ProtocolError;

/// What can go wrong in a report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// No table of this name travels in the binary.
    #[error("expected a table of {expected}, found {found:?}")]
    UnknownTable {
        /// Names that there are.
        expected: String,
        /// What was asked for.
        found: String,
    },
    /// A table's definition does not hold together.
    #[error("table {table}: expected {expected}, found {found}")]
    Definition {
        /// Name of the table.
        table: String,
        /// What a definition needs.
        expected: String,
        /// What it has.
        found: String,
    },
    /// A definition is no TOML of the right shape.
    #[error("table {table}: {source}")]
    Toml {
        /// Name of the table.
        table: String,
        /// What the parser says.
        source: toml::de::Error,
    },
    /// A CSV file of published numbers is broken.
    #[error("eval/published/{file}: {problem}")]
    Csv {
        /// Its name.
        file: String,
        /// Line, what was expected and found.
        problem: String,
    },
    /// The bundled font cannot be read.
    #[error("the bundled font cannot be read")]
    Font,
    /// A plot cannot be drawn.
    #[error("drawing: {0}")]
    Plot(String),
    /// A picture cannot be read or written.
    #[error(transparent)]
    Picture(#[from] PixelError),
    /// A protocol in the store is broken.
    #[error(transparent)]
    Protocol(#[from] ProtocolError),
    /// A store does not hold what it should.
    #[error(transparent)]
    Store(#[from] EvalError),
    /// A value cannot become JSON.
    #[error("writing JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// A file cannot be read or written.
    #[error("{doing}: {source}: {}", path.display())]
    File {
        /// Reading or writing.
        doing: &'static str,
        /// The system's error.
        source: std::io::Error,
        /// The file.
        path: PathBuf,
    },
}
