//! Targets of a baseline that have no score any more.

use std::collections::BTreeMap;

use atsplat_results::{PresetRecord, Results, SkippedEntry, TrialKey, TrialRow};

use super::Baseline;

impl Baseline {
    /// Its targets with a score that failed in the results, have samples that are not finite, or are not there although they were
    /// requested, each with the reason.
    pub fn lost_targets(&self, results: &Results) -> Vec<String> {
        let now: BTreeMap<(&TrialKey, u32), _> =
            results.targets.iter().map(|row| ((&row.key, row.target), (row.status, row.detail.as_deref()))).collect();
        let lost = self.targets.iter().filter(|then| then.status.is_scored()).filter_map(|then| {
            let why = match now.get(&(&then.key, then.target)) {
                Some((status, _)) if status.is_scored() => return None,
                Some((_, detail)) => detail.unwrap_or("no reason recorded").to_owned(),
                None => self.why_absent(&then.key, results)?,
            };
            Some(format!("{}, frame {}: {why}", then.key, then.frame))
        });
        lost.collect()
    }

    /// Why a trial has no rows although it was requested: it was skipped, or its scene is not in the data. `None` if another method,
    /// protocol, index or part of it was run.
    fn why_absent(&self, key: &TrialKey, results: &Results) -> Option<String> {
        let (then, now) = (&self.provenance, &results.provenance);
        now.method(&key.method)?;
        let preset = now.preset(&key.preset)?;
        let is_skipped = |one: &&SkippedEntry| {
            (&one.preset, &one.scene, one.entry) == (&key.preset, &key.scene, key.entry) && one.concerns(&key.method)
        };
        if let Some(skipped) = now.skipped.iter().find(is_skipped) {
            return Some(format!("skipped, {}: {}", skipped.reason, skipped.detail));
        }
        let has_same_index =
            |other: &PresetRecord| other.name == preset.name && other.index_sha256 == preset.index_sha256;
        let is_same_part =
            now.limit == then.limit && now.shard == then.shard && then.presets.iter().any(has_same_index);
        let is_there = |row: &TrialRow| (&row.key.preset, &row.key.scene) == (&key.preset, &key.scene);
        (is_same_part && !results.trials.iter().any(is_there)).then(|| "the scene was not evaluated".to_owned())
    }
}
