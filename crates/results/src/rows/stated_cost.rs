use serde::{Deserialize, Serialize};

use crate::times::Machine;

/// What images of another program cost, as their user states it: nothing here can count or time how they were made.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct StatedCost {
    /// Mean number of Gaussians of a trial.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gaussians: Option<u64>,
    /// Mean times of a trial.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<StatedSeconds>,
}

/// Mean seconds of a trial, and what measured them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct StatedSeconds {
    /// Seconds from context images to Gaussians, at least 0.
    pub encode: f64,
    /// Seconds per rendered image, at least 0; `None` if only the encoding is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub render: Option<f64>,
    /// The machine's name, such as `NVIDIA A100`.
    pub machine: String,
}

impl StatedCost {
    /// These costs, and those that were stated earlier and are not stated again.
    pub(super) fn or(self, earlier: Self) -> Self {
        Self { gaussians: self.gaussians.or(earlier.gaussians), seconds: self.seconds.or(earlier.seconds) }
    }
}

impl StatedSeconds {
    /// The machine; times that were stated for equal names are compared.
    pub fn machine(&self) -> Machine {
        Machine::stated(&self.machine)
    }
}
