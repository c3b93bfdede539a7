//! Compares stores with baselines.

use std::collections::BTreeMap;
use std::path::PathBuf;

use atsplat_drift::probe::{Pipeline, attribute};
use atsplat_drift::{Acceptance, Baseline, acceptable, compare, no_longer_guarded};
use atsplat_eval::runner::current_provenance;
use atsplat_files::date;
use atsplat_results::{PresetRecord, Results, SkippedEntry, TargetStatus, TrialKey, TrialRow};
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
            let same = accepted.was_probed_on(&current_provenance(env!("CARGO_PKG_VERSION"), None, Vec::new()));
            report =
                report.with_attribution(Pipeline::of(&recipe).and_then(|stages| attribute(&stages, &outputs, same)));
        }
        Ok((json(&report)?, report.to_string(), report.drifted(), lost(&accepted, &results)))
    })
}

/// Targets with a score in the baseline that failed in the results, have samples that are not finite, or are not there although they
/// were requested.
fn lost(baseline: &Baseline, results: &Results) -> Vec<String> {
    let now: BTreeMap<(&TrialKey, u32), _> =
        results.targets.iter().map(|row| ((&row.key, row.target), (row.status, row.detail.as_deref()))).collect();
    let had_score = |status| matches!(status, TargetStatus::Scored | TargetStatus::Identical);
    let described = baseline.targets.iter().filter(|then| had_score(then.status)).filter_map(|then| {
        let why = match now.get(&(&then.key, then.target)) {
            Some((status, _)) if had_score(*status) => return None,
            Some((_, detail)) => detail.unwrap_or("no reason recorded").to_owned(),
            None => vanished(&then.key, baseline, results)?,
        };
        Some(format!("{}, frame {}: {why}", then.key, then.frame))
    });
    described.collect()
}

/// Why a trial of the baseline has no rows although it was requested: it was skipped, or its scene is not in the data. `None` if another
/// method, protocol, index or part of it was run.
fn vanished(key: &TrialKey, baseline: &Baseline, results: &Results) -> Option<String> {
    let (then, now) = (&baseline.provenance, &results.provenance);
    now.methods.iter().find(|method| method.name == key.method)?;
    let preset = now.presets.iter().find(|preset| preset.name == key.preset)?;
    let is_skipped = |one: &&SkippedEntry| {
        (&one.preset, &one.scene, one.entry) == (&key.preset, &key.scene, key.entry) && one.concerns(&key.method)
    };
    if let Some(skipped) = now.skipped.iter().find(is_skipped) {
        return Some(format!("skipped, {}: {}", skipped.reason, skipped.detail));
    }
    let has_same_index = |other: &PresetRecord| other.name == preset.name && other.index_sha256 == preset.index_sha256;
    let is_same_part = now.limit == then.limit && now.shard == then.shard && then.presets.iter().any(has_same_index);
    let is_there = |row: &TrialRow| (&row.key.preset, &row.key.scene) == (&key.preset, &key.scene);
    (is_same_part && !results.trials.iter().any(is_there)).then(|| "the scene was not evaluated".to_owned())
}

/// Makes the results of a store the baseline, and records why; says what the old baseline guards and the new one does not. The probe
/// of the old baseline, if it has one, is run again.
#[pyfunction]
pub(crate) fn accept_baseline(
    py: Python<'_>,
    store: PathBuf,
    baseline: PathBuf,
    why: String,
) -> Result<Vec<String>, Failure> {
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
        let unguarded = before.as_ref().map_or_else(Vec::new, |before| no_longer_guarded(&compare(&results, before)));
        match before.and_then(|before| before.probe) {
            None => accepted.write(&baseline)?,
            Some(probe) => {
                let (probed, values) = accepted.probed(probe.recipe)?;
                probed.write_with_probe(&baseline, &values)?;
            }
        }
        Ok(unguarded)
    })
}
