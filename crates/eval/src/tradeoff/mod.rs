//! Accuracy against time: knobs swept, frontiers, what the next step of quality costs, and where it becomes dear.
//!
//! A [`Sweep`] is a TOML list of settings ([`Knobs`]) to run one method at. What comes back is read as [`Sample`]s, of which
//! [`frontier()`] says which are worth choosing, as far as scenes and repetitions allow to tell them apart.

mod frontier;
mod knobs;
mod parts;
mod price;
mod report;
mod sample;
mod sweep;
#[cfg(test)]
mod tests;

pub use frontier::{Against, Axis, Contrasts, Frontier, Point, Sample, Standing, frontier};
pub use knobs::{Knobs, RendererKnobs};
pub use parts::{Part, Swept, parts};
pub use price::Price;
pub use report::TradeoffReport;
pub use sample::{Tradeoff, across, quality_step, samples, tradeoffs};
pub use sweep::{Setting, Sweep};
