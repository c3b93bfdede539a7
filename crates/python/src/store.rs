//! Reads and merges stores.

use std::path::PathBuf;

use atsplat_results::store::repeated_store;
use atsplat_results::{GapKind, Results, RunReport};
use pyo3::prelude::*;
use serde::Serialize;
use serde_json::{Value, json};

use crate::error::Failure;
use crate::threads::work_with_stores;

/// Provenance, rows of trials, rows of targets, gaps, each as JSON, and a summary as text.
#[pyfunction]
pub(crate) fn read_store(py: Python<'_>, folder: PathBuf) -> Result<(String, String, String, String, String), Failure> {
    work_with_stores(py, || {
        let results = Results::read(&folder)?;
        let gaps: Vec<Value> = results
            .gaps()
            .iter()
            .map(|gap| {
                let missing_shards = gap.kind == GapKind::MissingShards;
                let (preset, method, count, text) = (&gap.preset, &gap.method, gap.count, gap.to_string());
                json!({ "preset": preset, "method": method, "count": count, "missing_shards": missing_shards, "text": text })
            })
            .collect();
        let summary = RunReport::of(&results, None, &folder).to_string();
        let Results { provenance, trials, targets, .. } = &results;
        Ok((json(provenance)?, json(trials)?, json(targets)?, json(&gaps)?, summary))
    })
}

/// Merges shards into a new store, unless it is there.
#[pyfunction]
pub(crate) fn merge_stores(py: Python<'_>, stores: Vec<PathBuf>, out: PathBuf, partial: bool) -> Result<(), Failure> {
    work_with_stores(py, || {
        check_repeated(&stores)?;
        let parts = Results::read_each(&stores).into_iter().collect::<Result<Vec<_>, _>>()?;
        let merged = Results::merge(parts).map_err(|error| {
            let store = error.part.and_then(|at| stores.get(at));
            Failure::of_merge(*error.source, store.map(PathBuf::as_path))
        })?;
        let reasons = merged.why_incomplete();
        if !reasons.is_empty() && !partial {
            let reasons = reasons.join("; ");
            return Err(Failure::invalid("stores", format!("{reasons}: partial=True merges the other results")));
        }
        merged.results.write_merged(&out, &stores)?;
        Ok(())
    })
}

/// Rejects stores that are given twice.
fn check_repeated(stores: &[PathBuf]) -> Result<(), Failure> {
    let Some([store, first]) = repeated_store(stores) else { return Ok(()) };
    let (store, first) = (store.display(), first.display());
    Err(Failure::invalid("stores", format!("{store} is the same store as {first}: name each store once")))
}

pub(crate) fn json(value: &impl Serialize) -> Result<String, Failure> {
    serde_json::to_string(value).map_err(|error| Failure::invalid("JSON", error))
}
