use atsplat_protocol::{EvaluationIndex, KnownIndex};
use atsplat_results::{Results, RunCounts, RunWarning, Store, TrialRow};

use super::findings::SceneWarnings;
use super::group_run::{GroupRun, groups};
use super::images_and_times::ImagesAndTimes;
use super::kept_images::{ChosenSoFar, ImageSink, prune};
use super::moved::check_moved;
use super::outdated::Outdated;
use super::plan::{Dataset, Plan};
use super::selection::Selected;
use super::{Findings, KeepImages};
use crate::{EvalError, timing};

/// One of the [`Plan::steps`] of a run.
#[derive(Clone, Copy, Debug)]
pub enum Step<'a> {
    /// Nothing was computed: the result was there before, or the entry has no trial.
    Nothing,
    /// A trial was evaluated, or a method was timed.
    Done,
    /// A trial was evaluated and failed, wholly or in part.
    Failed(&'a TrialRow),
}

/// Runs a plan into a store that was created or resumed with [`Plan::provenance`], and finishes the store. Up-to-date
/// results are not recomputed. If the plan has a timing pass, it follows the evaluation. `step` is called [`Plan::steps`]
/// times, from any thread. A timing pass and evaluations of other plans in this process wait for each other.
///
/// # Errors
/// [`EvalError::Io`] if the store or files for a method cannot be written, or a method's process cannot be started again; results so far
/// are kept. [`EvalError::Settings`] for a timing pass on a rayon thread while something else is evaluated.
pub fn run(plan: &Plan<'_>, store: Store, step: &(dyn Fn(Step<'_>) + Sync)) -> Result<(Results, RunCounts), EvalError> {
    run_until(plan, store, step, &|| false)
}

/// Like [`run`], but stops when `stop` returns true: the trials in progress are dropped; finished ones, and the times of
/// methods that were timed, stay in the store, which another run resumes.
///
/// # Errors
/// Those of [`run`], and [`EvalError::Stopped`].
pub fn run_until(
    plan: &Plan<'_>,
    mut store: Store,
    step: &(dyn Fn(Step<'_>) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(Results, RunCounts), EvalError> {
    let methods = plan.methods_of_scenes();
    let plan = &Plan { methods: &methods, ..*plan };
    let Progress { findings, mut summary, .. } = evaluate_datasets(plan, &store, step, stop)?;
    if let Some(timing) = plan.timing {
        timing::pass(plan, timing, &store, step, stop)?;
    }
    summary.skipped += findings.skipped_entries();
    let findings = findings.with_earlier(plan, store.provenance());
    store.set_findings(findings.warnings, findings.skipped);
    let folder = store.folder().to_owned();
    let results = store.finish_and(|results| -> Result<(), EvalError> {
        if plan.images == KeepImages::Worst {
            for dataset in plan.datasets {
                prune(&folder, dataset, results)?;
            }
        }
        Ok(())
    })?;
    summary.add_totals(&results);
    Ok((results, summary))
}

/// Evaluates every dataset under every method; without the timing pass.
fn evaluate_datasets(
    plan: &Plan<'_>,
    store: &Store,
    step: &(dyn Fn(Step<'_>) + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<Progress, EvalError> {
    let chosen = ChosenSoFar::default();
    let images = ImageSink { keep: plan.images, store: store.folder(), chosen: &chosen };
    let images_and_times = &ImagesAndTimes::of(store, plan.images)?;
    let _evaluating = timing::evaluating();
    let mut progress = Progress::default();
    check_moved(plan, store, stop)?;
    for dataset in plan.datasets {
        let Selected { index, missing, .. } = plan.selected(dataset);
        progress.add_missing_scenes(plan, dataset, &missing);
        check_missing_scenes(plan, dataset, store, &missing)?;
        progress.add_dataset(plan, dataset, &index);
        for methods in groups(&dataset.preset, plan.methods) {
            let group = GroupRun { plan, dataset, methods, store, images_and_times, images, step, stop };
            group.run(&index, &mut progress)?;
        }
        let warnings = std::mem::take(&mut progress.warnings);
        progress.findings.add_warnings(&dataset.name, &warnings.in_order_of(&index));
    }
    Ok(progress)
}

/// Results of scenes that are no longer in the data are an error.
fn check_missing_scenes(
    plan: &Plan<'_>,
    dataset: &Dataset,
    store: &Store,
    missing: &[String],
) -> Result<(), EvalError> {
    let mut outdated = Outdated::of(plan, dataset, store);
    for scene in missing {
        outdated.check_missing_scene(scene);
    }
    outdated.into_result()
}

/// What a run has found and counted so far.
#[derive(Debug, Default)]
pub(super) struct Progress {
    pub(super) findings: Findings,
    pub(super) summary: RunCounts,
    /// Warnings about the scenes of the current dataset.
    pub(super) warnings: SceneWarnings,
}

impl Progress {
    /// Adds the scenes of the index that the data lack. A shard counts a part of them, so that merged counts are those of one run.
    fn add_missing_scenes(&mut self, plan: &Plan<'_>, dataset: &Dataset, missing: &[String]) {
        let counted = plan.selection.part_of(missing);
        let count = counted.len() as u64;
        self.summary.missing_scenes += count;
        if let Some(first) = counted.first() {
            self.findings.add(&dataset.name, &RunWarning::MissingScenes.to_string(), count, first.clone());
        }
    }

    /// Adds what is known of a dataset, its index and its settings before it is evaluated.
    fn add_dataset(&mut self, plan: &Plan<'_>, dataset: &Dataset, index: &EvaluationIndex) {
        let Self { findings, summary, .. } = self;
        // Recognised by all of its entries, of which a shard has a part.
        let known = KnownIndex::by_content(&dataset.index.index.content_hash());
        let sha256 = known.map_or(dataset.index.sha256, |known| known.sha256);
        if let Some(foreign) = dataset.preset.foreign_index(&dataset.index.index, &sha256) {
            // A shard counts a part, also of the entries whose scenes the data lack.
            let count = plan.selection.share_of(foreign.count);
            if count > 0 {
                findings.add(&dataset.name, &foreign.kind, count, foreign.example);
            }
        }
        for mismatch in dataset.unfit_entries(index) {
            findings.add(&dataset.name, &mismatch.kind, mismatch.count, mismatch.example);
        }
        findings.add_notices(dataset, plan.selection, summary);
        findings.add_suspicious_settings(dataset, plan.methods);
        findings.add_shared_files(plan, dataset, index);
        findings.add_unpublished_weights(dataset, plan.suite);
    }
}
