//! `atsplat fit`: optimises Gaussians for one scene.

mod check;
mod input;
mod optimise;
mod output;
mod plots;
mod prepare;
mod start;

use std::path::{Path, PathBuf};

use anyhow::ensure;
use atsplat_fit::{Background, Budget, Elapsed, FitConfig, FitError, FitReport, Strategy};
use atsplat_splat::SplatError;

use crate::device::DeviceArgs;
use crate::parse;
use crate::print::print_report;
use input::InputArgs;
use optimise::Log;
use prepare::Prepared;
use start::StartArgs;

#[derive(Debug, clap::Args)]
#[command(override_usage = "atsplat fit <DATA> --views <SEL> --strategy <NAME> --steps <N> --out <FILE> [OPTIONS]")]
pub(crate) struct Args {
    #[command(flatten)]
    input: InputArgs,

    #[command(flatten, next_help_heading = "Start")]
    start: StartArgs,

    #[command(flatten, next_help_heading = "Optimisation")]
    optimisation: OptimisationArgs,

    #[command(flatten)]
    device: DeviceArgs,

    /// File of the Gaussians that ends in .ply or .spz, in the frame of DATA; FILE.json next to it records how they were made, and
    /// FILE.cameras.json has the cameras and exposures of the views for `render --cameras`. SPZ is smaller, but rounds, and has no
    /// place for the 3D filters of mip-splatting.
    #[arg(long, short, value_name = "FILE", value_parser = parse::gaussians_file, help_heading = "Output")]
    out: PathBuf,

    /// Folder for the learning curve and a contact sheet: renders next to the held-out photos, or without any, next to those of
    /// --views.
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    plots: Option<PathBuf>,

    /// Compare with the held-out photos every N steps. Default: about eight times, never shortly after opacities are reset.
    #[arg(long, value_name = "N", requires = "held_out", value_parser = clap::value_parser!(u64).range(1..), help_heading = "Output")]
    evaluate_every: Option<u64>,

    /// File for the state of the run, from which --resume continues; without it, an existing file is not overwritten.
    #[arg(long, value_name = "FILE", help_heading = "Output", conflicts_with = "seconds")]
    checkpoint: Option<PathBuf>,

    /// Write the checkpoint every N steps, and after the last one.
    #[arg(long, value_name = "N", default_value_t = 500, requires = "checkpoint", conflicts_with = "seconds", value_parser = clap::value_parser!(u64).range(1..), help_heading = "Output")]
    checkpoint_every: u64,

    /// Continue from the checkpoint, if it exists; the result is that of an uninterrupted run.
    #[arg(long, requires = "checkpoint", conflicts_with = "seconds", help_heading = "Output")]
    resume: bool,

    /// Print JSON.
    #[arg(long, help_heading = "Output")]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct OptimisationArgs {
    /// How the number of Gaussians changes; required without --refine.
    #[arg(long, value_name = "NAME", required_unless_present = "refine", value_parser = parse::named(Strategy::ALL.map(|strategy| (strategy.name(), strategy))))]
    strategy: Option<Strategy>,

    /// Number of steps, with which all schedules scale (the papers use 30000).
    #[arg(long, value_name = "N", required_unless_present = "seconds", conflicts_with = "seconds", value_parser = clap::value_parser!(u64).range(1..))]
    steps: Option<u64>,

    /// Seconds instead of steps: the number of steps depends on their speed, so that results differ between machines.
    #[arg(long, value_name = "S", value_parser = parse::positive)]
    seconds: Option<f64>,

    /// Seed of the order of views, of density control, and of the start.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Degree of the spherical harmonics at the end.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=4))]
    sh_degree: u8,

    /// Background behind the Gaussians: black, white, or random (another colour in each step).
    #[arg(long, value_name = "COLOUR", default_value = "black", value_parser = parse::named(BACKGROUNDS))]
    background: Background,

    /// Clone and split by absolute gradients of single pixels, both from 8e-4, as gsplat does with `absgrad`.
    #[arg(long)]
    absolute_gradients: bool,

    /// Optimise each view's camera too, with this initial learning rate, in radians and in extents of the scene. The scene may
    /// drift away from the held-out cameras.
    #[arg(long, value_name = "RATE", num_args = 0..=1, default_missing_value = "1e-5", value_parser = parse::positive)]
    optimise_poses: Option<f64>,

    /// Optimise each view's exposure too: an affine map of its colours, with this initial learning rate. Held-out views are
    /// compared without one.
    #[arg(long, value_name = "RATE", num_args = 0..=1, default_missing_value = "0.01", value_parser = parse::positive)]
    optimise_exposure: Option<f64>,

    /// Extent of the scene in units of DATA; by default the radius of the cameras, or half the median depth of the start if
    /// that is more.
    #[arg(long, value_name = "LENGTH", value_parser = parse::positive)]
    extent: Option<f64>,

    /// Maximum number of Gaussians: MCMC grows towards it, by 5 % at each change of density; the other strategies stop with a
    /// message if they need more.
    #[arg(long, value_name = "N", default_value_t = 1_000_000)]
    max_gaussians: usize,

    /// Limit on memory for parameters, images (also held-out ones) and renderer, in MiB. On a graphics adapter, a rendering has this
    /// limit in the adapter's memory, but at least 64 MiB.
    #[arg(long, value_name = "MIB", default_value_t = 8192)]
    memory: u64,
}

