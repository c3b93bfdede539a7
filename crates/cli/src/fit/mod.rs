//! `atsplat fit`: optimises Gaussians for one scene.

mod input;
mod report;

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, ensure};
use atsplat_eval::reconstruct::rounding_warning;
use atsplat_fit::{
    Background, Budget, Elapsed, Fit, FitConfig, FitError, FitRecord, FitReport, Strategy, TrainingView,
};
use atsplat_scene::{Frame, Warnings};
use atsplat_splat::Gaussians;
use atsplat_splat::files::{self, Encoding, Output};

use crate::device::DeviceArgs;
use crate::output_lock::OutputFiles;
use crate::parse;
use crate::paths::{Input, PendingFile, canonical_path, check_output};
use crate::print::{note, print_report, warn};
use crate::replaced::{photos, refuse_replacing};
use crate::scene_record::record_of;
use crate::warnings::print_warnings;
use input::{InputArgs, StartArgs};
use report::Log;

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

    /// PLY file of the Gaussians, in the frame of DATA; FILE.json next to it records how they were made.
    #[arg(long, short, value_name = "FILE", value_parser = ply, help_heading = "Output")]
    out: PathBuf,

    /// Folder for the learning curve and a contact sheet: renders next to the held-out photos, or next to those of --views if none
    /// are held out.
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    plots: Option<PathBuf>,

    /// Compare with the held-out photos every N steps; by default about eight times in all, and not just after a reset of
    /// opacities, when renders are dark: 3DGS and Mip-Splatting reset them at every tenth of the run in its first half, at least
    /// 300 steps apart.
    #[arg(long, value_name = "N", requires = "held_out", value_parser = clap::value_parser!(u64).range(1..), help_heading = "Output")]
    evaluate_every: Option<u64>,

    /// File for the state of the run, from which --resume continues; a file of another kind is not replaced.
    #[arg(long, value_name = "FILE", help_heading = "Output", conflicts_with = "seconds")]
    checkpoint: Option<PathBuf>,

    /// Write the checkpoint every N steps.
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
    #[arg(long, value_name = "NAME", required_unless_present = "refine", value_parser = parse::named(Strategy::ALL.map(|own| (own.name(), own))))]
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
    #[arg(long, value_name = "RATE", num_args = 0..=1, default_missing_value = "1e-4", value_parser = parse::positive)]
    optimise_poses: Option<f64>,

    /// Optimise each view's exposure too: an affine map of its colours, with this initial learning
    /// rate. Held-out views are
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

    /// Limit on memory for parameters, images and renderer, in MiB.
    #[arg(long, value_name = "MIB", default_value_t = 8192)]
    memory: u64,
}

/// The files of --plots.
const PLOTS: [&str; 3] = ["learning-curve.svg", "learning-curve.png", "contact-sheet.png"];

const BACKGROUNDS: [(&str, Background); 3] =
    [("black", Background::Black), ("white", Background::White), ("random", Background::Random)];

