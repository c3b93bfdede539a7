//! Accuracy against time: parameter sweeps, Pareto frontiers, the cost of the next step of quality, and the knee.
//!
//! A [`Sweep`] is a TOML list of settings ([`Knobs`]) at which one method is run. The results are [`Sample`]s, of which
//! [`frontier()`] finds the Pareto-optimal ones, as far as scenes and repetitions can distinguish them.

#[cfg(test)]
mod cost_tests;
mod frontier;
mod knobs;
mod parts;
#[cfg(test)]
mod parts_tests;
mod report;
mod sample;
mod scored;
#[cfg(test)]
mod settings_tests;
mod sweep;
#[cfg(test)]
mod tests;
mod unscored;

pub use frontier::{Axis, Contrasts, Counts, Frontier, Point, PointDifference, Price, Sample, Standing, frontier};
pub use knobs::{Knobs, RendererKnobs};
pub use parts::{Part, SweepBase, parts};
pub use report::TradeoffReport;
pub use sample::{Incomplete, Note, Tradeoff, across, quality_step, tradeoffs};
pub use sweep::{Setting, Sweep};
