//! Tables: published rows and, below each, the measured rows that reproduce it.
//!
//! Data goes through the folders in this order: `selection` finds the results that share a table, `rows` measures them, `comparison`
//! sets measured rows against each other, `published` against the paper, and `footer` says what readers must know. What comes out is
//! in `content`; `build` calls all of them.

mod build;
mod comparison;
mod content;
mod footer;
mod protocol_tables;
#[cfg(test)]
mod protocol_tables_tests;
mod published;
mod rows;
mod selection;
#[cfg(test)]
mod test_tables;

use atsplat_results::Results;

pub use build::{Mixing, tables};
pub(crate) use content::BUSY;
pub use content::{
    Cell, CellDifference, CellIndex, CellTiming, Column, Counts, Group, Mark, Note, NoteKind, Row, StoreProtocol,
    Table, TimeScope, Trainings, Value,
};
pub use protocol_tables::{chosen_protocol_tables, protocol_tables};
pub use published::{Agreement, Headline, Order, Outcome, agreement};
pub use rows::MeasuredOn;
pub(crate) use rows::{INFERENCE_ONLY, LEAKED_EXCLUDED};
pub(crate) use selection::{OtherPreset, has_trials, is_same_data, other_data};

/// A store with its label.
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    /// Name of its folder, or another text that distinguishes it from other stores.
    pub label: &'a str,
    /// Its rows.
    pub results: &'a Results,
}
