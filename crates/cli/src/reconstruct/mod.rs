//! `atsplat reconstruct`: reconstructs Gaussians from posed photos with a network.

pub(crate) mod input;
pub(crate) mod network;
mod output;

use std::path::PathBuf;

use anyhow::Context as _;
use atsplat_eval::AdapterRecord;
use atsplat_eval::reconstruct::{
    self, Clock, GaussianFrame, MemoryRecord, Record, Report, SceneFormat, TokenRecord, write_gaussians,
};
use atsplat_eval::timing::memory;
use atsplat_model::budget;
use atsplat_scene::Warnings;

use crate::expansion::UNTRAINED;
use crate::parse::{named, usage_error};
use crate::paths::PendingFile;
use crate::print::{print_report, warn};
use crate::warnings::print_warnings;
use input::InputArgs;
use network::NetworkArgs;
use output::{FRAMES, PlotArgs, RenderArgs};

// The dataset comes first, as in the other commands.
#[derive(Debug, clap::Args)]
#[command(
    mut_arg("weights", |weights| weights.required(true)),
    override_usage = "atsplat reconstruct <DATA> --views <SEL> --weights <FILE|NAME|random:SEED> --out <FILE> [OPTIONS]"
)]
pub(crate) struct Args {
    #[command(flatten)]
    input: InputArgs,

    #[command(flatten, next_help_heading = "Network")]
    network: NetworkArgs,

    /// File that ends in .ply or .spz; FILE.json next to it records how it was made.
    #[arg(long, short, value_name = "FILE", value_parser = output::path, help_heading = "Output")]
    out: PathBuf,

    /// Coordinate frame of the file: the dataset's, in which its cameras fit the Gaussians, or the network's, that of the
    /// normalised poses.
    #[arg(long, value_name = "FRAME", default_value = "scene", value_parser = named(FRAMES), help_heading = "Output")]
    frame: GaussianFrame,

    #[command(flatten, next_help_heading = "Output")]
    renders: RenderArgs,

    #[command(flatten, next_help_heading = "Output")]
    plots: PlotArgs,

    /// Print tokens and Gaussians per block, seconds per stage, and memory.
    #[arg(long, help_heading = "Output")]
    explain: bool,

    /// Print JSON.
    #[arg(long, help_heading = "Output")]
    json: bool,
}

/// Reconstructs; always `true`, because nothing is skipped.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    args.check()?;
    let processor = args.network.device.processor;
    let device = processor.open().context("--device")?;
    let mut clock = Clock::default();
    let format = SceneFormat::of_path(&args.out).map_err(anyhow::Error::msg)?;
    let record_file = PendingFile::open(&output::record_path(&args.out))?;
    // Fails before long work if the scene file cannot be written.
    drop(PendingFile::open(&args.out)?);
    args.renders.check_folder()?;
    args.plots.check_folder()?;

    let mut warnings = Warnings::new();
    let source = args.network.source()?;
    let photos = clock.time("cameras", || args.input.read(&source.config, &mut warnings))?;
    let size = photos.size()?;
    // Input that does not fit the model is rejected before weights and images are read.
    budget::budget(&source.config, photos.trial().context().len(), source.input_size(size))?;
    let (network, weights) = clock.time("weights", || source.load(&device))?;
    let views = clock.time("images", || photos.views())?;
    let reconstruction = network.reconstruct(&views, args.network.call_seed()).context("reconstructing")?;
    clock.extend(reconstruction.seconds.stages());

    let (output, clamped) = clock.time("writing", || -> anyhow::Result<_> {
        let in_scene = match args.frame {
            GaussianFrame::Network => None,
            GaussianFrame::Scene => Some(photos.in_scene(&reconstruction.gaussians)?),
        };
        let gaussians = in_scene.as_ref().unwrap_or(&reconstruction.gaussians);
        Ok(write_gaussians(&args.out, gaussians, format, args.frame)?)
    })?;
    let renders = clock.time("renders", || args.renders.render(&reconstruction.gaussians, &photos))?;
    let subject = match weights.untrained() {
        Some(_) => format!("{} ({UNTRAINED})", source.config.name),
        None => source.config.name.clone(),
    };
    let plots = clock.time("plots", || {
        let options = args.renders.options(photos.trial().near_far())?;
        args.plots.draw(&network, &photos, options, args.network.call_seed(), &subject)
    })?;
    let mut notes = reconstruct::warnings(&reconstruction, &photos, processor);
    notes.extend(clamped);
    let record = Record {
        atsplat: env!("CARGO_PKG_VERSION"),
        input: args.input.record(&photos),
        model: source.record()?,
        weights,
        seed: args.network.call_seed(),
        device: processor,
        adapter: network.adapter().as_ref().map(AdapterRecord::from),
        input_size: reconstruction.input_size,
        tokens: TokenRecord::of(&reconstruction),
        output,
        renders,
        plots,
        warnings: notes,
    };
    let text = serde_json::to_string_pretty(&record)?;
    record_file.finish(format!("{text}\n").as_bytes())?;
    let report = Report {
        record,
        seconds: clock,
        memory: MemoryRecord::of(reconstruction.memory, memory::peak_bytes()),
        size,
        explain: args.explain,
    };
    print_report(&report, args.json)?;
    print_warnings(&warnings);
    for warning in &report.record.warnings {
        warn(warning);
    }
    if let Some(message) = report.record.weights.untrained() {
        warn(&format!("UNTRAINED: {message}"));
    }
    Ok(true)
}

impl Args {
    /// Rejects contradicting arguments before any file is read or created.
    fn check(&self) -> Result<(), clap::Error> {
        let renders = || self.renders.check(self.input.has_targets(), self.plots.requested());
        self.network.check().and_then(|()| renders()).map_err(usage_error)
    }
}
