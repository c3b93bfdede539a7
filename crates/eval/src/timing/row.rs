use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Load, Machine};
use crate::rows::finite;
use crate::{EvalError, TrialKey};

/// How long one trial took under one method, on one machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TimingRow {
    /// Which trial.
    #[serde(flatten)]
    pub key: TrialKey,
    /// [`atsplat_protocol::trial::Trial::hash`] in hexadecimal.
    pub trial_hash: String,
    /// Where it was timed.
    pub machine: Machine,
    /// Seconds since 1970 when the pass began.
    pub started: u64,
    /// Trials of the protocol that could have been timed: with fewer than a pass wants, all were.
    pub trials_there: u64,
    /// Repetitions before those that count.
    pub warm_up: u32,
    /// Seconds from context pictures to Gaussians, one for each repetition; empty where the method encodes nothing.
    pub encode: Vec<f64>,
    /// Seconds of one picture each, repetition by repetition; empty where the method brings finished pictures.
    pub render: Vec<f64>,
    /// The stages of each encoding by name, one for each repetition.
    pub stages: BTreeMap<String, Vec<f64>>,
    /// Bytes of memory that the process held before.
    pub held_bytes: Option<u64>,
    /// The most bytes of memory that it held meanwhile.
    pub peak_bytes: Option<u64>,
    /// What else the machine did while the protocol was timed.
    pub load: Load,
    /// Why nothing was timed.
    pub detail: Option<String>,
}

impl TimingRow {
    /// Whether a time was measured.
    pub const fn is_timed(&self) -> bool {
        self.detail.is_none()
    }

    /// Repetitions that count.
    pub fn repetitions(&self) -> usize {
        if self.encode.is_empty() { self.render.len() } else { self.encode.len() }
    }

    /// # Errors
    /// [`EvalError::NotFinite`] for a time or a load that is no number.
    pub fn check(&self) -> Result<(), EvalError> {
        finite(&self.key, "encode-samples", self.encode.iter().copied())?;
        finite(&self.key, "render-samples", self.render.iter().copied())?;
        finite(&self.key, "stage-samples", self.stages.values().flatten().copied())?;
        finite(&self.key, "load", self.load.numbers().into_iter().flatten())
    }
}
