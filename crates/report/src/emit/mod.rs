//! Tables as text, in several formats.

mod csv_file;
mod latex;
mod latex_text;
mod markdown;
mod orders;
mod terminal;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

pub(crate) use csv_file::CSV_SUFFIXES;
pub use orders::orders_as_markdown;
pub use terminal::Terminal;

use crate::ReportError;
use crate::table::{Table, agreement};

/// Version of the JSON format of tables.
const JSON_VERSION: u32 = 3;

/// A file format of tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TableFormat {
    /// Boxes for a terminal, without colours, 120 columns wide.
    Terminal,
    /// A table in GitHub's Markdown.
    Markdown,
    /// A `table` environment for `booktabs` and `graphicx`.
    Latex,
    /// One line per row, with numbers in full precision.
    Csv,
    /// All data, with the agreement of measured and published values as `verdict`.
    Json,
}

impl TableFormat {
    /// Every format.
    pub const ALL: [Self; 5] = [Self::Terminal, Self::Markdown, Self::Latex, Self::Csv, Self::Json];

    /// The file extension.
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Terminal => "txt",
            Self::Markdown => "md",
            Self::Latex => "tex",
            Self::Csv => "csv",
            Self::Json => "json",
        }
    }

    /// The table as text.
    ///
    /// # Errors
    /// [`ReportError::Json`], which tables never cause.
    pub fn write(self, table: &Table) -> Result<String, ReportError> {
        match self {
            Self::Terminal => Ok(Terminal { width: 120, styled: false }.write(table)),
            Self::Markdown => Ok(markdown::write(table)),
            Self::Latex => Ok(latex::write(table)),
            Self::Csv => Ok(csv_file::write(table)),
            Self::Json => Ok(format!("{}\n", serde_json::to_string_pretty(&json_of(table))?)),
        }
    }
}

/// The table with its agreement with the paper, as `verdict`.
pub fn json_of(table: &Table) -> Value {
    json!({ "version": JSON_VERSION, "table": table, "verdict": agreement(table) })
}
