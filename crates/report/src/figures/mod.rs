//! The plots of tables, stores and trials, of expansion studies, of the history of a baseline, of studies of overlap
//! estimators and of optimisation, and the frontiers of several stores.

mod of_drift;
mod of_estimators;
mod of_expansion;
mod of_frontier;
mod of_optimisation;
mod of_store;
mod of_table;
mod of_trial;

pub use of_drift::of_drift;
pub use of_estimators::of_estimators;
pub use of_expansion::of_expansion;
pub use of_frontier::of_frontier;
pub use of_optimisation::optimisation_section;
pub use of_store::of_store;
pub use of_table::of_table;
pub use of_trial::of_trial;

use std::collections::BTreeSet;

use atsplat_eval::{MethodRecord, PresetRecord, Results};
use atsplat_metrics::{Definition, definitions};

use crate::counted;
use crate::definition::Quantity;
use crate::plot::Estimate;
use crate::table::{Cell, Column, Group};

/// The first metric of a group.
fn metric_of(group: &Group) -> Option<(usize, &'static Definition)> {
    group.columns.iter().enumerate().find_map(|(at, column)| match column.quantity {
        Quantity::Metric(metric) => Some((at, metric)),
        _ => None,
    })
}

fn place_of(group: &Group, quantity: Quantity) -> Option<usize> {
    group.columns.iter().position(|column: &Column| column.quantity == quantity)
}

fn estimate(cell: &Cell) -> Option<Estimate> {
    Some(Estimate { value: cell.value.number()?, interval: cell.interval })
}

/// The first metric that a protocol's targets have scores of.
pub(crate) fn first_metric(results: &Results, preset: &str) -> Option<&'static Definition> {
    let targets = || results.targets.iter().filter(|row| row.key.preset == preset);
    definitions().iter().find(|metric| targets().any(|row| row.scores.contains_key(metric.id)))
}

/// A method's title, with its name if other methods of the results have the same title, as trainings of one network do.
pub(crate) fn title_of(results: &Results, method: &MethodRecord) -> String {
    let twins = results.provenance.methods.iter().filter(|other| other.title == method.title).count();
    if twins > 1 { format!("{} ({})", method.title, method.name) } else { method.title.clone() }
}

/// Protocol, data and scenes, for a plot's heading: `RealEstate10K, 2 views (re10k-2v-256); 8 scenes of 7194 in the index`.
fn subject(results: &Results, preset: &PresetRecord) -> String {
    let trials = results.trials.iter().filter(|trial| trial.key.preset == preset.name);
    let scenes = trials.map(|trial| trial.key.scene.as_str()).collect::<BTreeSet<_>>().len() as u64;
    let part = if preset.entries < preset.entries_of_index {
        format!(", {} of {} trials of the index", preset.entries, preset.entries_of_index)
    } else {
        String::new()
    };
    format!("{} ({}); {}{part}", preset.title, preset.name, counted(scenes, "scene"))
}
