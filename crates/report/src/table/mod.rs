//! Tables: published rows and, below each, what was measured in answer to it.

mod build;
mod edition;
mod footer;
mod measure;
mod rank;
#[cfg(test)]
mod tests;
mod verdict;

use atsplat_eval::Results;
use atsplat_eval::timing::{Machine, Spread};
use atsplat_metrics::Direction;
use serde::Serialize;

pub use build::{Mixing, tables};
pub(crate) use footer::short;
pub use verdict::{Headline, Verdict, verdict};

use crate::definition::Quantity;
use crate::plot::Origin;

/// A store and what to call it.
#[derive(Clone, Copy, Debug)]
pub struct Source<'a> {
    /// Its folder's name, or whatever tells it from others.
    pub label: &'a str,
    /// Its rows.
    pub results: &'a Results,
}

/// A table, ready to be written in any format.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Table {
    /// Name in files; with a number where results of several protocols made several tables of one definition.
    pub name: String,
    /// Short title.
    pub title: String,
    /// What the table shows.
    pub caption: String,
    /// Heads of the columns that name rows.
    pub labels: Vec<String>,
    /// Columns of numbers.
    pub groups: Vec<Group>,
    /// Published rows, each followed by what was measured in answer to it; then what answers none.
    pub rows: Vec<Row>,
    /// What a reader must know, in order.
    pub footer: Vec<Note>,
    /// Whether rows of different protocols stand side by side.
    pub forced: bool,
}

/// Columns with a common head.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Group {
    /// The head; empty for none.
    pub title: String,
    /// The preset that is measured; `None` where rows choose.
    pub preset: Option<String>,
    /// What was run where that is another setting than the published one.
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
    /// Head.
    pub title: String,
    /// What it shows.
    pub quantity: Quantity,
    /// Which way is better.
    pub direction: Option<Direction>,
    /// Whether counts are printed to the unit.
    pub exact: bool,
}

/// A row.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Row {
    /// What names it.
    pub labels: Vec<String>,
    /// Who says so.
    pub origin: Origin,
    /// Position of the published row that it is or answers.
    pub answers: Option<usize>,
    /// Name of the method in its store; `None` for published rows and for rows of several methods.
    pub method: Option<String>,
    /// Label of its store.
    pub store: Option<String>,
    /// Whether its weights are random: such rows are never ranked.
    pub untrained: bool,
    /// Whether targets that the method was given are left out.
    pub without_leaked: bool,
    /// Whether a line is drawn above it.
    pub rule_above: bool,
    /// Numbers, group by group and column by column.
    pub cells: Vec<Vec<Cell>>,
}

/// A number with what is known of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Cell {
    /// What it says.
    pub value: Value,
    /// 95 % interval over scenes.
    pub interval: Option<[f64; 2]>,
    /// Best or second of those that it is compared with.
    pub mark: Mark,
    /// Scenes and targets in it.
    pub counts: Option<Counts>,
    /// Why it was not computed.
    pub not_computed: Option<String>,
    /// How it was timed, where it is a time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timing: Option<CellTiming>,
}

/// How a time was measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct CellTiming {
    /// The median, which is the cell's value, with its spread; seconds.
    pub spread: Spread,
    /// Trials that were timed.
    pub trials: u64,
    /// Trials that the protocol has.
    pub trials_there: u64,
    /// Repetitions of each, at the least.
    pub repetitions: u64,
    /// Repetitions before those that count.
    pub warm_up: u32,
    /// Processor and threads.
    pub machine: Machine,
    /// Share of the machine's processors that others took meanwhile.
    pub others: Option<f64>,
    /// Whether that was too much to trust the time.
    pub busy: bool,
}

/// What a number is made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Counts {
    /// Scenes in the mean.
    pub scenes: u64,
    /// Targets in the mean.
    pub targets: u64,
    /// Targets that equal the truth to the bit.
    pub identical: u64,
    /// Targets without a render or a truth.
    pub failed: u64,
    /// Targets that are no numbers.
    pub non_finite: u64,
}

/// What a cell says.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Value {
    /// A number, in full precision where it was measured.
    Number(f64),
    /// Something else that a paper printed: `Diverged`, `> 10 m`.
    Text(String),
    /// Nothing.
    #[default]
    Absent,
}

/// How a cell is set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mark {
    /// Plainly.
    #[default]
    Plain,
    /// Bold.
    Best,
    /// Underlined.
    Second,
}

/// A line below a table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Note {
    /// What it is about.
    pub kind: NoteKind,
    /// The text.
    pub text: String,
}

/// What a note is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum NoteKind {
    /// Where published numbers come from, and what their authors add.
    Published,
    /// What the metrics' names mean, preset, index and renderer.
    Convention,
    /// How many scenes and targets, what failed.
    Counts,
    /// Intervals.
    Interval,
    /// Why measured numbers are not the published setting.
    Setting,
    /// Random weights.
    Untrained,
    /// What was not computed, and how to have it.
    NotComputed,
    /// Times that were measured on a busy machine.
    Busy,
    /// Rows of different protocols.
    Forced,
}

impl Value {
    /// A published field: a number, a text, or nothing.
    pub(crate) fn published(field: &str) -> Self {
        match (field, field.parse::<f64>()) {
            ("", _) => Self::Absent,
            (_, Ok(number)) if number.is_finite() => Self::Number(number),
            (text, _) => Self::Text(text.to_owned()),
        }
    }

    /// The number, where it is one.
    pub const fn number(&self) -> Option<f64> {
        match self {
            Self::Number(number) => Some(*number),
            _ => None,
        }
    }
}

/// Marks times of a busy machine.
pub(crate) const BUSY: &str = "§";

impl Cell {
    /// Whether it is a time that was measured on a machine that was busy with something else.
    pub fn is_busy(&self) -> bool {
        self.timing.as_ref().is_some_and(|timing| timing.busy)
    }

    /// What a table prints.
    pub fn print(&self, column: &Column) -> String {
        match (&self.value, &self.not_computed) {
            (Value::Number(number), _) if self.is_busy() => {
                format!("{} {BUSY}", column.quantity.print(*number, column.exact))
            }
            (Value::Number(number), _) => column.quantity.print(*number, column.exact),
            (Value::Text(text), _) => text.clone(),
            (Value::Absent, Some(_)) => "n/c".to_owned(),
            (Value::Absent, None) => "–".to_owned(),
        }
    }
}

impl Column {
    /// The head with an arrow the way that is better.
    pub fn head(&self) -> String {
        match self.direction {
            Some(Direction::Higher) => format!("{} ↑", self.title),
            Some(Direction::Lower) => format!("{} ↓", self.title),
            None => self.title.clone(),
        }
    }
}

impl Row {
    /// `paper`, or `measured` with what sets the row apart.
    pub fn origin_text(&self) -> &'static str {
        match (self.origin, self.untrained, self.without_leaked) {
            (Origin::Published, ..) => "paper",
            (Origin::Measured, false, false) => "measured",
            (Origin::Measured, true, false) => "measured †",
            (Origin::Measured, false, true) => "measured ‡",
            (Origin::Measured, true, true) => "measured †‡",
        }
    }
}

impl Table {
    /// Whether any row was measured.
    pub fn is_measured(&self) -> bool {
        self.rows.iter().any(|row| row.origin == Origin::Measured)
    }

    /// Every column with its position: group, column.
    pub fn columns(&self) -> impl Iterator<Item = ((usize, usize), &Column)> {
        let groups = self.groups.iter().enumerate();
        groups.flat_map(|(group, own)| own.columns.iter().enumerate().map(move |(at, column)| ((group, at), column)))
    }
}
