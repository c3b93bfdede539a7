//! `atsplat data`: one file per verb.

mod export;
mod frames;
mod geometry;
mod inspect;
mod motion;
mod simulate;
mod undistort;

use clap::Subcommand;

use crate::exit::{Exit, Skipping, done};

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Print what a path holds: format, counts, sizes, intrinsics, baselines, problems.
    Inspect(Skipping<inspect::Words>),
    /// Measure how cameras move: speed, turn rate, straightness, baselines, focal length; simulated beside real.
    Motion(Skipping<motion::Words>),
    /// Write cameras as Parquet, Arrow IPC or CSV, or whole scenes as `.torch` chunks.
    Export(Skipping<export::Words>),
    /// Simulate scenes from seeds into a dataset, with exact depth.
    Simulate(simulate::Words),
    /// Cut frames out of a video at a trajectory's timestamps (feature `opencv`).
    Frames(Skipping<frames::Words>),
    /// Remove lens distortion from pictures and cameras (feature `opencv`).
    Undistort(Skipping<undistort::Words>),
}

/// Runs one command.
pub(crate) fn run(command: &Command) -> anyhow::Result<Exit> {
    match command {
        Command::Inspect(words) => words.run(inspect::run),
        Command::Motion(words) => words.run(motion::run),
        Command::Export(words) => words.run(export::run),
        Command::Simulate(words) => done(simulate::run(words)),
        Command::Frames(words) => words.run(frames::run),
        Command::Undistort(words) => words.run(undistort::run),
    }
}

/// What a build without the feature says.
#[cfg(not(feature = "opencv"))]
fn needs_opencv(what: &str) -> anyhow::Error {
    anyhow::anyhow!("{what} needs a build with `--features opencv`; see CONTRIBUTING.md for what it takes")
}
