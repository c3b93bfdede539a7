//! Tables as text, one file per format.

mod csv_file;
mod json;
mod latex;
mod markdown;
mod terminal;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

pub use json::json_of;
pub use terminal::Terminal;

use crate::ReportError;
use crate::table::Table;

/// What a table is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TableFormat {
    /// Boxes for a terminal, without colours, 120 columns wide.
    Terminal,
    /// A table of GitHub's Markdown.
    Markdown,
    /// A `table` environment for `booktabs`.
    Latex,
    /// One line per row, numbers in full precision.
    Csv,
    /// Everything.
    Json,
}

impl TableFormat {
    /// Every format.
    pub const ALL: [Self; 5] = [Self::Terminal, Self::Markdown, Self::Latex, Self::Csv, Self::Json];

    /// The ending of a file's name.
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
    /// [`ReportError::Json`], which tables of numbers and words do not cause.
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
