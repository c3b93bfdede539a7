use std::collections::BTreeSet;

use atsplat_protocol::KnownIndex;

use super::findings::{SceneWarnings, is_of_another_method};
use super::group_run::{GroupRun, groups};
use super::images::ImageSink;
use super::images_and_times::ImagesAndTimes;
use super::outdated::Outdated;
use super::plan::{Plan, Summary};
use super::selection::Selected;
use super::worst::{WorstSoFar, prune};
use super::{Findings, KeepImages};
use crate::{EvalError, Results, SkippedEntry, Store, TargetStatus, WarningCount, timing};

/// The kind of the warning about scenes of an index that the data lack.
pub const MISSING_SCENES: &str = "scenes of the index that are not in the data";

/// Runs a plan into a store that was created or resumed with [`Plan::provenance`], and finishes the store. Up-to-date
/// results are not recomputed. If the plan has a timing pass, it follows the evaluation. `step` is called [`Plan::steps`]
/// times, from any thread. A timing pass and evaluations of other plans in this process wait for each other.
///
/// # Errors
/// [`EvalError::Io`] if the store cannot be written; results so far are kept. [`EvalError::Settings`] for a timing pass on a
/// rayon thread while something else is evaluated.
pub fn run(plan: &Plan<'_>, store: Store, step: &(dyn Fn() + Sync)) -> Result<(Results, Summary), EvalError> {
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
    step: &(dyn Fn() + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(Results, Summary), EvalError> {
    let methods = plan.methods_of_scenes();
    let plan = &Plan { methods: &methods, ..*plan };
    let mut findings = Findings::default();
    let mut summary = Summary::default();
    let worst = WorstSoFar::default();
    let folder = store.folder().to_owned();
    let images = ImageSink { keep: plan.images, store: &folder, worst: &worst };
    let images_and_times = ImagesAndTimes::of(&store, plan.images)?;
    let evaluating = timing::evaluating();
    for dataset in plan.datasets {
        let Selected { index, missing } = plan.selected(dataset);
        // A shard counts a part of them, so that merged counts are those of one run.
        let counted = plan.selection.part_of(&missing);
        summary.missing_scenes += counted.len() as u64;
        if let Some(first) = counted.first() {
            findings.add(&dataset.name, MISSING_SCENES, counted.len() as u64, first.clone());
        }
        let mut outdated = Outdated::of(plan, dataset, &store);
        for scene in &missing {
            outdated.check_missing_scene(scene);
        }
        outdated.into_result()?;
        // Recognised by all of its entries, of which a shard has a part.
        let known = KnownIndex::by_content(&dataset.index.index.content_hash());
        let sha256 = known.map_or(dataset.index.sha256, |known| known.sha256);
        for mismatch in dataset.preset.mismatches(&index, &sha256) {
            findings.add(&dataset.name, &mismatch.kind, mismatch.count, mismatch.example);
        }
        findings.add_notices(dataset, plan.selection, &mut summary);
        findings.add_unlisted_settings(dataset, plan.methods);
        findings.add_unpublished_weights(dataset, plan.suite);
        let mut warnings = SceneWarnings::default();
        for methods in groups(&dataset.preset, plan.methods) {
            let group = GroupRun {
                plan,
                dataset,
                methods,
                store: &store,
                images_and_times: &images_and_times,
                images,
                step,
                stop,
            };
            group.run(&index, &mut warnings, &mut findings, &mut summary)?;
        }
        findings.add_warnings(&dataset.name, &warnings.in_order_of(&index));
    }
    drop((images_and_times, evaluating));
    if let Some(timing) = plan.timing {
        timing::pass(plan, timing, &store, step, stop)?;
    }
    let is_run = |preset: &str| plan.datasets.iter().any(|dataset| dataset.name == preset);
    let mut findings = findings.in_order();
    // Methods with other poses may give other reasons for one entry.
    let skipped = findings.skipped.iter().map(|skipped| (&skipped.preset, &skipped.scene, skipped.entry));
    summary.skipped += skipped.collect::<BTreeSet<_>>().len() as u64;
    let before = store.provenance();
    let own: BTreeSet<String> = plan.methods.iter().map(|method| method.record().name).collect();
    // The rows of other methods are still there.
    let stays = |found: &&WarningCount| !is_run(&found.preset) || is_of_another_method(&found.kind, &own);
    findings.warnings.extend(before.warnings.iter().filter(stays).cloned());
    let kept = |found: &SkippedEntry| if is_run(&found.preset) { found.for_others(&own) } else { Some(found.clone()) };
    findings.skipped.extend(before.skipped.iter().filter_map(kept));
    let findings = findings.in_order();
    store.set_findings(findings);
    let results = store.finish()?;
    summary.incomplete = results.trials.iter().filter(|trial| trial.status.is_incomplete()).count() as u64;
    summary.not_applicable = results.not_applicable().count() as u64;
    let non_finite = |status| status == TargetStatus::NonFinite;
    summary.non_finite = results.targets.iter().filter(|target| non_finite(target.status)).count() as u64;
    summary.undrawn = results.trials.iter().filter(|trial| trial.draws_nothing()).count() as u64;
    if plan.images == KeepImages::Worst {
        for dataset in plan.datasets {
            prune(&folder, dataset, &results)?;
        }
    }
    Ok((results, summary))
}
