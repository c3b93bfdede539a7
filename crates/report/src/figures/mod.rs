//! The plots of a table, a store, an expansion study and the history of a baseline.

mod of_drift;
mod of_expansion;
mod of_store;
mod of_table;
mod of_trial;

pub use of_drift::of_drift;
pub use of_expansion::{ExpansionScene, ExpansionTarget, of_expansion};
pub use of_store::of_store;
pub use of_table::of_table;
pub use of_trial::of_trial;

use atsplat_metrics::Definition;

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
