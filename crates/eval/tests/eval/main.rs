//! Runs of methods on small scenes. One program, because each one links the whole workspace.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod additions;
mod common;
mod device_trials;
mod effects;
mod exec;
mod exec_adapters;
mod exec_rows;
mod exec_trials;
mod image_mistakes;
mod imported_constants;
mod kept_images;
mod methods;
mod moved;
mod networks;
mod rows;
mod runner;
mod scene_names;
mod stopping;
mod timing;
mod timing_kept;
mod tradeoff;
