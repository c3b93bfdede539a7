//! Evaluates methods into a store.

use std::path::PathBuf;
use std::sync::Arc;

use atsplat_eval::method::{ConstantsChoice, Method, NearestView, Splatting, Warp};
use atsplat_eval::runner::{self, Dataset, KeepImages, Plan, Selection, current_provenance, run_until};
use atsplat_protocol::trial::Prefetch;
use atsplat_results::{MethodRecord, Shard, Store};
use atsplat_splat::RasterMode;
use pyo3::prelude::*;

use crate::error::Failure;
use crate::exchange::Exchange;
use crate::method::PythonMethod;
use crate::protocol::Data;
use crate::render::constants_named;
use crate::threads::{self, check_process};

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
    /// How Gaussians are rendered; `None` is the protocol's.
    antialiased: Option<bool>,
    constants: Option<String>,
    background: Option<[f64; 3]>,
    command: Vec<String>,
}

/// Evaluates a built-in method, or a callable that the package wrapped, of which `record` is a method record as JSON. Returns why
/// nothing was evaluated, if so.
#[pyfunction]
pub(crate) fn evaluate(
    py: Python<'_>,
    method: Py<PyAny>,
    record: &str,
    data: Vec<PyRef<'_, Data>>,
    settings: Settings,
    progress: Option<Py<PyAny>>,
) -> Result<Option<String>, Failure> {
    check_process()?;
    let datasets: Vec<Dataset> = data.iter().map(|data| Dataset::clone(&data.dataset)).collect();
    let exchange = Exchange::new();
    let mut record: MethodRecord = serde_json::from_str(record).map_err(|error| Failure::invalid("record", error))?;
    let splatting = settings.splatting(&mut record)?;
    let method: Arc<dyn Method> = match record.kind.as_str() {
        "nearest-view" => Arc::new(NearestView),
        "warp" => Arc::new(Warp),
        _ => {
            let (setting, chosen) = (settings.setting.clone(), settings.chosen());
            Arc::new(PythonMethod::new(record, setting, splatting, chosen, exchange.calls(method)))
        }
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
) -> Result<Option<String>, Failure> {
    let Settings { out, resume, limit, shard, metrics, weights, keep_images, command, .. } = settings;
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
        selection: Selection { limit, shard: shard.map(|(number, count)| Shard { number, count }) },
        timing: None,
        images,
        prefetch: Prefetch { trials: 2 * rayon::current_num_threads(), ..Prefetch::default() },
    };
    let provenance =
        plan.provenance(current_provenance(env!("CARGO_PKG_VERSION"), option_env!("ATSPLAT_COMMIT"), command))?;
    let store = if resume { Store::resume(&out, provenance) } else { Store::create(&out, provenance) };
    let store = store.map_err(|error| Failure::of_store(error, &out))?;
    let (results, _) = run_until(&plan, store, &|_| step(), stop)?;
    Ok(plan.nothing_evaluated(&results))
}

impl Settings {
    /// How Gaussians are rendered. What was chosen is recorded, as for Gaussians in files; the method itself says whether it is
    /// deterministic.
    fn splatting(&self, record: &mut MethodRecord) -> Result<Splatting, Failure> {
        let constants = match self.constants.as_deref() {
            Some(name) => ConstantsChoice::Fixed(constants_named(name)?),
            None => ConstantsChoice::FromPreset,
        };
        let mode = |antialiased| if antialiased { RasterMode::Antialiased } else { RasterMode::Classic };
        let (mode, background) = (self.antialiased.map(mode), self.background);
        let splatting = Splatting { constants, background, mode, ..Splatting::default() };
        if self.chosen().is_some() {
            let deterministic = record.deterministic;
            splatting.describe(record);
            record.deterministic &= deterministic;
        }
        Ok(splatting)
    }

    /// The first argument that is given of those that are only about Gaussians.
    fn chosen(&self) -> Option<&'static str> {
        let given = [
            ("antialiased", self.antialiased.is_some()),
            ("constants", self.constants.is_some()),
            ("background", self.background.is_some()),
        ];
        given.into_iter().find_map(|(name, is_given)| is_given.then_some(name))
    }
}
