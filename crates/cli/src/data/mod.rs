//! `atsplat data`: one file per subcommand.

mod export;
mod frames;
mod geometry;
mod inspect;
mod motion;
mod simulate;
mod undistort;

use clap::Subcommand;

use crate::exit::{Exit, WithStrict};

const INSPECT_STRICT: &str = "Exit with code 4 if scenes cannot be read, rows seem to be lost or wrong, a scene's cameras are all \
                              in one place, or images are missing, empty, cut short, cannot be read or do not fit their \
                              cameras, or a simulation into the folder has not ended";

const EXPORT_STRICT: &str =
    "Exit with code 4 if scenes were skipped, or an image in a chunk is cut short or cannot be read";

const MOTION_STRICT: &str = "Exit with code 4 if scenes were skipped";

const UNDISTORT_STRICT: &str = "Exit with code 4 if scenes were skipped, or frames have no image that can be read";

const FRAMES_STRICT: &str = "Exit with code 4 if a timestamp has no frame in the video";

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Print the contents of a dataset: format, counts, sizes, intrinsics, baselines, problems.
    #[command(mut_arg("strict", |strict| strict.help(INSPECT_STRICT)))]
    Inspect(WithStrict<inspect::Args>),
    /// Measure camera motion: speed, turn rate, straightness, baselines, focal length; of simulated and real clips.
    #[command(mut_arg("strict", |strict| strict.help(MOTION_STRICT)))]
    Motion(WithStrict<motion::Args>),
    /// Write cameras as Parquet, Arrow IPC or CSV, or whole scenes as `.torch` chunks.
    #[command(mut_arg("strict", |strict| strict.help(EXPORT_STRICT)))]
    Export(WithStrict<export::Args>),
    /// Simulate scenes from seeds into a dataset; --depth adds exact depth.
    Simulate(simulate::Args),
    /// Cut frames out of a video at a trajectory's timestamps (feature `opencv`).
    #[command(mut_arg("strict", |strict| strict.help(FRAMES_STRICT)))]
    Frames(WithStrict<frames::Args>),
    /// Remove lens distortion from images and cameras (feature `opencv`).
    #[command(mut_arg("strict", |strict| strict.help(UNDISTORT_STRICT)))]
    Undistort(WithStrict<undistort::Args>),
}

/// Runs a subcommand.
pub(crate) fn run(command: &Command) -> anyhow::Result<Exit> {
    match command {
        Command::Inspect(args) => args.run(inspect::run),
        Command::Motion(args) => args.run(motion::run),
        Command::Export(args) => args.run(export::run),
        Command::Simulate(args) => simulate::run(args).map(|()| Exit::Done),
        Command::Frames(args) => args.run(frames::run),
        Command::Undistort(args) => args.run(undistort::run),
    }
}

/// The error of builds without the feature.
#[cfg(not(feature = "opencv"))]
fn needs_opencv(what: &str) -> anyhow::Error {
    anyhow::anyhow!("{what} requires a build with `--features opencv`; see CONTRIBUTING.md for its dependencies")
}
