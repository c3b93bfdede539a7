//! Parameter sweeps: one method at many settings.
//!
//! A [`Sweep`] is a TOML list of settings ([`Knobs`]) at which one method is run. What accuracy costs is read off the results
//! ([`atsplat_results::tradeoff`]).

mod knobs;
mod parts;
#[cfg(test)]
mod parts_tests;
#[cfg(test)]
mod settings_tests;
mod sweep;

pub use knobs::{Knobs, RendererKnobs};
pub use parts::{Part, SweepBase, parts};
pub use sweep::{Setting, Sweep};
