use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use atsplat_metrics::Suite;
use atsplat_metrics::learned::Lpips;
use atsplat_protocol::trial::{SkipReason, SkipReport, Skipped};
use atsplat_protocol::{DropReason, EvaluationIndex, Preset};
use atsplat_results::{Provenance, RunCounts, RunWarning, SkippedEntry, WarningCount};
use atsplat_scene::Warnings;

use super::{Dataset, Missing, Plan, Selection};
use crate::method::Method;

/// Problems with datasets that did not stop a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Findings {
    /// Warnings by preset and kind.
    pub warnings: Vec<WarningCount>,
    /// Index entries without a trial.
    pub skipped: Vec<SkippedEntry>,
}

/// What is wrong with the scenes of a dataset, counted once however often they are read: for methods with other poses, and to
/// find out what a store lacks.
#[derive(Clone, Debug, Default)]
pub(super) struct SceneWarnings(BTreeMap<String, Warnings>);

impl SceneWarnings {
    /// Adds the warnings of a scene, or of one of its entries, to those of the same reading.
    pub(super) fn add(&mut self, scene: &str, warnings: Warnings) {
        if warnings.total() > 0 {
            self.0.entry(scene.to_owned()).or_default().merge(warnings);
        }
    }

    /// Joins another reading of the dataset.
    pub(super) fn join(&mut self, reading: Self) {
        for (scene, warnings) in reading.0 {
            self.0.entry(scene).or_default().join(&warnings);
        }
    }

    /// All warnings, in the order of the index.
    pub(super) fn in_order_of(mut self, index: &EvaluationIndex) -> Warnings {
        let mut all = Warnings::new();
        for warnings in index.scenes.keys().filter_map(|scene| self.0.remove(scene)) {
            all.merge(warnings);
        }
        all
    }
}

impl Findings {
    /// Adds the warnings of a dataset under a preset.
    pub(super) fn add_warnings(&mut self, preset: &str, warnings: &Warnings) {
        for (kind, count, first) in warnings.summary() {
            self.add(preset, &kind.to_string(), count, first.to_string());
        }
    }

    /// Adds one kind of warning.
    pub(super) fn add(&mut self, preset: &str, kind: &str, count: u64, example: String) {
        match self.warnings.iter_mut().find(|known| known.preset == preset && known.kind == kind) {
            Some(known) => known.count += count,
            None => {
                self.warnings.push(WarningCount { preset: preset.to_owned(), kind: kind.to_owned(), count, example });
            }
        }
    }

    /// Adds the notices of a dataset's index, and counts what it misses. A shard counts a part of them, so that merged
    /// counts are those of one run.
    pub(super) fn add_notices(&mut self, dataset: &Dataset, selection: Selection, summary: &mut RunCounts) {
        for (kind, notice) in &dataset.index.notices {
            let count = selection.share_of(notice.count);
            if count > 0 {
                self.add(&dataset.name, kind, count, notice.example.clone());
            }
            match notice.missing {
                Missing::Nothing => {}
                Missing::Entries => summary.skipped += count,
                Missing::Data => summary.not_sampled += count,
            }
        }
    }

    /// Adds the methods that may need other settings than the preset's own, with which they run: those that name a method whose
    /// settings other presets state, and those for which nobody chose any, but that have the name of a method with others.
    pub(super) fn add_suspicious_settings(&mut self, dataset: &Dataset, methods: &[Arc<dyn Method>]) {
        let preset = &dataset.preset;
        for method in methods.iter().filter(|method| !preset.has_setting_of(method.setting())) {
            let (name, setting) = (method.record().name, method.setting());
            let kind = RunWarning::UnlistedSettings.about(&name);
            self.add(&dataset.name, &kind, 1, format!("{name} names {setting}"));
        }
        let differs = |name: &str| {
            preset.setting_for(name) != preset.setting_for(Preset::OWN_METHOD)
                || preset.renderer_overrides_of(name).is_some()
        };
        let not_chosen = methods.iter().filter(|method| method.has_no_chosen_setting());
        for name in not_chosen.map(|method| method.record().name).filter(|name| differs(name)) {
            let kind = RunWarning::SettingsNotChosen.about(&name);
            let of_preset = Preset::OWN_METHOD;
            let choice = format!("--setting {name} chooses its own, --setting {of_preset} keeps these");
            self.add(&dataset.name, &kind, 1, choice);
        }
    }

    /// Adds the networks of learned metrics with other weights than the published ones.
    pub(super) fn add_unpublished_weights(&mut self, dataset: &Dataset, suite: &Suite) {
        for example in suite.networks().loaded().filter_map(Lpips::unpublished) {
            self.add(&dataset.name, &RunWarning::UnpublishedWeights.to_string(), 1, example);
        }
    }

    /// Adds entries without a trial under these methods. Methods with different pose normalisations go through the same index;
    /// duplicates are removed by [`Self::with_earlier`].
    pub(super) fn add_skipped(&mut self, preset: &str, methods: &BTreeSet<String>, report: &SkipReport) {
        for Skipped { scene, entry_number, reason, detail, .. } in &report.skipped {
            let methods = if depends_on_poses(*reason) { methods.clone() } else { BTreeSet::new() };
            self.skipped.push(SkippedEntry {
                preset: preset.to_owned(),
                scene: scene.clone(),
                entry: super::group_run::to_u32(*entry_number),
                reason: reason.name().to_owned(),
                detail: detail.clone(),
                methods,
            });
        }
    }

    /// Number of index entries without a trial. Methods with other poses may give other reasons for one entry.
    pub(super) fn skipped_entries(&self) -> u64 {
        let entries = self.skipped.iter().map(|skipped| (&skipped.preset, &skipped.scene, skipped.entry));
        entries.collect::<BTreeSet<_>>().len() as u64
    }

    /// Adds what the store recorded before this run and is still true: about other protocols, and about other methods, whose rows
    /// are still there. Sorted and without duplicates: independent of how the work was divided.
    pub(super) fn with_earlier(mut self, plan: &Plan<'_>, earlier: &Provenance) -> Self {
        let methods = plan.method_names();
        let is_run = |preset: &str| plan.datasets.iter().any(|dataset| dataset.name == preset);
        let is_of_another_method = |kind: &str| RunWarning::method_of(kind).is_some_and(|name| !methods.contains(name));
        // With this run's protocols alone, files are not compared with those of the store's others.
        let has_others = earlier.presets.iter().any(|record| !is_run(&record.name));
        for warning in &earlier.warnings {
            let is_repeated =
                || self.warnings.iter().any(|known| (&known.preset, &known.kind) == (&warning.preset, &warning.kind));
            let is_shared = || has_others && RunWarning::SharedFiles.is_of(&warning.kind) && !is_repeated();
            if is_of_another_method(&warning.kind) || !is_run(&warning.preset) || is_shared() {
                self.warnings.push(warning.clone());
            }
        }
        for skipped in &earlier.skipped {
            if is_run(&skipped.preset) {
                self.skipped.extend(skipped.for_others(&methods));
            } else {
                self.skipped.push(skipped.clone());
            }
        }
        self.warnings.sort_by(|a, b| (&a.preset, &a.kind).cmp(&(&b.preset, &b.kind)));
        self.skipped = SkippedEntry::joined(self.skipped);
        self
    }
}

/// Whether an entry may be skipped for this reason under one method and have a trial under another.
pub(super) const fn depends_on_poses(reason: SkipReason) -> bool {
    matches!(reason, SkipReason::PoseNormalisation | SkipReason::Dropped(DropReason::Baseline))
}