fn ply(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let is_ply = path.extension().is_some_and(|extension| extension == "ply");
    if is_ply { Ok(path) } else { Err(format!("expected a file that ends in .ply, found {text}")) }
}

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
            memory_limit: self.memory.saturating_mul(1 << 20),
            ..FitConfig::new(self.strategy.unwrap_or(Strategy::Fixed), 1)
        }
    }

    /// Names the command-line option, if it differs from the setting's name.
    fn with_option(&self, error: FitError) -> anyhow::Error {
        match error {
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

impl Args {
    /// Refuses files in the place of what is read, and a checkpoint in a file that holds something else.
    fn check_inputs(&self, record_file: &Path) -> anyhow::Result<()> {
        let of_start = |start| match start {
            start if Path::is_dir(start) => Input::Dataset(start),
            start => Input::File("the start that is read", start),
        };
        let of_refine = |weights| Input::File("the weights file that is read", weights);
        let start = self.start.path().map(of_start).or_else(|| self.start.refine.as_deref().map(of_refine));
        let inputs: Vec<Input<'_>> = [Input::Dataset(&self.input.data)].into_iter().chain(start).collect();
        let written = [("--out", self.out.as_path()), ("--out", record_file)].into_iter();
        for (option, file) in written.chain(self.checkpoint.as_deref().map(|file| ("--checkpoint", file))) {
            check_output(option, file, &inputs)?;
        }
        let Some(checkpoint) = self.checkpoint.as_deref() else { return Ok(()) };
        let shown = checkpoint.display();
        if !checkpoint.is_file() {
            if self.resume {
                note(&format!("--resume: there is no checkpoint {shown} yet, so that the run starts anew"));
            }
            return Ok(());
        }
        let is_checkpoint =
            Fit::is_checkpoint(checkpoint).with_context(|| format!("reading the checkpoint {shown}"))?;
        ensure!(is_checkpoint, "--checkpoint: {shown} is no checkpoint of `atsplat fit`: give another file");
        Ok(())
    }

    /// Refuses a checkpoint in a file that the results replace.
    fn check_checkpoint(&self, record_file: &Path) -> anyhow::Result<()> {
        let Some(checkpoint) = &self.checkpoint else { return Ok(()) };
        let kept = canonical_path(checkpoint)?;
        for file in [self.out.as_path(), record_file] {
            if canonical_path(file)? == kept {
                let (checkpoint, file) = (checkpoint.display(), file.display());
                let text = format!("--checkpoint {checkpoint}: --out writes {file}: give the checkpoint another file");
                return Err(parse::usage_error(text).into());
            }
        }
        Ok(())
    }

    /// Fails before long work if a file cannot be written, or another process writes it. None stays open meanwhile: a run that is
    /// interrupted leaves no part of one.
    fn lock_outputs(&self, record_file: &Path) -> anyhow::Result<OutputFiles> {
        let plot = self.plots.as_deref().map(|folder| folder.join(PLOTS[0]));
        let mut outputs = OutputFiles::default();
        for file in [Some(self.out.as_path()), self.checkpoint.as_deref(), plot.as_deref()].into_iter().flatten() {
            outputs.add(file)?;
        }
        drop(PendingFile::open(record_file)?);
        Ok(outputs)
    }

    /// Refuses plots in the place of photos.
    fn check_photos(&self, photographed: &[Frame]) -> anyhow::Result<()> {
        let folder = self.plots.as_deref();
        let plots = folder.into_iter().flat_map(|folder| PLOTS.map(|name| folder.join(name)));
        refuse_replacing("--plots", plots, photos(photographed))
    }
}

/// Warns of properties of the initial Gaussians that are dropped or not optimised.
fn warn_of_start(start: &Gaussians, config: &FitConfig) {
    let (found, kept, strategy) = (start.sh_degree(), config.sh_degree, config.strategy);
    if found > kept {
        warn(&format!(
            "the initial Gaussians have spherical harmonics of degree {found}: those above --sh-degree {kept} are dropped"
        ));
    }
    if start.parts().filter_3d.is_some() && strategy != Strategy::MipSplatting {
        let name = strategy.name();
        warn(&format!(
            "the initial Gaussians have 3D filters (filter_3D), which the strategy {name} leaves as they are"
        ));
    }
}

/// Removes the record of an earlier run, which says nothing about the Gaussians of this one.
fn remove_old(record_file: &Path) -> anyhow::Result<()> {
    match std::fs::remove_file(record_file) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(error).with_context(|| format!("removing {}", record_file.display()))
        }
        _ => Ok(()),
    }
}