const BACKGROUNDS: [(&str, Background); 3] =
    [("black", Background::Black), ("white", Background::White), ("random", Background::Random)];

impl OptimisationArgs {
    /// `scale`: length in the views' normalised frame per unit of length in DATA.
    fn config(&self, scale: f64) -> FitConfig {
        FitConfig {
            seed: self.seed,
            sh_degree: self.sh_degree,
            background: self.background,
            absolute_gradients: self.absolute_gradients,
            pose_rate: self.optimise_poses,
            exposure_rate: self.optimise_exposure,
            extent: self.extent.map(|extent| extent * scale),
            max_gaussians: self.max_gaussians,
            memory_limit: self.memory_limit(),
            ..FitConfig::new(self.strategy.unwrap_or(Strategy::Fixed), 1)
        }
    }

    /// In bytes.
    const fn memory_limit(&self) -> u64 {
        self.memory.saturating_mul(1 << 20)
    }

    /// Names the command-line options, if the error does not.
    fn with_option(&self, error: FitError) -> anyhow::Error {
        match error {
            error @ FitError::Splat(SplatError::Memory { .. }) => {
                let options = format!("--memory {} (MiB), or fewer Gaussians by --max-gaussians", self.memory);
                anyhow::Error::from(error).context(options)
            }
            error @ FitError::Setting { name: "memory-limit", .. } => {
                anyhow::Error::from(error).context(format!("--memory {} (MiB)", self.memory))
            }
            other => other.into(),
        }
    }

    fn budget(&self) -> Budget {
        match (self.steps, self.seconds) {
            (_, Some(seconds)) => Budget::Seconds(seconds),
            #[expect(clippy::expect_used, reason = "clap requires one of the two")]
            (steps, None) => Budget::Steps(steps.expect("required without --seconds")),
        }
    }
}

/// Optimises until the last step or the end of the time.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    args.check()?;
    let _outputs = args.lock_outputs()?;
    let Prepared { input, start, mut fit, deadline, planning_secs } = args.prepare()?;
    let mut log = Log::new(&fit, &input.held_out, args.evaluate_every);
    let outcome = args.optimise(&mut fit, deadline, &mut log);
    let optimised = fit.elapsed();
    let elapsed = Elapsed { seconds: planning_secs + optimised.seconds, ..optimised };
    // After a lost adapter, nothing can be rendered.
    let can_render = !outcome.as_ref().is_err_and(is_device_error);
    let written = args.write_results(&mut fit, &input, start, &log, can_render);
    drop(log);
    let outcome = outcome.map_err(|error| match error.downcast::<FitError>() {
        Ok(error) => args.optimisation.with_option(error),
        Err(other) => other,
    });
    let record = finished(outcome, written, &args.out)?;
    ensure!(
        fit.step_count() > 0,
        "--seconds: the time limit ended before the first step; {} contains the initial Gaussians",
        args.out.display()
    );
    print_report(&FitReport::new(record, elapsed), args.json)
}

/// What a run wrote, or why it stopped, and why its last good state was not written.
fn finished<T>(outcome: anyhow::Result<()>, written: anyhow::Result<T>, out: &Path) -> anyhow::Result<T> {
    match (outcome, written) {
        (Ok(()), written) => written,
        (Err(stopped), Ok(_)) => Err(stopped.context(format!("{} contains the last good state", out.display()))),
        (Err(stopped), Err(unwritten)) => Err(stopped.context(format!("{unwritten:#}; the run had stopped before"))),
    }
}

fn is_device_error(error: &anyhow::Error) -> bool {
    error.downcast_ref::<FitError>().is_some_and(FitError::is_device_error)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args() -> OptimisationArgs {
        OptimisationArgs {
            strategy: None,
            steps: Some(1),
            seconds: None,
            seed: 0,
            sh_degree: 3,
            background: Background::Black,
            absolute_gradients: false,
            optimise_poses: None,
            optimise_exposure: None,
            extent: Some(6.0),
            max_gaussians: 1,
            memory: 1,
        }
    }

    #[test]
    fn an_extent_in_units_of_the_data_is_scaled_as_the_views_are() {
        assert_eq!(args().config(0.25).extent, Some(1.5));
    }

    #[test]
    fn a_run_that_stopped_says_why_also_if_nothing_could_be_written() {
        let outcome = |stopped: bool, is_written: bool| {
            let outcome = if stopped { Err(anyhow::anyhow!("the loss is NaN")) } else { Ok(()) };
            let written = if is_written { Ok(7) } else { Err(anyhow::anyhow!("disk full").context("writing x.spz")) };
            finished(outcome, written, Path::new("x.spz")).map_err(|error| format!("{error:#}"))
        };
        assert_eq!(outcome(false, true), Ok(7));
        assert_eq!(outcome(false, false), Err("writing x.spz: disk full".to_owned()));
        assert_eq!(outcome(true, true), Err("x.spz contains the last good state: the loss is NaN".to_owned()));
        let both = "writing x.spz: disk full; the run had stopped before: the loss is NaN";
        assert_eq!(outcome(true, false), Err(both.to_owned()));
    }

    #[test]
    fn a_rendering_beyond_the_limit_names_its_options() {
        let error = args().with_option(SplatError::Memory { needed: 9, limit: 5 }.into());
        let options = "--memory 1 (MiB), or fewer Gaussians by --max-gaussians";
        assert_eq!(format!("{error:#}"), format!("{options}: rendering needs 9 bytes, the limit is 5"));
    }
}
