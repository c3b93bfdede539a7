//! Tables: published rows and, below each, the measured rows that reproduce it.

mod build;
mod comparable;
#[cfg(test)]
mod comparable_tests;
mod counts;
mod difference;
#[cfg(test)]
mod difference_tests;
mod footer;
mod labels;
mod measure;
mod measured_on;
mod measured_row;
mod note;
mod orders;
#[cfg(test)]
mod process_tests;
mod protocol;
mod rank;
mod remarks;
#[cfg(test)]
mod statement_tests;
#[cfg(test)]
mod tests;
mod time_scope;
mod trainings;
mod verdict;

use atsplat_metrics::Direction;
use atsplat_results::Results;
use atsplat_results::times::{Machine, Spread};
use serde::Serialize;

pub use build::{Mixing, tables};
pub(crate) use comparable::is_same_data;
pub use counts::Counts;
pub(crate) use difference::is_changed;
pub(crate) use labels::{short, short_commit};
pub use measured_on::MeasuredOn;
pub use note::{Note, NoteKind};
pub use orders::{Order, Outcome};
pub use protocol::protocol_tables;
pub(crate) use remarks::{INFERENCE_ONLY, LEAKED_EXCLUDED};
pub use time_scope::TimeScope;
pub use verdict::{Headline, Verdict, verdict};

use crate::definition::Quantity;
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

/// A method under a protocol of a store.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoreProtocol {
    /// Label of the store.
    pub store: String,
    /// Name of the protocol in the store's rows.
    pub preset: String,
    /// Name of the method in the store's rows.
    pub method: String,
    /// What the method's name has to add under this protocol: zero-shot, changed at inference only, and the like.
    pub remarks: Vec<String>,
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
}

/// A row.
#[expect(clippy::struct_excessive_bools, reason = "independent facts, each with its own mark")]
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Row {
    /// Its labels.
    pub labels: Vec<String>,
    /// Whether it is published or measured.
    pub origin: Origin,
    /// Position of the published row that it is or reproduces.
    pub published_row: Option<usize>,
    /// What was measured; `None` for published rows.
    pub measured_on: Option<MeasuredOn>,
    /// What the label has to add: changed at inference only, zero-shot, leaked targets excluded, and the like.
    pub remarks: Vec<String>,
    /// Name of the method in its store; `None` for published rows and for rows of several methods.
    pub method: Option<String>,
    /// Label of its store; labels of all its stores, for a mean over trainings.
    pub store: Option<String>,
    /// For each group of columns, the method and the protocol that were measured; empty for published rows.
    #[serde(skip)]
    pub protocols: Vec<Option<StoreProtocol>>,
    /// The same of every training, if it is a mean over trainings (`protocols` are those of the first); else empty.
    #[serde(skip)]
    pub trainings: Vec<Vec<StoreProtocol>>,
    /// Whether its weights are random; such rows are never ranked.
    pub untrained: bool,
    /// Whether its weights are those of another row whose network differs: it was changed after training, at inference only.
    pub inference_only: bool,
    /// Whether the paper trains a separate network for such a row: an ablation that was not retrained.
    #[serde(skip)]
    pub not_retrained: bool,
    /// Whether targets that are also context frames are excluded.
    pub without_leaked: bool,
    /// Whether a line is drawn above it.
    pub rule_above: bool,
    /// Numbers, group by group and column by column.
    pub cells: Vec<Vec<Cell>>,
}

/// A value with its uncertainty and origin.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Cell {
    /// The value.
    pub value: Value,
    /// 95 % interval over scenes.
    pub interval: Option<[f64; 2]>,
    /// Whether it is the best or second of the ranked rows.
    pub mark: Mark,
    /// Numbers of scenes and targets.
    pub counts: Option<Counts>,
    /// Whether it is a size of some trials only, because the method failed on the others or does not support them.
    #[serde(skip)]
    pub lacks_trials: bool,
    /// Hash of the targets or trials that it is over, scored or not; numbers with different hashes are not comparable. `None`
    /// if it is published, or a time.
    #[serde(skip)]
    pub set_hash: Option<u64>,
    /// The mean with renders that are identical to the truth, whose PSNR counts as its cap, if there are any other than copies of
    /// context views.
    #[serde(skip)]
    pub with_identical: Option<f64>,
    /// SHA-256 of the metric's learned weights, if it has any.
    #[serde(skip)]
    pub metric_weights: Option<String>,
    /// Why it was not computed.
    pub not_computed: Option<String>,
    /// The spread over trainings and over scenes, if it is a mean over several trainings.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trainings: Option<Trainings>,
    /// How it was timed, if it is a time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timing: Option<CellTiming>,
}

/// Spread over several trainings of one network.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Trainings {
    /// Number of trainings.
    pub count: u64,
    /// Standard deviation over trainings, of their means over scenes.
    pub training_deviation: f64,
    /// Standard deviation over scenes, of their means over trainings.
    pub scene_deviation: f64,
}

/// How a time was measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct CellTiming {
    /// The median, which is the cell's value, with its spread; seconds.
    pub spread: Spread,
    /// What it covers, if the method runs in a separate process.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scope: Option<TimeScope>,
    /// Number of timed trials.
    pub trials: u64,
    /// Number of trials of the protocol.
    pub trials_there: u64,
    /// Smallest number of repetitions of a trial.
    pub repetitions: u64,
    /// Warm-up repetitions, which do not count.
    pub warm_up: u32,
    /// Processor and threads.
    pub machine: Machine,
    /// What ran on a graphics adapter, and on which; `None` if everything ran on the CPU.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// Fraction of the machine's processors that other processes used at the same time.
    pub others: Option<f64>,
    /// Whether that fraction was too large for the time to be reliable.
    pub busy: bool,
}

