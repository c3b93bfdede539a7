use std::fmt;

use serde::Serialize;

/// Why a step was skipped.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Fault {
    /// The step.
    pub step: u64,
    /// The sample that it happened on.
    pub sample: String,
    /// What happened.
    pub what: FaultKind,
}

/// What can make a step useless.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FaultKind {
    /// A picture holds NaN or infinities.
    Picture(String),
    /// The network or the splatter refused.
    Refused(String),
    /// A term of the loss is NaN or infinite.
    Term(&'static str),
    /// Gradients of parameters are NaN or infinite: of which, the first few.
    Gradients(Vec<String>),
}

/// Why a run was stopped: what went wrong last, and what is wrong with the weights.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Diagnosis {
    /// The faults in a row, oldest first.
    pub faults: Vec<Fault>,
    /// Parameters that are not finite, and how many of their numbers.
    pub parameters: Vec<(String, usize)>,
}

impl fmt::Display for FaultKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Picture(which) => write!(f, "{which} is not finite"),
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
        write!(f, "training stopped: {} steps in a row could not be used", self.faults.len())?;
        for fault in &self.faults {
            write!(f, "\n  {fault}")?;
        }
        match self.parameters.as_slice() {
            [] => f.write_str("\n  all weights are finite"),
            broken => broken.iter().take(8).try_for_each(|(name, count)| {
                write!(f, "\n  weights: {name} holds {count} numbers that are NaN or infinite")
            }),
        }
    }
}
