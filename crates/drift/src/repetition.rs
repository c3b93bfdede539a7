use std::collections::{BTreeMap, BTreeSet};

use atsplat_results::statistics::score_of;
use atsplat_results::{Results, TargetRow, TrialKey};

use super::limits::{Number, random_numbers, random_targets};
use super::provenance::differences;
use super::{Difference, DriftError, Setting, acceptable};

/// Checks that results are a repetition of a run, so that nothing but repeating it makes their numbers differ: a finished run of
/// the same protocols, methods and metrics by the same program on the same targets and data, and no copy of the run or of the `earlier`
/// repetitions.
///
/// # Errors
/// [`DriftError::Unacceptable`] with the first difference, for results without any of the scores of a number of the run, for a copy,
/// and as [`acceptable`].
pub fn check_repetition(run: &Results, earlier: &[Results], repeat: &Results) -> Result<(), DriftError> {
    acceptable(repeat)?;
    let unacceptable = |found| Err(DriftError::Unacceptable { expected: "a repetition of the run", found });
    let differences = differences(&run.provenance, &repeat.provenance);
    if let Some(difference) = differences.into_iter().find(is_of_plan) {
        let values = [&difference.baseline, &difference.now];
        let [of_run, of_repeat] = values.map(|value| value.as_deref().unwrap_or("none"));
        return unacceptable(format!("{}: {of_repeat} instead of {of_run}", difference.what()));
    }
    let [expected, found] = [run, repeat].map(targets);
    if let Some((key, target)) = expected.difference(&found).next() {
        return unacceptable(format!("no target {target} of {key}"));
    }
    if let Some((key, target)) = found.difference(&expected).next() {
        return unacceptable(format!("target {target} of {key}, which the run lacks"));
    }
    let known: BTreeMap<&TrialKey, Option<&str>> =
        run.trials.iter().map(|trial| (&trial.key, trial.data_hash.as_deref())).collect();
    let is_other = |key: &TrialKey, data: Option<&str>| known.get(key).is_some_and(|known| *known != data);
    if let Some(trial) = repeat.trials.iter().find(|trial| is_other(&trial.key, trial.data_hash.as_deref())) {
        return unacceptable(format!("other images or cameras in {}", trial.key));
    }
    let says_nothing = |number: &Number<'_>| {
        let of_run = scored(run, *number);
        !of_run.is_empty() && of_run.is_disjoint(&scored(repeat, *number))
    };
    if let Some((preset, method, metric)) = random_numbers(run).into_iter().find(says_nothing) {
        return unacceptable(format!("no {metric} of {method} under {preset} for any target with one in the run"));
    }
    if is_copy(run, repeat) {
        return unacceptable("a copy of it: the same start and scores".to_owned());
    }
    if earlier.iter().any(|other| is_copy(other, repeat)) {
        return unacceptable("a copy of another repetition: the same start and scores".to_owned());
    }
    Ok(())
}

/// For each repetition and number of a method that is not deterministic, how many of the run's scores it lacks: limits are only from
/// targets that all runs have a score for.
pub(super) fn lacking_scores(run: &Results, repeats: &[Results]) -> Vec<String> {
    let mut lines = Vec::new();
    for (position, repeat) in (1u32..).zip(repeats) {
        for number in random_numbers(run) {
            let [of_run, of_repeat] = [run, repeat].map(|results| scored(results, number));
            let lacking: Vec<&Target<'_>> = of_run.difference(&of_repeat).collect();
            if let Some((scene, entry, target)) = lacking.first() {
                let ((preset, method, metric), lacking, all) = (number, lacking.len(), of_run.len());
                lines.push(format!(
                    "repetition {position} has no {metric} for {lacking} of {all} targets of {method} under {preset}, such as target \
                     {target} of scene {scene}, entry {entry}: the limit is from the others"
                ));
            }
        }
    }
    lines
}

/// Scene, entry and position of a target.
type Target<'a> = (&'a str, u32, u32);

/// The targets with a score; a render that is identical to the truth has one.
fn scored<'a>(results: &'a Results, (preset, method, metric): Number<'a>) -> BTreeSet<Target<'a>> {
    let has_score = |row: &&TargetRow| score_of(row.status, row.scores.get(metric).copied(), metric).is_some();
    let rows = results.targets_of(preset, method).filter(has_score);
    rows.map(|row| (row.key.scene.as_str(), row.key.entry, row.target)).collect()
}

/// Whether results are those of the same run in another folder: another run starts at another time, and its methods that are not
/// deterministic have other scores.
fn is_copy(run: &Results, other: &Results) -> bool {
    let [scores, of_other] = [run, other].map(random_scores);
    run.provenance.started == other.provenance.started && !scores.is_empty() && scores == of_other
}

/// The bits of the scores of methods that are not deterministic, by trial, target and metric.
fn random_scores(results: &Results) -> BTreeMap<(&TrialKey, u32, &str), u64> {
    random_targets(results)
        .flat_map(|row| {
            row.scores.iter().map(move |(id, score)| ((&row.key, row.target, id.as_str()), score.to_bits()))
        })
        .collect()
}

/// Whether a difference is one of the program, protocols, methods or metrics; the same data may be elsewhere, and so may the files
/// that another run of a method wrote. Processors and adapters may differ, as repetitions show what they change.
fn is_of_plan(difference: &Difference) -> bool {
    let Difference { of, field, .. } = difference;
    !matches!(
        (of, field.as_deref()),
        (Setting::Run, Some("processor" | "adapter"))
            | (Setting::Preset(_), Some("data"))
            | (Setting::Method(_), Some("folder"))
    )
}

fn targets(results: &Results) -> BTreeSet<(&TrialKey, u32)> {
    results.targets.iter().map(|row| (&row.key, row.target)).collect()
}
