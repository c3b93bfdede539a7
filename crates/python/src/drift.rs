//! Compares stores with baselines.

use std::collections::BTreeMap;
use std::path::PathBuf;

use atsplat_eval::drift::probe::{Pipeline, attribute};
use atsplat_eval::drift::{Acceptance, Baseline, acceptable, compare, same_machine};
use atsplat_eval::runner::current_provenance;
use atsplat_eval::{Results, TargetStatus, TrialKey};
use atsplat_files::date;
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
        let results = Results::read(&store)?;
        let mut report = compare(&results, &accepted);
        if let Some((recipe, outputs)) = recorded {
            let same =
                same_machine(&accepted.provenance, &current_provenance(env!("CARGO_PKG_VERSION"), None, Vec::new()));
            report =
                report.with_attribution(Pipeline::of(&recipe).and_then(|stages| attribute(&stages, &outputs, same)));
        }
        Ok((json(&report)?, report.to_string(), report.drifted(), lost(&accepted, &results)))
    })
}

/// Targets with a score in the baseline that failed in the results, or have samples that are not finite.
fn lost(baseline: &Baseline, results: &Results) -> Vec<String> {
    let now: BTreeMap<(&TrialKey, u32), _> =
        results.targets.iter().map(|row| ((&row.key, row.target), (row.status, row.detail.as_deref()))).collect();
    let had_score = |status| matches!(status, TargetStatus::Scored | TargetStatus::Identical);
    let described = baseline.targets.iter().filter(|then| had_score(then.status)).filter_map(|then| {
        let (status, detail) = *now.get(&(&then.key, then.target))?;
        (!had_score(status))
            .then(|| format!("{}, frame {}: {}", then.key, then.frame, detail.unwrap_or("no reason recorded")))
    });
    described.collect()
}

/// Makes the results of a store the baseline, and records why. The probe of the old baseline, if it has one, is run again.
#[pyfunction]
pub(crate) fn accept_baseline(py: Python<'_>, store: PathBuf, baseline: PathBuf, why: String) -> Result<(), Failure> {
    work_with_stores(py, || {
        if why.trim().is_empty() {
            return Err(Failure::invalid("why", "expected a reason why these numbers are correct, found none"));
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
