//! Evaluates methods into a store.

use std::path::PathBuf;
use std::sync::Arc;

use atsplat_eval::method::{Method, NearestView, Warp};
use atsplat_eval::runner::{self, Dataset, KeepImages, Plan, Selection, current_provenance, run_until};
use atsplat_eval::{MethodRecord, RunReport, Shard, Store};
use atsplat_protocol::trial::Prefetch;
use pyo3::prelude::*;

use crate::error::Failure;
use crate::exchange::Exchange;
use crate::method::PythonMethod;
use crate::protocol::Data;
use crate::threads;

/// Settings of an evaluation.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Settings {
    out: PathBuf,
    resume: bool,
    limit: Option<u64>,
    /// Number and count of shards.
    shard: Option<(u32, u32)>,
    metrics: Vec<String>,
    weights: Option<PathBuf>,
    keep_images: String,
    setting: String,
    command: Vec<String>,
}

/// Evaluates a built-in method, or a callable that the package wrapped, of which `record` is a method record as JSON; returns a
/// summary as text, and why nothing was evaluated, if so.
#[pyfunction]
pub(crate) fn evaluate(
    py: Python<'_>,
    method: Py<PyAny>,
    record: &str,
    data: Vec<PyRef<'_, Data>>,
    settings: Settings,
    progress: Option<Py<PyAny>>,
) -> Result<(String, Option<String>), Failure> {
    let datasets: Vec<Dataset> = data.iter().map(|data| Dataset::clone(&data.dataset)).collect();
    let exchange = Exchange::new();
    let record: MethodRecord = serde_json::from_str(record).map_err(|error| Failure::invalid("record", error))?;
    let method: Arc<dyn Method> = match record.kind.as_str() {
        "nearest-view" => Arc::new(NearestView),
        "warp" => Arc::new(Warp),
        _ => Arc::new(PythonMethod::new(record, settings.setting.clone(), exchange.calls(method))),
    };
    exchange.run(py, progress.as_ref(), move |steps, stop| {
        let pool = threads::evaluation()?;
        pool.install(|| run(&datasets, method, settings, &|| steps.step(), stop))
    })
}

fn run(
    datasets: &[Dataset],
    method: Arc<dyn Method>,
    settings: Settings,
    step: &(dyn Fn() + Sync),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(String, Option<String>), Failure> {
    let Settings { out, resume, limit, shard, metrics, weights, keep_images, setting: _, command } = settings;
    let suite = runner::suite(datasets, &metrics, weights.as_deref())?;
    let images = match keep_images.as_str() {
        "none" => KeepImages::Nothing,
        "worst" => KeepImages::Worst,
        "all" => KeepImages::All,
        other => {
            return Err(Failure::invalid("keep_images", format!("expected none, worst or all, found {other:?}")));
        }
    };
    let plan = Plan {
        datasets,
        methods: &[method],
        suite: &suite,
        selection: Selection { limit, shard: shard.map(|(number, of)| Shard { number, of }) },
        timing: None,
        images,
        prefetch: Prefetch { trials: 2 * rayon::current_num_threads(), ..Prefetch::default() },
    };
    let provenance =
        plan.provenance(current_provenance(env!("CARGO_PKG_VERSION"), option_env!("ATSPLAT_COMMIT"), command))?;
    let store = if resume { Store::resume(&out, provenance)? } else { Store::create(&out, provenance)? };
    let (results, summary) = run_until(&plan, store, step, stop)?;
    Ok((RunReport::of(&results, Some(summary), &out).to_string(), plan.nothing_evaluated(&results)))
}
