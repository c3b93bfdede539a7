//! Whether two stores evaluated the same images and cameras.

use std::collections::BTreeMap;

use atsplat_results::Results;

/// Whether the trials that two stores have in common, each under a preset of this name, read the same images and cameras.
pub(crate) fn is_same_data(stores: [(&Results, &str); 2]) -> bool {
    trials_of_other_data(stores).is_empty()
}

/// Scene and entry of the trials that two stores have in common, but with different images or cameras.
pub(super) fn trials_of_other_data<'a>(stores: [(&'a Results, &str); 2]) -> Vec<(&'a str, u32)> {
    let lacks_hash = |(results, preset): &(&Results, &str)| {
        results.trials.iter().any(|trial| trial.key.preset == *preset && trial.data_hash.is_none())
    };
    let with_truths = stores.iter().any(lacks_hash);
    let [first, second] = stores.map(|(results, preset)| data_of_trials(results, preset, with_truths));
    let differs = |(trial, data): &(&(&str, u32), &TrialData<'_>)| {
        first.get(*trial).is_some_and(|known| known.differs_from(data))
    };
    second.iter().filter(differs).map(|(trial, _)| *trial).collect()
}

/// What tells the data of a trial from others.
#[derive(Default)]
struct TrialData<'a> {
    /// The hash of its images and cameras; `None` in stores that are older than this hash.
    hash: Option<&'a str>,
    /// The hashes of its ground truths by number of the target.
    truths: BTreeMap<u32, &'a str>,
}

impl TrialData<'_> {
    /// Without both hashes of the data, ground truths tell.
    fn differs_from(&self, other: &TrialData<'_>) -> bool {
        if let (Some(hash), Some(known)) = (self.hash, other.hash) {
            return hash != known;
        }
        self.truths.iter().any(|(target, truth)| other.truths.get(target).is_some_and(|known| known != truth))
    }
}

fn data_of_trials<'a>(
    results: &'a Results,
    preset: &str,
    with_truths: bool,
) -> BTreeMap<(&'a str, u32), TrialData<'a>> {
    let mut data: BTreeMap<(&str, u32), TrialData<'_>> = BTreeMap::new();
    for trial in results.trials.iter().filter(|trial| trial.key.preset == preset) {
        let known = data.entry((trial.key.scene.as_str(), trial.key.entry)).or_default();
        known.hash = trial.data_hash.as_deref().or(known.hash);
    }
    for row in results.targets.iter().filter(|row| with_truths && row.key.preset == preset) {
        if let Some(truth) = row.truth_hash.as_deref() {
            data.entry((row.key.scene.as_str(), row.key.entry)).or_default().truths.insert(row.target, truth);
        }
    }
    data
}
