//! Why a run evaluated nothing.

use std::collections::{BTreeMap, BTreeSet};

use atsplat_protocol::DropReason;
use atsplat_protocol::trial::SkipReason;
use atsplat_results::{Results, SkippedEntry, TargetRow, TargetStatus};

use super::{Dataset, Plan};

impl Plan<'_> {
    /// Why `results` have no scored target of this plan; `None` if they have one, and if the methods do not support any of the
    /// trials.
    pub fn nothing_evaluated(&self, results: &Results) -> Option<String> {
        let is_requested = self.requests();
        let requested: Vec<&TargetRow> = results.targets.iter().filter(|row| is_requested(row)).collect();
        if requested.iter().any(|row| matches!(row.status, TargetStatus::Scored | TargetStatus::Identical)) {
            return None;
        }
        let unsupported_keys = results.unsupported_keys();
        let (unsupported, failed): (Vec<&TargetRow>, Vec<&TargetRow>) =
            requested.into_iter().partition(|row| unsupported_keys.contains(&row.key));
        if let Some(first) = failed.first() {
            return Some(why_failed(&failed, first));
        }
        let reasons = || self.datasets.iter().map(|dataset| self.why_empty(dataset, results)).collect::<Vec<_>>();
        unsupported.is_empty().then(|| reasons().join("; "))
    }

    /// Whether this shard has no trial although its datasets have scenes of the index: it has no whole scene, or the protocol skips
    /// its entries. The run may be complete nevertheless, unless files of this shard cannot be read.
    pub fn is_shard_without_trials(&self, results: &Results) -> bool {
        let has_scenes = |dataset: &Dataset| {
            let index = &dataset.index.index;
            index.entries().count() > 0 && self.selected(dataset).missing.len() < index.scene_count()
        };
        let unreadable = [
            SkipReason::PoseUnusable.name(),
            SkipReason::ImageUnreadable.name(),
            DropReason::Unreadable.name(),
            DropReason::ImageMissing.name(),
            DropReason::SceneMissing.name(),
        ];
        self.selection.shard.is_some()
            && !results.targets.iter().any(self.requests())
            && !results.provenance.skipped.iter().any(|entry| unreadable.contains(&entry.reason.as_str()))
            && self.datasets.iter().any(has_scenes)
    }

    /// Whether a row is of a protocol and a method of this plan.
    fn requests(&self) -> impl Fn(&TargetRow) -> bool {
        let presets: BTreeSet<&str> = self.datasets.iter().map(|dataset| dataset.name.as_str()).collect();
        let methods = self.method_names();
        move |row| presets.contains(row.key.preset.as_str()) && methods.contains(&row.key.method)
    }

    fn why_empty(&self, dataset: &Dataset, results: &Results) -> String {
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
        let methods = self.method_names();
        let concerns = |skipped: &&SkippedEntry| methods.iter().any(|method| skipped.concerns(method));
        for skipped in results.provenance.skipped.iter().filter(|skipped| skipped.preset == *name).filter(concerns) {
            reasons.entry(&skipped.reason).or_insert((0, &skipped.detail)).0 += 1;
        }
        let reasons: Vec<String> =
            reasons.into_iter().map(|(reason, (count, first))| format!("{count} {reason} ({first})")).collect();
        format!("{name}: every entry was skipped: {}", reasons.join(", "))
    }
}

/// How targets without a score failed, the first of them with its reason.
fn why_failed(targets: &[&TargetRow], first: &TargetRow) -> String {
    let all = targets.len();
    let what = match targets.iter().filter(|row| row.status == TargetStatus::NonFinite).count() {
        0 => format!("all of {all} targets failed"),
        some if some == all => format!("all of {all} targets have non-finite samples"),
        some => format!("of {all} targets, {some} have non-finite samples and the others failed"),
    };
    format!("{what}, the first with: {}", first.detail.as_deref().unwrap_or("unknown reason"))
}
