//! Tables: published rows and, below each, the measured rows that reproduce it.

mod agreement;
mod build;
mod cell;
#[cfg(test)]
mod choice_tests;
mod chosen;
mod column;
mod comparable;
#[cfg(test)]
mod comparable_tests;
mod counts;
#[cfg(test)]
mod data_tests;
mod difference;
#[cfg(test)]
mod difference_tests;
mod footer;
mod known_dataset;
mod labels;
mod leads;
mod measure;
mod measured_on;
mod measured_row;
#[cfg(test)]
mod mixing_tests;
mod note;
mod orders;
mod paired;
#[cfg(test)]
mod paired_tests;
#[cfg(test)]
mod process_tests;
mod protocol;
mod rank;
mod remarks;
mod row;
#[cfg(test)]
mod statement_tests;
#[cfg(test)]
mod tests;
mod time_scope;
#[cfg(test)]
mod training_tests;
mod trainings;
mod trial_data;
mod unranked_rows;

use atsplat_numeric::distinct;
use atsplat_results::Results;
use serde::Serialize;

pub use agreement::{Agreement, Headline, agreement};
pub use build::{Mixing, tables};
pub use cell::{Cell, CellTiming, Mark, Trainings, Value};
pub use column::{CellIndex, Column, Group};
pub use counts::Counts;
pub(crate) use difference::is_changed;
pub(crate) use known_dataset::other_data;
pub(crate) use labels::{short, short_commit};
pub use measured_on::MeasuredOn;
pub use note::{Note, NoteKind};
pub use orders::{Order, Outcome};
pub use protocol::{chosen_protocol_tables, protocol_tables};
pub(crate) use remarks::{INFERENCE_ONLY, LEAKED_EXCLUDED};
pub use row::{Row, StoreProtocol};
pub(crate) use time_scope::BUSY;
pub use time_scope::TimeScope;
pub(crate) use trial_data::is_same_data;

use crate::plot::Origin;
use rank::Incomparable;

/// A store with its label.
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    /// Name of its folder, or another text that distinguishes it from other stores.
    pub label: &'a str,
    /// Its rows.
    pub results: &'a Results,
}

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
    pub(crate) unranked: Vec<(CellIndex, Incomparable)>,
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

/// Whether a method has trials under a preset.
pub(crate) fn has_trials(results: &Results, preset: &str, method: &str) -> bool {
    results.trials_of(preset, method).next().is_some()
}
