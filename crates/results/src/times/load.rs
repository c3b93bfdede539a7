use serde::{Deserialize, Serialize};

/// The machine's load while times were measured; `None` if the system does not report it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Load {
    /// Load average of the minute before.
    pub average_before: Option<f64>,
    /// Load average of the last minute at the end, including the threads of the pass.
    pub average_after: Option<f64>,
    /// Mean clock of the processors before, in MHz.
    pub mhz_before: Option<f64>,
    /// Mean clock of the processors at the end, in MHz.
    pub mhz_after: Option<f64>,
    /// The share of its processors that the pass lacked, from 0 to 1. Either what anything else used: other processes, other
    /// threads of this process, and other guests of the same host, of as many processors as the pass has threads. Or, if it is
    /// larger, the share of the time for which a quota withheld a processor.
    pub others: Option<f64>,
}

impl Load {
    /// From this share on, times are marked as unreliable. Below it, a pool with as many threads as the machine has processors
    /// is slowed by no more than the repetitions' own spread.
    pub const BUSY: f64 = 0.05;

    /// Whether the pass lacked so much that times cannot be trusted; `false` if the system does not report it.
    pub fn is_busy(&self) -> bool {
        self.others.is_some_and(|others| others >= Self::BUSY)
    }

    pub(super) const fn numbers(&self) -> [Option<f64>; 5] {
        let Self { average_before, average_after, mhz_before, mhz_after, others } = *self;
        [average_before, average_after, mhz_before, mhz_after, others]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_twentieth_of_its_processors_is_too_much() {
        let load = |others| Load { others, ..Load::default() };
        assert_eq!([None, Some(0.049), Some(0.051)].map(|others| load(others).is_busy()), [false, false, true]);
    }
}
