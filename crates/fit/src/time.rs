use serde::{Deserialize, Serialize};

use crate::Fit;

/// The time of a run, with that before it was resumed. Steps that were lost with a killed process do not count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Elapsed {
    /// Seconds of all steps after `since_step`, and of what happened between them.
    pub seconds: f64,
    /// 0, unless the run was resumed from a checkpoint of a version that recorded no time: then the step of that.
    pub since_step: u64,
}

impl Elapsed {
    /// Whether a run can have this time after a number of steps.
    pub(crate) fn is_possible(self, steps: u64) -> bool {
        self.seconds.is_finite() && self.seconds >= 0.0 && self.since_step <= steps
    }
}

impl Fit {
    /// The time so far, also before a resumption.
    pub fn elapsed(&self) -> Elapsed {
        Elapsed { seconds: self.before.seconds + self.begin.elapsed().as_secs_f64(), ..self.before }
    }
}
