//! `atsplat data`: one file per verb.

mod export;
mod frames;
mod geometry;
mod inspect;
mod motion;
mod simulate;
mod undistort;

use clap::Subcommand;

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Print what a path holds: format, counts, sizes, intrinsics, baselines, problems.
    Inspect(inspect::Words),
    /// Measure how cameras move: speed, turn rate, straightness, baselines, focal length; simulated beside real.
    Motion(motion::Words),
    /// Write cameras as Parquet, Arrow IPC or CSV, or whole scenes as `.torch` chunks.
    Export(export::Words),
    /// Simulate scenes from seeds into a dataset, with exact depth.
    Simulate(simulate::Words),
    /// Cut frames out of a video at a trajectory's timestamps (feature `opencv`).
    Frames(frames::Words),
    /// Remove lens distortion from pictures and cameras (feature `opencv`).
    Undistort(undistort::Words),
}

/// Runs one command; `true` where nothing had to be skipped.
pub(crate) fn run(command: &Command) -> anyhow::Result<bool> {
    match command {
        Command::Inspect(words) => inspect::run(words),
        Command::Motion(words) => motion::run(words),
        Command::Export(words) => export::run(words),
        Command::Simulate(words) => simulate::run(words),
        Command::Frames(words) => frames::run(words),
        Command::Undistort(words) => undistort::run(words),
    }
}

/// What a build without the feature says.
#[cfg(not(feature = "opencv"))]
fn needs_opencv(what: &str) -> anyhow::Error {
    anyhow::anyhow!("{what} needs a build with `--features opencv`; see CONTRIBUTING.md for what it takes")
}
