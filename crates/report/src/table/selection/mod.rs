//! Which results of stores stand in a table's rows: those of one protocol, index and data share a table, of the chosen methods.
//! What they are known to be of, and how they differ from the published setting.

mod chosen;
#[cfg(test)]
mod chosen_tests;
mod comparable;
#[cfg(test)]
mod comparable_tests;
mod known_dataset;
mod method_run;
mod part;
mod published_setting;
#[cfg(test)]
mod published_setting_tests;
mod seeds;
mod trial_data;

use atsplat_results::Results;

pub(super) use comparable::{ComparableResults, comparable_groups};
pub(crate) use known_dataset::other_data;
pub(super) use method_run::{MethodRun, StoreMethod};
pub(super) use part::Part;
pub(crate) use published_setting::OtherPreset;
pub(super) use seeds::{is_further_training, is_network_of_another_seed};
pub(crate) use trial_data::is_same_data;

/// Whether a method has trials under a preset.
pub(crate) fn has_trials(results: &Results, preset: &str, method: &str) -> bool {
    results.trials_of(preset, method).next().is_some()
}
