//! Optimisation of small scenes. One program, because each one links the whole workspace.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod checkpoint_files;
mod common;
mod density;
mod device;
mod elapsed;
mod memory;
mod published;
mod runs;
mod scores;
mod unseen;
