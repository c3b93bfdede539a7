use std::fmt;

use serde::Serialize;

/// A step that changed no weights.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SkippedStep {
    /// The step.
    pub step: u64,
    /// The sample that caused it.
    pub sample: String,
    /// Why it was skipped.
    #[serde(rename = "what")]
    pub reason: FailureReason,
}

/// What went wrong with a sample, or with several that went through the network as one batch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SampleFailure {
    /// Name of the sample, or names.
    pub sample: String,
    /// What went wrong.
    pub reason: FailureReason,
}

/// Why a step cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FailureReason {
    /// An image contains NaN or infinite values.
    #[serde(rename = "image")]
    NonFiniteImage(String),
    /// The data source, the network or the renderer failed.
    #[serde(rename = "refused")]
    Error(String),
    /// A term of the loss is NaN or infinite.
    #[serde(rename = "term")]
    NonFiniteTerm(&'static str),
    /// Gradients are NaN or infinite; with the names of the first few parameters.
    #[serde(rename = "gradients")]
    NonFiniteGradients(Vec<String>),
}

/// Why a run was stopped: the last skipped steps, and which weights are not finite.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Diagnosis {
    /// Number of the latest steps that were skipped in a row.
    pub in_a_row: u32,
    /// These steps, oldest first, without those of before the run was resumed, which its log contains.
    #[serde(rename = "faults")]
    pub skipped: Vec<SkippedStep>,
    /// Parameters with values that are not finite, and how many values.
    pub parameters: Vec<(String, usize)>,
}

impl fmt::Display for FailureReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NonFiniteImage(which) => write!(f, "{which} is not finite"),
            Self::Error(why) => f.write_str(why),
            Self::NonFiniteTerm(name) => write!(f, "the loss term {name} is not finite"),
            Self::NonFiniteGradients(names) => write!(f, "gradients are not finite: {}", names.join(", ")),
        }
    }
}

impl fmt::Display for SkippedStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "step {}: {} ({})", self.step, self.reason, self.sample)
    }
}

impl fmt::Display for Diagnosis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "training stopped: {} steps in a row could not be used", self.in_a_row)?;
        match (self.in_a_row as usize).saturating_sub(self.skipped.len()) {
            0 => {}
            before => write!(f, ", {before} of them before the run was resumed")?,
        }
        for step in &self.skipped {
            write!(f, "\n  {step}")?;
        }
        match self.parameters.as_slice() {
            [] => f.write_str("\n  all weights are finite"),
            broken => broken.iter().take(8).try_for_each(|(name, count)| {
                write!(f, "\n  weights: {name} contains {count} values that are NaN or infinite")
            }),
        }
    }
}
