//! Parameter sweeps: one method at many settings.
//!
//! A [`Sweep`] is a TOML list of settings ([`Overrides`]) at which one method is run. What accuracy costs is read off the results
//! ([`atsplat_results::tradeoff`]).

mod overrides;
#[cfg(test)]
mod overrides_tests;
mod parts;
#[cfg(test)]
mod parts_tests;
mod settings;

pub use overrides::{ConstantChanges, Overrides};
pub use parts::{Part, SweepBase, SweepNetwork, parts};
pub use settings::{Setting, Sweep};
