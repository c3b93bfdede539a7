//! The rows of a results store.

mod adapter;
mod additions;
pub(crate) mod difference;
mod join;
mod parameters;
mod place;
mod provenance;
mod record_kind;
mod stated_cost;
mod target;
mod trial;

use std::collections::BTreeSet;
use std::fmt;

use serde::{Deserialize, Serialize};

pub use adapter::AdapterRecord;
pub(crate) use adapter::placement;
pub(crate) use join::Shards;
pub use place::{Moved, SAMPLED_BY};
pub use provenance::{
    MethodRecord, MetricRecord, PresetRecord, Provenance, SkippedEntry, TRAINED_BACKGROUND, TRAINED_POSES,
    TrainingRecord, WarningCount,
};
pub use record_kind::RecordKind;
pub use stated_cost::{StatedCost, StatedSeconds};
pub(crate) use target::ADDED_LATER;
pub use target::{IDENTICAL, TargetRow, TargetStatus, WEIGHTS_ABSENT};
pub use trial::{TrialRow, TrialStatus};

use crate::ResultsError;
use crate::times::TimingRow;

/// Identity of a trial's rows in a store: the trial and the method.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct TrialKey {
    /// Name of the protocol preset, as in [`PresetRecord::name`].
    pub preset: String,
    /// Name of the method, as in [`MethodRecord::name`].
    pub method: String,
    /// Key of the scene in its dataset.
    pub scene: String,
    /// Position of the index entry among the scene's entries.
    pub entry: u32,
}

/// Identity of a trial of a protocol, under any method.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TrialId {
    /// As in [`TrialKey::preset`].
    pub preset: String,
    /// As in [`TrialKey::scene`].
    pub scene: String,
    /// As in [`TrialKey::entry`].
    pub entry: u32,
}

/// All rows of a store, in the order of their keys (targets by position within).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Results {
    /// What was run, how and where.
    pub provenance: Provenance,
    /// One row per trial and method.
    pub trials: Vec<TrialRow>,
    /// One row per target view of these trials.
    pub targets: Vec<TargetRow>,
    /// Times of some of these trials, by machine and timing pass; empty without a timing pass.
    pub timings: Vec<TimingRow>,
}

impl Results {
    /// The trials of one method under one preset, by their names.
    pub fn trials_of(&self, preset: &str, method: &str) -> impl Iterator<Item = &TrialRow> {
        self.trials.iter().filter(move |trial| trial.key.is_of(preset, method))
    }

    /// The targets of one method under one preset, by their names.
    pub fn targets_of(&self, preset: &str, method: &str) -> impl Iterator<Item = &TargetRow> {
        self.targets.iter().filter(move |target| target.key.is_of(preset, method))
    }

    /// The number of Gaussians of a trial, or the mean that was stated for its method and preset; `None` if neither is known.
    pub(crate) fn gaussians_of(&self, trial: &TrialRow) -> Option<u64> {
        let TrialKey { preset, method, .. } = &trial.key;
        trial.gaussians.or_else(|| self.provenance.method(method)?.stated.get(preset)?.gaussians)
    }

    /// The trials that their method does not support. Their targets have no scores, which does not count as a failure.
    pub(crate) fn unsupported_trials(&self) -> impl Iterator<Item = &TrialRow> {
        self.trials.iter().filter(|trial| trial.status == TrialStatus::NotApplicable)
    }

    /// The keys of the trials that their method does not support, to tell their targets apart from failed ones.
    pub fn unsupported_keys(&self) -> BTreeSet<&TrialKey> {
        self.unsupported_trials().map(|trial| &trial.key).collect()
    }
}

impl TrialId {
    /// The trial under a method.
    pub fn of_method(&self, method: &str) -> TrialKey {
        let Self { preset, scene, entry } = self.clone();
        TrialKey { preset, method: method.to_owned(), scene, entry }
    }
}

impl TrialKey {
    /// The trial without its method.
    pub fn trial(&self) -> TrialId {
        TrialId { preset: self.preset.clone(), scene: self.scene.clone(), entry: self.entry }
    }

    /// Whether it is a trial of this method under this preset.
    pub fn is_of(&self, preset: &str, method: &str) -> bool {
        self.preset == preset && self.method == method
    }

    /// The same trial under another method.
    #[must_use]
    pub fn of_method(&self, method: &str) -> Self {
        Self { method: method.to_owned(), ..self.clone() }
    }
}

impl fmt::Display for TrialKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { preset, method, scene, entry } = self;
        write!(f, "{method} on {preset}, scene {scene:?}, entry {entry}")
    }
}

/// A field of a row with an impossible value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Impossible {
    pub(crate) field: String,
    pub(crate) expected: String,
    pub(crate) found: String,
}

impl Impossible {
    /// If a finite number is outside its range. Those that are NaN or infinite are counted where rows are read.
    pub(crate) fn unless_within(field: &str, value: Option<f64>, [least, most]: [f64; 2]) -> Option<Self> {
        let value = value.filter(|value| value.is_finite() && !(least..=most).contains(value))?;
        let expected = if most.is_finite() { format!("{least} to {most}") } else { format!("at least {least}") };
        Some(Self { field: field.to_owned(), expected, found: value.to_string() })
    }

    pub(crate) fn of_row(self, key: &TrialKey) -> ResultsError {
        let Self { field, expected, found } = self;
        ResultsError::Impossible { key: key.to_string(), field, expected, found }
    }
}

/// Rejects NaN and infinities.
pub(crate) fn finite(key: &TrialKey, field: &str, value: impl IntoIterator<Item = f64>) -> Result<(), ResultsError> {
    match value.into_iter().find(|value| !value.is_finite()) {
        None => Ok(()),
        Some(value) => Err(ResultsError::NotFinite { key: key.to_string(), field: field.to_owned(), value }),
    }
}

#[cfg(test)]
mod tests {
    use crate::sample_rows::{self, PRESET};

    #[test]
    fn rows_are_of_their_preset_and_method() {
        let mut results = sample_rows::results("a", "psnr", &[("x", 0, vec![20.0, 30.0])]);
        let other = sample_rows::results("b", "psnr", &[("x", 0, vec![25.0])]);
        results.trials.extend(other.trials);
        results.targets.extend(other.targets);
        let counts = |preset: &str, method: &str| {
            (results.trials_of(preset, method).count(), results.targets_of(preset, method).count())
        };
        assert_eq!((counts(PRESET, "a"), counts(PRESET, "b"), counts("a", PRESET)), ((1, 2), (1, 1), (0, 0)));
    }
}
