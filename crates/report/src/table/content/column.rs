//! Columns in groups, and the positions of their cells.

use atsplat_metrics::Direction;
use serde::Serialize;

use crate::definition::Quantity;

/// Columns with a common heading.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Group {
    /// The heading; empty for none.
    pub title: String,
    /// The measured preset; `None` if rows specify it.
    pub preset: Option<String>,
    /// The presets that were run, if they differ from the published setting.
    pub measured_on: Option<String>,
    /// The columns.
    pub columns: Vec<Column>,
}

/// A column of numbers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Column {
    /// Name in CSV files: that of the published column.
    pub name: String,
    /// Heading.
    pub title: String,
    /// The quantity shown.
    pub quantity: Quantity,
    /// Which direction is better.
    pub direction: Option<Direction>,
    /// Whether counts are printed exactly.
    pub exact: bool,
    /// Whether intervals are printed next to the numbers.
    pub intervals: bool,
    /// Decimals of measured numbers, if they were chosen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decimals: Option<usize>,
}

/// The position of a column, and of its cell in every row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CellIndex {
    /// Position of the group of columns.
    pub group: usize,
    /// Position in the group.
    pub column: usize,
}

impl Column {
    /// Formats a measured number of the column.
    pub(crate) fn format(&self, value: f64) -> String {
        match self.decimals {
            Some(decimals) => self.quantity.print_with_decimals(value, decimals, None),
            None => self.quantity.print(value, self.exact),
        }
    }

    /// Formats a number of the column with the digits that papers print, to show or to compare with published ones.
    pub(crate) fn format_as_papers(&self, value: f64) -> String {
        self.quantity.print_as_papers(value, self.exact)
    }

    /// Formats a number of the column with the ends of its interval.
    pub(crate) fn format_with(&self, value: f64, interval: [f64; 2]) -> [String; 3] {
        let Some(decimals) = self.decimals else {
            return self.quantity.print_with_interval(value, interval, self.exact);
        };
        let [low, high] = interval;
        [value, low, high].map(|number| self.quantity.print_with_decimals(number, decimals, Some(interval)))
    }

    /// The heading, with an arrow in the better direction.
    pub fn head(&self) -> String {
        match self.direction {
            Some(Direction::Higher) => format!("{} ↑", self.title),
            Some(Direction::Lower) => format!("{} ↓", self.title),
            None => self.title.clone(),
        }
    }
}
