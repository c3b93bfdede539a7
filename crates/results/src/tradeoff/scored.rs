//! The methods of a store as samples, with everything by which they are compared.

use std::collections::{BTreeMap, BTreeSet};

use atsplat_numeric::{counted, mean};
use atsplat_protocol::Aggregation;

use super::unscored::why_unscored;
use super::{Counts, Note, Sample, Seconds};
use crate::statistics::{Identical, Leaked, MetricQuery, SelectedTarget, cost, select, summary_without_interval};
use crate::times::{GAUSSIANS_UNTIMED, Machine, times_on};
use crate::{MethodRecord, Results, TrialKey, TrialRow};

/// Scene and entry: a trial under any protocol.
type TrialId<'a> = (&'a str, u32);

/// A setting with everything by which it is compared.
#[derive(Debug)]
pub(super) struct Scored<'a> {
    pub(super) sample: Sample,
    pub(super) selected: Vec<SelectedTarget<'a>>,
    /// Gaussians of each trial with results.
    gaussians: BTreeMap<TrialId<'a>, u64>,
    /// The trials that were timed; empty if the sample has no seconds.
    timed: BTreeSet<(String, u32)>,
    /// The machines on which it was optimised for a time.
    optimised_on: BTreeSet<&'a str>,
    /// Whether its number of Gaussians was stated, not counted.
    states_gaussians: bool,
    /// Whether its seconds were stated without those of a rendered image.
    lacks_rendering: bool,
}

/// The methods that were run under a preset as samples with their targets, in the order of the provenance record.
///
/// Seconds come from the timing pass: the time to the first image ([`crate::times::Times::first_image`]). Times on other machines
/// than `machine` are left out.
pub(super) fn scored<'a>(
    results: &'a Results,
    machine: Option<&Machine>,
    preset: &'a str,
    metric: &'a str,
    leaked: Leaked,
    aggregation: Aggregation,
) -> Vec<Scored<'a>> {
    let scored = |record: &'a MethodRecord| {
        let method = record.name.as_str();
        let cost = cost(results, preset, method);
        let query = MetricQuery { preset, method, metric, leaked, identical: Identical::Excluded };
        let selected = select(results, &query);
        let summary = summary_without_interval(&selected, aggregation);
        let (secs, timed) = match seconds(results, machine, preset, record) {
            Ok((secs, timed)) => (Ok(secs), timed),
            Err(reason) => (Err(reason), BTreeSet::new()),
        };
        let sample = Sample {
            label: method.to_owned(),
            quality: summary.mean.ok_or_else(|| why_unscored(results, &query, &summary)),
            secs,
            gaussians: cost.gaussians,
            counts: Counts {
                scenes: summary.scenes,
                targets: summary.targets,
                failed: summary.failed,
                not_applicable: summary.not_applicable,
                non_finite: summary.non_finite,
                uncomputed: summary.uncomputed,
                identical: summary.identical,
            },
        };
        let gaussians = gaussians(results, preset, method);
        let optimised_on = results.optimised_on(preset, method);
        let has_trials = cost.trials + cost.failed + cost.not_applicable > 0;
        let stated = record.stated.get(preset);
        let states_gaussians = stated.is_some_and(|stated| stated.gaussians.is_some());
        let seconds = stated.and_then(|stated| stated.seconds.as_ref()).filter(|_| sample.secs.is_ok());
        let lacks_rendering = seconds.is_some_and(|seconds| seconds.render.is_none());
        has_trials.then_some(Scored {
            sample,
            selected,
            gaussians,
            timed,
            optimised_on,
            states_gaussians,
            lacks_rendering,
        })
    };
    results.provenance.methods.iter().filter_map(scored).collect()
}

