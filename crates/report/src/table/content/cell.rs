//! A value of a table with its interval, counts and time, and how it is printed.

use atsplat_results::times::{Machine, Spread};
use serde::Serialize;

use super::{Column, Counts, StoreProtocol, TimeScope};

/// A value with its uncertainty and origin.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Cell {
    /// The value.
    pub value: Value,
    /// Whether a paper printed it.
    #[serde(skip)]
    pub published: bool,
    /// 95 % interval over scenes.
    pub interval: Option<[f64; 2]>,
    /// Whether it is a cost that the user states, and that was neither counted nor timed here.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub stated: bool,
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
    /// What was subtracted, if it is a paired difference.
    #[serde(skip)]
    pub difference: Option<Box<CellDifference>>,
}

/// What a paired difference is between.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CellDifference {
    /// What was measured for the row: one protocol, or that of each training.
    pub row: Vec<StoreProtocol>,
    /// What is subtracted from it.
    pub reference: StoreProtocol,
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

impl Cell {
    /// Whether it is a time measured while the machine was busy with something else.
    pub fn is_busy(&self) -> bool {
        self.timing.as_ref().is_some_and(|timing| timing.busy)
    }

    /// Whether it is a size that was stated; the machine of a stated time says so itself.
    pub(crate) const fn is_stated_count(&self) -> bool {
        self.stated && self.timing.is_none()
    }

    /// Whether it may be the best: not a time measured on a busy machine, nor a mean that lacks targets, or trials on which the
    /// method failed.
    pub(crate) fn is_rankable(&self) -> bool {
        !self.is_busy() && !self.lacks_results()
    }

    /// Whether it is a mean that lacks targets, or trials on which the method failed.
    pub(crate) fn lacks_results(&self) -> bool {
        self.lacks_trials || self.counts.is_some_and(Counts::lacks_targets)
    }

    /// The printed text.
    pub fn print(&self, column: &Column) -> String {
        match (&self.value, &self.not_computed) {
            (Value::Number(number), _) if self.published => column.format_as_papers(*number),
            (Value::Number(number), _) if !self.marks().is_empty() => {
                format!("{} {}", column.format(*number), self.marks())
            }
            (Value::Number(number), _) => match self.interval.filter(|_| column.intervals) {
                Some(interval) => {
                    let [number, low, high] = column.format_with(*number, interval);
                    format!("{number} [{low}, {high}]")
                }
                None => column.format(*number),
            },
            (Value::Text(text), _) => text.clone(),
            (Value::Absent, Some(_)) => "n/c".to_owned(),
            (Value::Absent, None) => "–".to_owned(),
        }
    }
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
