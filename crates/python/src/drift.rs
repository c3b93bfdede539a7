//! Compares stores with baselines.

use std::path::PathBuf;

use atsplat_drift::probe::Pipeline;
use atsplat_drift::{Baseline, DriftError, NewBaseline, ProbeChoice, check_repetition, compare};
use atsplat_eval::runner::current_provenance;
use atsplat_files::FileLock;
use atsplat_metrics::definition_in_any_case;
use atsplat_results::Results;
use pyo3::prelude::*;

use crate::error::Failure;
use crate::store::json;
use crate::threads::work_with_stores;

/// A comparison as JSON and as text, whether numbers drifted, and the targets that lost their scores.
type Comparison = (String, String, bool, Vec<String>);

/// Compares a store with a baseline. With `probe`, the stages of the pipeline are run on this
/// machine to find which of them moved a number, if the baseline has a probe.
#[pyfunction]
pub(crate) fn compare_with_baseline(
    py: Python<'_>,
    store: PathBuf,
    baseline: PathBuf,
    probe: bool,
) -> Result<Comparison, Failure> {
    work_with_stores(py, || {
        let accepted = Baseline::read(&baseline)?;
        let recorded = if probe { accepted.read_probe(&baseline)? } else { None };
        // A recipe whose stages cannot be made is an error, and no drift.
        let stages = recorded.map(|(recipe, outputs)| Pipeline::of(&recipe).map(|stages| (stages, outputs)));
        let stages = stages.transpose()?;
        let results = Results::read(&store)?;
        let mut report = compare(&results, &accepted);
        if let Some((stages, outputs)) = stages {
            let same = accepted.was_probed_on(&current_provenance(env!("CARGO_PKG_VERSION"), None, Vec::new()));
            report = report.with_probe(&stages, &outputs, same);
        }
        Ok((json(&report)?, report.to_string(), report.drifted(), accepted.lost_targets(&results)))
    })
}

/// Makes the results of a store the baseline, and records why; says what the old baseline guards and the new one does not, and which
/// scores repetitions of the run lack. The probe of the old baseline, or the smallest one, is run.
#[pyfunction]
pub(crate) fn accept_baseline(
    py: Python<'_>,
    store: PathBuf,
    baseline: PathBuf,
    why: String,
    repeats: Vec<PathBuf>,
    limits: Vec<(String, f64)>,
) -> Result<Vec<String>, Failure> {
    let limits = limits_by_id(limits)?;
    work_with_stores(py, || {
        // Before it is read, as another process may be about to replace it.
        let _lock = FileLock::of(&baseline)?;
        let before = Baseline::read_if_exists(&baseline)?;
        let results = Results::read(&store)?;
        let repeats = repetitions(&results, &repeats)?;
        let new_baseline =
            NewBaseline { results: &results, repeats: &repeats, limits: &limits, why: &why, probe: ProbeChoice::Kept };
        let accepted = new_baseline.write(&baseline, before.as_ref()).map_err(|error| match error {
            DriftError::Unacceptable { .. } => Failure::invalid("store", error),
            DriftError::Invalid { what: "limit", .. } => Failure::from(error).of_argument("limits"),
            error => error.into(),
        })?;
        Ok(accepted.no_longer_guarded().iter().chain(accepted.lacking_in_repetitions()).cloned().collect())
    })
}

/// Limits by the ids of their metrics, which are given in upper or lower case. The baseline rejects unknown ones.
fn limits_by_id(stated: Vec<(String, f64)>) -> Result<Vec<(String, f64)>, Failure> {
    let mut limits: Vec<(String, f64)> = Vec::with_capacity(stated.len());
    for (metric, change) in stated {
        let id = definition_in_any_case(&metric).map_or(metric, |known| known.id.to_owned());
        if limits.iter().any(|(other, _)| *other == id) {
            return Err(Failure::invalid(
                "limits",
                format!("expected each metric once, found {id} in upper and lower case"),
            ));
        }
        limits.push((id, change));
    }
    Ok(limits)
}

/// The results of a run's repetitions.
fn repetitions(run: &Results, stores: &[PathBuf]) -> Result<Vec<Results>, Failure> {
    if !stores.is_empty() && run.provenance.methods.iter().all(|method| method.deterministic) {
        return Err(Failure::invalid("repeats", "no effect: every method of the results is deterministic"));
    }
    let mut repeats = Vec::new();
    for store in stores {
        let repeat = Results::read(store)?;
        check_repetition(run, &repeats, &repeat)
            .map_err(|error| Failure::invalid("repeats", format!("{}: {error}", store.display())))?;
        repeats.push(repeat);
    }
    Ok(repeats)
}
