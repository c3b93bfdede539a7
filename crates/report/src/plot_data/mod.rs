//! What plots show: the data of tables, stores and trials, of expansion studies, of the history of a baseline, of studies of
//! overlap estimators and of optimisation, and the frontiers of several stores. [`plot`](crate::plot) draws it.

mod drift;
mod estimators;
mod expansion;
mod frontier;
mod optimisation;
mod store;
mod subject;
mod table;
mod timed;
mod trial;
mod without_point;

pub use drift::drift_plot;
pub use estimators::estimator_scatter;
pub use expansion::expansion_plots;
pub use frontier::frontier_plots;
pub use optimisation::optimisation_section;
pub use store::store_plots;
pub(crate) use subject::title_of;
pub use table::table_plots;
pub use trial::trial_images;

use atsplat_metrics::{Definition, definitions};
use atsplat_results::Results;

/// The first metric that a protocol's targets have scores of.
pub(crate) fn first_metric(results: &Results, preset: &str) -> Option<&'static Definition> {
    let targets = || results.targets.iter().filter(|row| row.key.preset == preset);
    definitions().iter().find(|metric| targets().any(|row| row.scores.contains_key(metric.id)))
}
