//! Tests of training, from losses to whole runs.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;
mod evaluation;
mod experiments;
mod features;
mod initial_weights;
mod losses;
mod lpips;
mod mirror;
mod objective;
mod paper;
mod resuming;
mod runs;
mod sources;
mod unstable_poses;
mod update;
