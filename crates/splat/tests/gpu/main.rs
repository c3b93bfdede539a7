//! The GPU renderer against the f64 reference and the CPU renderer.
//!
//! Without an adapter these tests print a notice and pass; with `ATSPLAT_REQUIRE_GPU=1` they fail.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test fails by panicking")]

mod backward;
mod batch;
#[path = "../common/cloud.rs"]
mod cloud;
#[path = "../common/poison.rs"]
mod common;
mod devices;
#[path = "../common/extreme.rs"]
mod extreme;
mod forward;
mod limits;
mod lists;
mod poison;
mod resident;
mod scenes;
mod submissions;
