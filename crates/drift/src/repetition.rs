use std::collections::{BTreeMap, BTreeSet};

use atsplat_results::{Results, TrialKey};

use super::provenance::differences;
use super::{Difference, DriftError, Setting, acceptable};

/// Checks that results are a repetition of a run, so that nothing but repeating it makes their numbers differ: a finished run of
/// the same protocols, methods and metrics by the same program on the same targets and data.
///
/// # Errors
/// [`DriftError::Unacceptable`] with the first difference, and as [`acceptable`].
pub fn check_repetition(run: &Results, repeat: &Results) -> Result<(), DriftError> {
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
    match repeat.trials.iter().find(|trial| is_other(&trial.key, trial.data_hash.as_deref())) {
        Some(trial) => unacceptable(format!("other images or cameras in {}", trial.key)),
        None => Ok(()),
    }
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