/// The value of a cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Value {
    /// A number, in full precision if measured.
    Number(f64),
    /// Another text that a paper printed: `Diverged`, `> 10 m`.
    Text(String),
    /// No value.
    #[default]
    Absent,
}

/// How a cell is highlighted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mark {
    /// Not highlighted.
    #[default]
    Plain,
    /// The best value: bold.
    Best,
    /// The second-best value: underlined.
    Second,
}

impl Value {
    /// Parses a published field: a number, another text, or an empty field.
    pub(crate) fn published(field: &str) -> Self {
        match (field, field.parse::<f64>()) {
            ("", _) => Self::Absent,
            (_, Ok(number)) if number.is_finite() => Self::Number(number),
            (text, _) => Self::Text(text.to_owned()),
        }
    }

    /// The number, if it is one.
    pub const fn number(&self) -> Option<f64> {
        match self {
            Self::Number(number) => Some(*number),
            _ => None,
        }
    }
}

/// Each value once, where it is first.
pub(crate) fn distinct<T: PartialEq>(values: impl IntoIterator<Item = T>) -> Vec<T> {
    let mut found = Vec::new();
    for value in values {
        if !found.contains(&value) {
            found.push(value);
        }
    }
    found
}

/// The position of a column, and of its cell in every row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CellIndex {
    /// Position of the group of columns.
    pub group: usize,
    /// Position in the group.
    pub column: usize,
}

/// Whether a method has trials under a preset.
pub(crate) fn has_trials(results: &Results, preset: &str, method: &str) -> bool {
    results.trials_of(preset, method).next().is_some()
}

/// Endings of the names of the columns that CSV has after a number.
pub(crate) const CSV_SUFFIXES: [&str; 3] = ["low", "high", "scenes"];

/// Endings of those that it also has after a time.
pub(crate) const CSV_TIME_SUFFIXES: [&str; 5] = ["mad", "machine", "busy", "scope", "device"];

/// Marks times measured on a busy machine.
pub(crate) const BUSY: &str = "§";

impl Cell {
    /// Whether it is a time measured while the machine was busy with something else.
    pub fn is_busy(&self) -> bool {
        self.timing.as_ref().is_some_and(|timing| timing.busy)
    }

    /// Whether it may be the best: not a time measured on a busy machine, nor a mean that lacks targets, or trials on which the
    /// method failed.
    pub(crate) fn is_rankable(&self) -> bool {
        !self.is_busy() && !self.lacks_trials && !self.counts.is_some_and(Counts::lacks_targets)
    }

    /// The printed text.
    pub fn print(&self, column: &Column) -> String {
        match (&self.value, &self.not_computed) {
            (Value::Number(number), _) if !self.marks().is_empty() => {
                format!("{} {}", column.format(*number), self.marks())
            }
            (Value::Number(number), _) => match self.interval.filter(|_| column.intervals) {
                Some([low, high]) => {
                    format!("{} [{}, {}]", column.format(*number), column.format(low), column.format(high))
                }
                None => column.format(*number),
            },
            (Value::Text(text), _) => text.clone(),
            (Value::Absent, Some(_)) => "n/c".to_owned(),
            (Value::Absent, None) => "–".to_owned(),
        }
    }
}

impl Column {
    /// Formats a number of the column as papers do.
    pub(crate) fn format(&self, value: f64) -> String {
        self.quantity.print(value, self.exact)
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

impl Row {
    /// The cell of a column; rows have a cell for every column of their table.
    pub(crate) fn cell(&self, CellIndex { group, column }: CellIndex) -> &Cell {
        &self.cells[group][column]
    }

    /// The protocol that was measured for a group of columns.
    pub(crate) fn protocol(&self, group: usize) -> Option<&StoreProtocol> {
        self.protocols.get(group)?.as_ref()
    }

    /// What was measured for a group of columns: one protocol, or that of each training.
    pub(crate) fn measured(&self, group: usize) -> Vec<&StoreProtocol> {
        let trainings = self.trainings.get(group).map(|protocols| protocols.iter().collect());
        trainings.unwrap_or_else(|| self.protocol(group).into_iter().collect())
    }

    /// Whether it is or reproduces the published row that `published` is.
    pub(crate) fn reproduces(&self, published: &Self) -> bool {
        self.published_row.is_some() && self.published_row == published.published_row
    }

    /// Whether it is a mean over several trainings.
    pub(crate) const fn is_over_trainings(&self) -> bool {
        !self.trainings.is_empty()
    }

    /// The labels that are not empty.
    pub(crate) fn names(&self) -> Vec<&str> {
        self.labels.iter().map(String::as_str).filter(|label| !label.is_empty()).collect()
    }

    /// `paper`, or what was measured.
    pub fn origin_text(&self) -> &str {
        self.measured_on.as_ref().map_or("paper", |measured_on| &measured_on.text)
    }

    /// The labels with the row's remarks after the last of them, as tables print them.
    pub fn printed_labels(&self) -> Vec<String> {
        let mut labels = self.labels.clone();
        let last = labels.iter().rposition(|label| !label.is_empty()).unwrap_or_default();
        if let Some(label) = labels.get_mut(last) {
            for remark in &self.remarks {
                label.push_str(if label.is_empty() { "" } else { ", " });
                label.push_str(remark);
            }
        }
        labels
    }
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
