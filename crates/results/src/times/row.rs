use std::collections::BTreeMap;

use atsplat_numeric::{mean, spread};
use serde::{Deserialize, Serialize};

use super::{Load, Machine};
use crate::rows::finite;
use crate::{ResultsError, TrialKey};

/// Images that each repetition renders.
const IMAGES: usize = 3;

/// The targets that each repetition renders, of this many.
pub fn rendered_targets(targets: usize) -> Vec<usize> {
    spread(targets, IMAGES)
}

/// Times of one trial under one method on one machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TimingRow {
    /// Preset, method, scene and entry.
    #[serde(flatten)]
    pub key: TrialKey,
    /// [`atsplat_protocol::trial::Trial::hash`] in hexadecimal.
    pub trial_hash: String,
    /// Times of different machines are never averaged.
    pub machine: Machine,
    /// The graphics adapter of the method's network; `None` on the CPU, without a network, and in rows of older versions.
    #[serde(default)]
    pub network_adapter: Option<String>,
    /// The graphics adapter that rendered; `None` on the CPU, without Gaussians, and in rows of older versions.
    #[serde(default)]
    pub renderer_adapter: Option<String>,
    /// Start of the pass in seconds since 1970.
    pub started: u64,
    /// Trials of the protocol; if a pass requests more, all of them are timed.
    pub trials_there: u64,
    /// Warm-up repetitions, which do not count.
    pub warm_up: u32,
    /// Seconds from context images to Gaussians, one per repetition; empty if the method encodes nothing.
    pub encode: Vec<f64>,
    /// Seconds of each rendered image, repetition by repetition; empty if the method imports finished images.
    pub render: Vec<f64>,
    /// Seconds of each encoding stage by name, one per repetition.
    pub stages: BTreeMap<String, Vec<f64>>,
    /// Memory of the process before, in bytes; `None` for a method that runs in other processes.
    pub held_bytes: Option<u64>,
    /// Peak memory of the process during the repetitions, or of the method's processes since they were started, in bytes.
    pub peak_bytes: Option<u64>,
    /// Load of the machine while this trial was timed, warm-up included; in rows of older versions, while the protocol was.
    pub load: Load,
    /// Why nothing was timed.
    pub detail: Option<String>,
}

impl TimingRow {
    /// Whether times were measured.
    pub const fn is_timed(&self) -> bool {
        self.detail.is_none()
    }

    /// Number of repetitions without warm-up of a trial with this many targets, of which each renders a few.
    pub fn repetitions(&self, targets: u32) -> usize {
        let images = rendered_targets(targets as usize).len();
        if self.encode.is_empty() { self.render.len().checked_div(images).unwrap_or(0) } else { self.encode.len() }
    }

    /// Seconds per image of each repetition, averaged over those that it renders of a trial with this many targets: they are
    /// different images, whose times differ without any repetition being slower.
    pub fn secs_per_image(&self, targets: u32) -> Vec<f64> {
        let images = rendered_targets(targets as usize).len().max(1);
        self.render.chunks(images).filter_map(|secs| mean(secs.iter().copied())).collect()
    }

    /// # Errors
    /// [`ResultsError::NotFinite`] for a time or load that is not finite; [`ResultsError::Invalid`] for stages with different
    /// numbers of samples, which a store could not tell apart.
    pub fn check(&self) -> Result<(), ResultsError> {
        let mut counts = self.stages.values().map(Vec::len);
        if let Some(first) = counts.next()
            && let Some(other) = counts.find(|count| *count != first)
        {
            let expected = "the same number of samples for each stage".to_owned();
            let found = format!("{first} and {other} ({})", self.key);
            return Err(ResultsError::Invalid { what: "stage-samples", expected, found });
        }
        finite(&self.key, "encode-samples", self.encode.iter().copied())?;
        finite(&self.key, "render-samples", self.render.iter().copied())?;
        finite(&self.key, "stage-samples", self.stages.values().flatten().copied())?;
        finite(&self.key, "load", self.load.numbers().into_iter().flatten())
    }
}

/// Merges the rows of several stores, ordered by key, machine and pass. Times of different machines and passes differ, but
/// rows of the same trial, machine and pass must be equal.
///
/// # Errors
/// [`ResultsError::Disagreement`].
pub(crate) fn merged(rows: impl IntoIterator<Item = TimingRow>) -> Result<Vec<TimingRow>, ResultsError> {
    let mut merged: BTreeMap<_, TimingRow> = BTreeMap::new();
    for row in rows {
        let identity = (row.key.clone(), row.machine.clone(), row.started);
        match merged.get(&identity) {
            Some(known) if *known != row => {
                let times = |row: &TimingRow| format!("{:?} and {:?} s", row.encode, row.render);
                return Err(ResultsError::Disagreement {
                    key: row.key.to_string(),
                    field: format!("the times of one pass on {}", row.machine),
                    first: times(known),
                    second: times(&row),
                });
            }
            Some(_) => {}
            None => drop(merged.insert(identity, row)),
        }
    }
    Ok(merged.into_values().collect())
}

#[cfg(test)]
mod tests {
    use crate::sample_rows::timing;

    /// A store has the samples of all stages in one list.
    #[test]
    fn stages_have_equally_many_samples() {
        let mut row = timing("a", "x", &[1.0, 2.0], &[0.5]);
        row.stages = [("one".to_owned(), vec![0.5; 3]), ("two".to_owned(), vec![0.25; 3])].into();
        row.check().unwrap();
        row.stages.insert("two".to_owned(), vec![0.25; 5]);
        let why = row.check().unwrap_err().to_string();
        assert!(why.contains("stage-samples") && why.contains("3 and 5"), "{why}");
    }
}
