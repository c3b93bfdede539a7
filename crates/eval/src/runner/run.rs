use super::outdated::Outdated;
use super::pictures::Keeping;
use super::plan::{Plan, Summary};
use super::selection::Selected;
use super::walk::{Walk, groups};
use super::worst::{WorstSoFar, prune};
use super::{Findings, KeepPictures};
use crate::{EvalError, Results, Store, TargetStatus, TrialStatus, timing};

/// Runs a plan into a store, which was made or resumed with [`Plan::provenance`], and finishes it. Trials that are there
/// and asked the same question are not asked again. Where the plan wants times, a timing pass follows. `step` is called
/// [`Plan::steps`] times, from any thread. While other plans of this process are evaluated, the pass waits, and they for it.
///
/// # Errors
/// [`EvalError::Io`] where the store cannot be written; what was evaluated before is kept. [`EvalError::Settings`] for a timing
/// pass that is asked for on a rayon thread while something else is evaluated.
pub fn run(plan: &Plan<'_>, mut store: Store, step: &(dyn Fn() + Sync)) -> Result<(Results, Summary), EvalError> {
    let mut findings = Findings::default();
    let mut summary = Summary::default();
    let worst = WorstSoFar::default();
    let folder = store.folder().to_owned();
    let keeping = match plan.pictures {
        KeepPictures::Nothing => Keeping::Nothing,
        KeepPictures::Worst => Keeping::Worst(&folder, &worst),
        KeepPictures::All => Keeping::All(&folder),
    };
    let evaluating = timing::evaluating();
    for dataset in plan.datasets {
        let Selected { index, not_there } = plan.selected(dataset);
        summary.not_there += not_there.len() as u64;
        if let Some(first) = not_there.first() {
            findings.add(
                &dataset.name,
                "scenes of the index that are not in the data",
                not_there.len() as u64,
                first.clone(),
            );
        }
        let mut outdated = Outdated::of(plan, dataset, &store);
        for scene in &not_there {
            outdated.look_at_absent(scene);
        }
        outdated.refuse()?;
        for misfit in dataset.preset.misfits(&index, &dataset.index.sha256) {
            findings.add(&dataset.name, &misfit.kind, misfit.count, misfit.example);
        }
        for methods in groups(&dataset.preset, plan.methods) {
            let walk = Walk { plan, dataset, methods, store: &store, keeping, step };
            walk.run(&index, &mut findings, &mut summary)?;
        }
    }
    drop(evaluating);
    if let Some(timing) = plan.timing {
        timing::pass(plan, timing, &store, step)?;
    }
    let is_run = |preset: &str| plan.datasets.iter().any(|dataset| dataset.name == preset);
    let mut findings = findings.in_order();
    summary.skipped = findings.skipped.len() as u64;
    let before = store.provenance();
    findings.warnings.extend(before.warnings.iter().filter(|found| !is_run(&found.preset)).cloned());
    findings.skipped.extend(before.skipped.iter().filter(|found| !is_run(&found.preset)).cloned());
    let findings = findings.in_order();
    store.set_findings(findings);
    let results = store.finish()?;
    let incomplete = |status| matches!(status, TrialStatus::Failed | TrialStatus::Partial | TrialStatus::NotApplicable);
    summary.incomplete = results.trials.iter().filter(|trial| incomplete(trial.status)).count() as u64;
    let non_finite = |status| status == TargetStatus::NonFinite;
    summary.non_finite = results.targets.iter().filter(|target| non_finite(target.status)).count() as u64;
    if plan.pictures == KeepPictures::Worst {
        for dataset in plan.datasets {
            prune(&folder, &dataset.name, &results)?;
        }
    }
    Ok((results, summary))
}
