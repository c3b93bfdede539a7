//! Compares stores with baselines.

use std::path::PathBuf;

use atsplat_eval::Results;
use atsplat_eval::drift::probe::{Pipeline, attribute};
use atsplat_eval::drift::{Acceptance, Baseline, acceptable, compare, same_machine};
use atsplat_eval::runner::current_provenance;
use atsplat_files::date;
use pyo3::prelude::*;

use crate::error::Failure;
use crate::store::json;
use crate::threads::work;

/// The comparison as JSON and as text, and whether numbers drifted. With `probe`, the stages of the pipeline are run on this
/// machine to find which of them moved a number, if the baseline has a probe.
#[pyfunction]
pub(crate) fn compare_with_baseline(
    py: Python<'_>,
    store: PathBuf,
    baseline: PathBuf,
    probe: bool,
) -> Result<(String, String, bool), Failure> {
    work(py, || {
        let accepted = Baseline::read(&baseline)?;
        let recorded = if probe { accepted.read_probe(&baseline)? } else { None };
        let mut report = compare(&Results::read(&store)?, &accepted);
        if let Some((recipe, outputs)) = recorded {
            let same =
                same_machine(&accepted.provenance, &current_provenance(env!("CARGO_PKG_VERSION"), None, Vec::new()));
            report =
                report.with_attribution(Pipeline::of(&recipe).and_then(|stages| attribute(&stages, &outputs, same)));
        }
        Ok((json(&report)?, report.to_string(), report.drifted()))
    })
}

/// Makes the results of a store the baseline, and records why. The probe of the old baseline, if it has one, is run again.
#[pyfunction]
pub(crate) fn accept_baseline(py: Python<'_>, store: PathBuf, baseline: PathBuf, why: String) -> Result<(), Failure> {
    work(py, || {
        if why.trim().is_empty() {
            return Err(Failure::invalid("why", "expected why these numbers are correct, found nothing"));
        }
        let results = Results::read(&store)?;
        acceptable(&results).map_err(|error| Failure::invalid("store", error))?;
        let (version, commit) = (results.provenance.atsplat.clone(), results.provenance.commit.clone());
        let now = current_provenance(env!("CARGO_PKG_VERSION"), None, Vec::new()).started;
        let acceptance = Acceptance { date: date(now), reason: why, atsplat: version, commit };
        let before = if baseline.exists() { Some(Baseline::read(&baseline)?) } else { None };
        let accepted = match &before {
            Some(before) => before.accept(&results, &[], acceptance),
            None => Baseline::new(&results, &[], acceptance),
        };
        let Some(probe) = before.and_then(|before| before.probe) else { return Ok(accepted.write(&baseline)?) };
        let (probed, values) = accepted.probed(probe.recipe)?;
        Ok(probed.write_with_probe(&baseline, &values)?)
    })
}
