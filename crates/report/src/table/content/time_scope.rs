//! What a time covers, and the marks and words that say so.

use serde::Serialize;

use super::{Cell, CellTiming};
use crate::counted;

/// Marks times measured on a busy machine.
pub(crate) const BUSY: &str = "§";

/// What the time of a method in a separate process covers; other methods are timed while they encode, within this process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum TimeScope {
    /// Its stage `encode`, as the method states it on every repetition of every timed trial.
    #[serde(rename = "as the method states")]
    Stated,
    /// Everything from the request to an answer that has been read.
    #[serde(rename = "the whole answer, with reading and writing of files")]
    WholeAnswer,
}

impl TimeScope {
    /// The mark of such times.
    pub(crate) const fn mark(self) -> &'static str {
        match self {
            Self::Stated => "†",
            Self::WholeAnswer => "‡",
        }
    }

    /// The mark with its remark.
    pub(crate) fn explained(self) -> String {
        format!("{} {}", self.mark(), self.remark())
    }

    /// The remark that the mark stands for.
    pub const fn remark(self) -> &'static str {
        match self {
            Self::Stated => "as the method states",
            Self::WholeAnswer => "the whole answer, with reading and writing of files",
        }
    }
}

impl Cell {
    /// What its time covers, if it is that of a method in a separate process.
    pub fn time_scope(&self) -> Option<TimeScope> {
        self.timing.as_ref()?.scope
    }

    /// The marks of its time, each explained below the table.
    pub(crate) fn marks(&self) -> String {
        let busy = self.is_busy().then_some(BUSY);
        self.time_scope().map(TimeScope::mark).into_iter().chain(busy).collect::<Vec<_>>().join(" ")
    }
}

/// What the mark of a busy machine stands for; `others` is the share of its processors that a timing did not have.
pub(in crate::table) fn was_busy(others: f64) -> String {
    format!("other work or a quota took {:.0} % of the processors", 100.0 * others)
}

impl CellTiming {
    /// The quartiles over repetitions; `None` for a time that was stated, which is a single number.
    pub(crate) fn quartiles(&self) -> Option<[f64; 2]> {
        (!self.machine.is_stated()).then_some(self.spread.quartiles)
    }

    /// What a time says next to its number: over what it is the median, and the meaning of its marks.
    pub(crate) fn in_words(&self, print: impl Fn(f64) -> String) -> String {
        let Some(quartiles) = self.quartiles() else { return ", as stated".to_owned() };
        let [low, high] = quartiles.map(print);
        let (trials, repetitions) = (counted(self.trials, "trial"), self.repetitions);
        let mut text =
            format!(", median averaged over {trials} with {repetitions} repetitions each, quartiles {low} to {high}");
        if let Some(scope) = self.scope {
            text.push_str(&format!(", {}", scope.remark()));
        }
        if self.busy {
            text.push_str(&format!(", unreliable: {}", was_busy(self.others.unwrap_or_default())));
        }
        text
    }
}
