//! Parameter sweeps: one method at many settings.
//!
//! A [`Sweep`] is a TOML list of settings ([`Knobs`]) at which one method is run. What accuracy costs is read off the results
//! ([`atsplat_results::tradeoff`]).

mod knobs;
#[cfg(test)]
mod knobs_tests;
mod parts;
#[cfg(test)]
mod parts_tests;
mod settings;

pub use knobs::{Knobs, RendererKnobs};
pub use parts::{Part, SweepBase, parts};
pub use settings::{Setting, Sweep};