/// The seconds of a method with the trials that they are of, or why there are none.
fn seconds(
    results: &Results,
    machine: Option<&Machine>,
    preset: &str,
    method: &MethodRecord,
) -> Result<(Seconds, BTreeSet<(String, u32)>), String> {
    let times = times_on(machine, results, preset, &method.name)?;
    let first_image = times.first_image.ok_or(GAUSSIANS_UNTIMED)?;
    let timed = if times.machine.is_stated() {
        // A mean over all trials.
        let trials = with_results(results, preset, &method.name);
        trials.map(|trial| (trial.key.scene.clone(), trial.key.entry)).collect()
    } else {
        times.timed
    };
    let seconds = Seconds {
        median: first_image.median,
        error: first_image.error,
        busy: times.busy,
        whole_answer: method.is_process() && times.encode.is_some(),
        device: times.device,
    };
    Ok((seconds, timed))
}

fn id(key: &TrialKey) -> TrialId<'_> {
    (key.scene.as_str(), key.entry)
}

/// The trials of which at least one target was compared.
fn with_results<'a>(results: &'a Results, preset: &str, method: &str) -> impl Iterator<Item = &'a TrialRow> {
    let compared = results.targets_of(preset, method).filter(|target| target.status.is_scored());
    let compared: BTreeSet<TrialId<'a>> = compared.map(|target| id(&target.key)).collect();
    results.trials_of(preset, method).filter(move |trial| compared.contains(&id(&trial.key)))
}

fn gaussians<'a>(results: &'a Results, preset: &'a str, method: &'a str) -> BTreeMap<TrialId<'a>, u64> {
    let trials = with_results(results, preset, method);
    trials.filter_map(|trial| Some((id(&trial.key), results.gaussians_of(trial)?))).collect()
}

/// Takes the means of Gaussians over the trials in which every setting with a score made some, because costs of different trials
/// cannot be compared. If there is no such trial, they stay as they are. Says so where these are not all trials.
pub(super) fn pair_gaussians(all: &mut [Scored<'_>]) -> Option<Note> {
    let ranked = all.iter().filter(|setting| setting.sample.quality.is_ok() && !setting.gaussians.is_empty());
    let trials: Vec<BTreeSet<_>> = ranked.map(|setting| setting.gaussians.keys().copied().collect()).collect();
    let most = trials.iter().map(BTreeSet::len).max()?;
    let common = trials.into_iter().reduce(|common, trials| &common & &trials)?;
    for Scored { sample, gaussians, .. } in all {
        let counts = gaussians.iter().filter(|(trial, _)| common.contains(*trial));
        sample.gaussians = mean(counts.map(|(_, count)| *count as f64)).or(sample.gaussians);
    }
    let text = match common.len() {
        0 => "No trial was finished by all settings: Gaussians of each are averaged over its own trials".to_owned(),
        count if count < most => {
            let trials = counted(count as u64, "trial");
            format!("Gaussians are averaged over the {trials} that all settings finished, of {most}")
        }
        _ => return None,
    };
    Some(Note { label: None, text })
}

/// What a reader must know of settings: which were timed on other trials, or optimised on several machines, and which costs were stated.
pub(super) fn notes(all: &[Scored<'_>]) -> Vec<Note> {
    let timed_on: BTreeSet<&(String, u32)> = all.iter().flat_map(|setting| &setting.timed).collect();
    let mut notes = Vec::new();
    for Scored { sample, timed, optimised_on, states_gaussians, lacks_rendering, .. } in all {
        let mut note = |text| notes.push(Note { label: Some(sample.label.clone()), text });
        // Each is of some of them.
        if !timed.is_empty() && timed.len() < timed_on.len() {
            let [some, of] = [timed.len(), timed_on.len()];
            note(format!("timed on {some} of the {of} trials that have times: times of different trials are compared"));
        }
        if *states_gaussians {
            note("Gaussians stated, not counted".to_owned());
        }
        if *lacks_rendering {
            note("time of the Gaussians alone, because none was stated for rendering".to_owned());
        }
        if optimised_on.len() > 1 {
            let machines: Vec<&str> = optimised_on.iter().copied().collect();
            let machines = machines.join("; ");
            note(format!(
                "optimised on several machines, which take different numbers of steps in the same time: {machines}"
            ));
        }
    }
    notes
}
