//! Checks before and after a run: whether imported files exist, and why nothing was evaluated.

use std::collections::BTreeMap;

use super::{Plan, spread};
use crate::method::{FoundFiles, RequestedScene};
use crate::{EvalError, Results, SkippedEntry, TargetRow, TargetStatus};

/// Scenes per dataset whose imported files are looked for before the run.
const CHECKED_SCENES: usize = 32;

impl Plan<'_> {
    /// Where the files of each imported method are.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for a folder without any scene of the datasets.
    pub fn find_imported_files(&self) -> Result<Vec<FoundFiles>, EvalError> {
        let indices: Vec<_> = self.datasets.iter().map(|dataset| self.selected(dataset).index).collect();
        let mut requested: Vec<RequestedScene<'_>> = Vec::new();
        for index in &indices {
            for at in spread(index.scenes.len(), CHECKED_SCENES) {
                let entry = index.scenes.get_index(at).and_then(|(scene, entries)| Some((scene, entries.first()?)));
                requested.extend(entry.map(|(scene, entry)| RequestedScene { scene, frames: &entry.target }));
            }
        }
        let methods = self.methods_of_scenes();
        let found: Vec<FoundFiles> = methods.iter().filter_map(|method| method.find_files(&requested)).collect();
        found.iter().try_for_each(FoundFiles::check)?;
        Ok(found)
    }

    /// Why `results` hold no scored target of this plan; `None` if they hold one, and if the methods do not support any of the
    /// trials.
    pub fn nothing_evaluated(&self, results: &Results) -> Option<String> {
        let is_own = |row: &&TargetRow| {
            self.datasets.iter().any(|dataset| dataset.name == row.key.preset)
                && self.methods.iter().any(|method| method.record().name == row.key.method)
        };
        let own: Vec<&TargetRow> = results.targets.iter().filter(is_own).collect();
        if own.iter().any(|row| matches!(row.status, TargetStatus::Scored | TargetStatus::Identical)) {
            return None;
        }
        let unsupported = results.unsupported();
        let (unsupported, own): (Vec<&TargetRow>, Vec<&TargetRow>) =
            own.into_iter().partition(|row| unsupported.contains(&row.key));
        if own.is_empty() && !unsupported.is_empty() {
            return None;
        }
        if let Some(first) = own.first() {
            let why = first.detail.as_deref().unwrap_or("unknown reason");
            let all = own.len();
            let what = match own.iter().filter(|row| row.status == TargetStatus::NonFinite).count() {
                0 => format!("all of {all} targets failed"),
                some if some == all => format!("all of {all} targets have non-finite samples"),
                some => format!("of {all} targets, {some} have non-finite samples and the others failed"),
            };
            return Some(format!("{what}, the first with: {why}"));
        }
        let reasons: Vec<String> = self.datasets.iter().map(|dataset| self.why_empty(dataset, results)).collect();
        Some(reasons.join("; "))
    }

    fn why_empty(&self, dataset: &super::Dataset, results: &Results) -> String {
        let (name, index) = (&dataset.name, &dataset.index.index);
        let entries = index.entries().count();
        if entries == 0 {
            return format!("{name}: the index has no entry ({})", dataset.index.description);
        }
        let selected = self.selected(dataset);
        let present = index.scene_count() - selected.missing.len();
        if let Some(first) = selected.missing.first().filter(|_| present == 0) {
            return format!("{name}: none of the index's scenes is in {}: {first}, …", dataset.description);
        }
        if let Some(shard) = self.selection.shard.filter(|_| selected.index.scenes.is_empty()) {
            return format!("{name}: shard {} of {} of {present} scenes is empty", shard.number, shard.count);
        }
        let mut reasons: BTreeMap<&str, (usize, &str)> = BTreeMap::new();
        let concerns =
            |skipped: &&SkippedEntry| self.methods.iter().any(|method| skipped.concerns(&method.record().name));
        for skipped in results.provenance.skipped.iter().filter(|skipped| skipped.preset == *name).filter(concerns) {
            reasons.entry(&skipped.reason).or_insert((0, &skipped.detail)).0 += 1;
        }
        let reasons: Vec<String> =
            reasons.into_iter().map(|(reason, (count, first))| format!("{count} {reason} ({first})")).collect();
        if reasons.is_empty() {
            return format!("{name}: none of {entries} entries has a target");
        }
        format!("{name}: every entry was skipped: {}", reasons.join(", "))
    }
}