/// Optimises until the last step or the end of the time.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    args.start.check()?;
    let record_file = args.out.with_added_extension("json");
    args.check_checkpoint(&record_file)?;
    args.check_inputs(&record_file)?;
    let _outputs = args.lock_outputs(&record_file)?;
    let mut warnings = Warnings::new();
    let network = args.start.network()?;
    let device = if network.is_some() { args.device.open_for_networks()? } else { args.device.open()? };
    let input = args.input.read(network.as_ref(), &mut warnings)?;
    print_warnings(&warnings);
    args.check_photos(&input.scene.frames)?;
    // With --refine, the whole run is in the network's world.
    let normalisation = input.photos.trial().normalisation().new_from_old;
    let mut config = args.optimisation.config(normalisation.scale);
    let network = network.as_ref().map(|source| Ok::<_, anyhow::Error>((source, device.network()?))).transpose()?;
    let (start, start_name) = args.start.gaussians(&input, &args.input, network, (&config, &args.optimisation))?;
    let (start, removed) = (start.gaussians, start.removed);
    warn_of_start(&start, &config);
    let device = device.backend().fit_device();
    let begin = Instant::now();
    let planned = args.optimisation.budget().plan(&config, &input.training, &start, &device);
    let (steps, deadline) = planned.map_err(|error| args.optimisation.with_option(error))?;
    let planning = begin.elapsed().as_secs_f64();
    config.steps = steps;
    let (count, views) = (start.len(), input.training.clone());
    let fit = match args.checkpoint.as_deref().filter(|path| args.resume && path.is_file()) {
        Some(path) => Fit::resume(config, views, &input.held_out, &start, device, path),
        None => Fit::new(config, views, &start).map(|fit| fit.on(device)),
    };
    let mut fit = fit.map_err(|error| args.optimisation.with_option(error))?;
    if fit.dropped() > 0 {
        warn(&format!("{} of {count} initial Gaussians are invalid and were dropped", fit.dropped()));
    }
    if let Some(text) = fit.density_warning() {
        warn(&format!("{}{text}", if deadline.is_some() { "as planned so far, " } else { "" }));
    }
    let mut log = Log::new(&fit, &input.held_out, args.evaluate_every);
    let outcome: anyhow::Result<()> = fit.run(deadline, |fit, step| {
        // Before the checkpoint, which holds the comparison with the held-out photos.
        log.step(fit, step)?;
        if let Some(path) = args.checkpoint.as_deref().filter(|_| step.step.is_multiple_of(args.checkpoint_every)) {
            fit.checkpoint(path)?;
        }
        Ok(())
    });
    let elapsed = fit.elapsed();
    let elapsed = Elapsed { seconds: planning + elapsed.seconds, ..elapsed };
    // Written before further renders, which may fail; after a fault these are the Gaussians of the last good state.
    let gaussians = input.photos.in_scene(&fit.gaussians())?;
    if let Some(text) = rounding_warning(&gaussians) {
        warn(&text);
    }
    remove_old(&record_file)?;
    files::write(&args.out, &gaussians, Output::Ply(Encoding::BinaryLittleEndian))?;
    let mut scaled = Vec::new();
    let is_device_error =
        |error: &anyhow::Error| error.downcast_ref::<FitError>().is_some_and(FitError::is_device_error);
    // A lost adapter renders nothing any more.
    if !outcome.as_ref().is_err_and(is_device_error) {
        log.evaluate(&mut fit)?;
        if let Some(folder) = &args.plots {
            log.draw(folder, &mut fit, &input.training)?;
        }
        scaled = fit.at_scales(&input.scaled)?;
    }
    let names = |views: &[TrainingView]| views.iter().map(|view| view.name.clone()).collect();
    let record = FitRecord {
        atsplat: env!("CARGO_PKG_VERSION"),
        data: args.input.data.clone(),
        scene: input.photos.trial().scene().to_owned(),
        views: names(&input.training),
        held_out: names(&input.held_out),
        inputs: fit.inputs(&input.held_out),
        start: start_name,
        start_gaussians: count + removed,
        dropped: removed + fit.dropped(),
        extent: fit.extent() / normalisation.scale,
        configuration: FitConfig {
            extent: args.optimisation.extent,
            constants: fit.options().constants,
            ..fit.config().clone()
        },
        device: fit.device().to_owned(),
        steps: fit.step_count(),
        file: args.out.clone(),
        gaussians: gaussians.len(),
        corrections: fit.corrections(&normalisation)?,
        training_psnr: fit.history().training_psnr(),
        evaluations: fit.history().evaluations.clone(),
        at_scales: scaled,
    };
    drop(log);
    PendingFile::open(&record_file)?.finish(record_of(&record, &args.out)?.as_bytes())?;
    outcome.with_context(|| format!("{} holds the last good state", args.out.display()))?;
    let out = args.out.display();
    ensure!(fit.step_count() > 0, "--seconds: the time was over before the first step; {out} holds the start");
    print_report(&FitReport::new(record, elapsed), args.json)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_extent_in_units_of_the_data_is_scaled_as_the_views_are() {
        let args = OptimisationArgs {
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
        };
        assert_eq!(args.config(0.25).extent, Some(1.5));
    }
}
