use serde::Serialize;

use crate::{Results, RunWarning, TargetStatus, TrialRow, TrialStatus};

/// Counts of a run's outcomes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct RunCounts {
    /// Trials evaluated in this run.
    pub evaluated: u64,
    /// Trials whose results were already in the store.
    pub resumed: u64,
    /// Trials, new and old, that failed or have failed targets, or failed when they were evaluated again.
    pub incomplete: u64,
    /// Trials, new and old, that their method does not support; they do not count as failures.
    pub not_applicable: u64,
    /// Targets, new and old, with non-finite samples.
    pub non_finite: u64,
    /// Trials, new and old, of whose Gaussians none contributes to any target's render.
    #[serde(rename = "undrawn")]
    pub empty_renders: u64,
    /// Index entries without a trial.
    pub skipped: u64,
    /// Scenes and frames of the data that are not in a sampled index: not read, without an entry, without an image.
    pub not_sampled: u64,
    /// Scenes of the indices that the datasets lack.
    #[serde(rename = "not-there")]
    pub missing_scenes: u64,
}

impl RunCounts {
    /// Counts the outcomes of all trials and targets of the store, new and old.
    pub fn add_totals(&mut self, results: &Results) {
        let trials =
            |is_counted: fn(&TrialRow) -> bool| results.trials.iter().filter(|row| is_counted(row)).count() as u64;
        let warnings = results.provenance.warnings.iter();
        let again = warnings.filter(|warning| RunWarning::FailedAgain.is_of(&warning.kind));
        self.incomplete =
            trials(|trial| trial.status.is_incomplete()) + again.map(|warning| warning.count).sum::<u64>();
        self.not_applicable = trials(|trial| trial.status == TrialStatus::NotApplicable);
        self.empty_renders = trials(TrialRow::renders_nothing);
        self.non_finite =
            results.targets.iter().filter(|target| target.status == TargetStatus::NonFinite).count() as u64;
    }
}
