//! What a table contains, as files have it: its columns, rows, cells and notes.
//! Printing a number or a mark is here too, and no statistics.

mod cell;
mod column;
mod counts;
mod note;
mod row;
mod time_scope;

use atsplat_numeric::distinct;
use serde::Serialize;

pub use cell::{Cell, CellDifference, CellTiming, Mark, Trainings, Value};
pub use column::{CellIndex, Column, Group};
pub use counts::Counts;
pub(super) use counts::is_zero;
pub use note::{Note, NoteKind};
pub use row::{Row, StoreProtocol};
pub(crate) use time_scope::BUSY;
pub use time_scope::TimeScope;
pub(super) use time_scope::was_busy;

use super::comparison::Incomparable;
use super::published::Order;
use crate::plot::{Estimate, Origin};

/// A table, ready to be written in any format.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Table {
    /// Name in files, with a number if results of several protocols give several tables of one definition.
    pub name: String,
    /// Short title.
    pub title: String,
    /// The caption.
    pub caption: String,
    /// Headings of the columns that label rows.
    pub labels: Vec<String>,
    /// Columns of numbers.
    pub groups: Vec<Group>,
    /// Published rows, each followed by the measured rows that reproduce it; then the other measured rows.
    pub rows: Vec<Row>,
    /// What readers must know, in order.
    pub footer: Vec<Note>,
    /// Whether measured rows are in the order of the published rows that they reproduce.
    pub orders: Vec<Order>,
    /// Whether it mixes rows of different protocols.
    pub forced: bool,
    /// The columns whose measured values do not compare, each with the reason.
    #[serde(skip)]
    pub(in crate::table) unranked: Vec<(CellIndex, Incomparable)>,
    /// For published rows by their position, how the methods that reproduce them differ from those of the definition's reference row.
    #[serde(skip)]
    pub(crate) to_reference: Vec<(usize, Estimate)>,
}

impl Table {
    /// Whether any row is published.
    pub fn is_published(&self) -> bool {
        self.rows.iter().any(|row| row.origin == Origin::Published)
    }

    /// Whether any row was measured.
    pub fn is_measured(&self) -> bool {
        self.rows.iter().any(|row| row.origin == Origin::Measured)
    }

    /// Every column with its position.
    pub fn columns(&self) -> impl Iterator<Item = (CellIndex, &Column)> {
        self.groups.iter().enumerate().flat_map(|(group, Group { columns, .. })| {
            let columns = columns.iter().enumerate();
            columns.map(move |(column, definition)| (CellIndex { group, column }, definition))
        })
    }

    /// Measured rows over all of their targets.
    pub(in crate::table) fn measured_rows(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|row| row.origin == Origin::Measured && !row.without_leaked)
    }

    /// Why the measured rows do not compare in any of these columns, each reason once; empty if they do.
    pub(crate) fn why_unranked(&self, columns: &[CellIndex]) -> Vec<&'static str> {
        let reasons = self.unranked.iter().filter(|(index, _)| columns.contains(index));
        distinct(reasons.map(|(_, why)| why.in_words()))
    }

    pub(crate) fn column(&self, CellIndex { group, column }: CellIndex) -> &Column {
        &self.groups[group].columns[column]
    }

    /// The heading of a column after that of its group.
    pub(crate) fn heading(&self, index: CellIndex) -> String {
        let group = self.groups[index.group].title.as_str();
        let space = if group.is_empty() { "" } else { " " };
        format!("{group}{space}{}", self.column(index).title)
    }
}
