use std::fmt;

use serde::Serialize;

/// Why a step was skipped.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Fault {
    /// The step.
    pub step: u64,
    /// The sample that caused it.
    pub sample: String,
    /// What went wrong.
    pub what: FaultKind,
}

/// What went wrong with a sample, or with several that went through the network as one batch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SampleFault {
    /// Name of the sample, or names.
    pub sample: String,
    /// What went wrong.
    pub what: FaultKind,
}

/// Why a step cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FaultKind {
    /// An image contains NaN or infinite values.
    Image(String),
    /// The data source, the network or the renderer failed.
    Refused(String),
    /// A term of the loss is NaN or infinite.
    Term(&'static str),
    /// Gradients are NaN or infinite; with the names of the first few parameters.
    Gradients(Vec<String>),
}

/// Why a run was stopped: its last faults, and which weights are not finite.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Diagnosis {
    /// Number of the latest steps that were skipped in a row.
    pub in_a_row: u32,
    /// Their faults, oldest first, without those of before the run was resumed, which its log contains.
    pub faults: Vec<Fault>,
    /// Parameters with values that are not finite, and how many values.
    pub parameters: Vec<(String, usize)>,
}

impl fmt::Display for FaultKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Image(which) => write!(f, "{which} is not finite"),
            Self::Refused(why) => f.write_str(why),
            Self::Term(name) => write!(f, "the loss term {name} is not finite"),
            Self::Gradients(names) => write!(f, "gradients are not finite: {}", names.join(", ")),
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "step {}: {} ({})", self.step, self.what, self.sample)
    }
}

impl fmt::Display for Diagnosis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "training stopped: {} steps in a row could not be used", self.in_a_row)?;
        match (self.in_a_row as usize).saturating_sub(self.faults.len()) {
            0 => {}
            before => write!(f, ", {before} of them before the run was resumed")?,
        }
        for fault in &self.faults {
            write!(f, "\n  {fault}")?;
        }
        match self.parameters.as_slice() {
            [] => f.write_str("\n  all weights are finite"),
            broken => broken.iter().take(8).try_for_each(|(name, count)| {
                write!(f, "\n  weights: {name} contains {count} values that are NaN or infinite")
            }),
        }
    }
}
