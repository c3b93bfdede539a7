//! Accuracy against cost: Pareto frontiers, the cost of the next step of quality, and the knee.
//!
//! The settings of a sweep, or any methods of a store, are [`Sample`]s, of which [`frontier()`] finds the Pareto-optimal ones, as
//! far as scenes and repetitions can distinguish them.

#[cfg(test)]
mod cost_tests;
mod frontier;
mod report;
mod sample;
mod scored;
#[cfg(test)]
mod tests;
mod unscored;

pub use frontier::{
    Axis, Contrasts, Counts, Frontier, Point, PointDifference, Price, Sample, Seconds, Standing, frontier,
};
pub use report::TradeoffReport;
pub use sample::{Incomplete, Note, Tradeoff, across, quality_step, tradeoffs};
