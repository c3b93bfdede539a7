//! `atsplat reconstruct`: reconstructs Gaussians from posed photos with a network.

pub(crate) mod input;
pub(crate) mod network;
mod output;

use std::path::PathBuf;

use anyhow::Context as _;
use atsplat_eval::GaussianFrame;
use atsplat_eval::reconstruct::{
    self, Clock, MemoryRecord, NetworkSource, OutputRecord, PhotoSelection, Photos, Record, RendersRecord, Report,
    TokenRecord, rounding_warning, write_gaussians,
};
use atsplat_eval::timing::memory;
use atsplat_model::budget;
use atsplat_scene::{Frame, Warnings};
use atsplat_splat::Gaussians;
use atsplat_splat::files::Output;

use crate::expansion::UNTRAINED;
use crate::output_lock::OutputFiles;
use crate::overwrite::{Input, check_output, check_outputs, photos};
use crate::parse::{GAUSSIAN_FRAMES, gaussians_file, named, usage_error};
use crate::paths::{check_writable, record_path, remove_old, write_record};
use crate::print::{print_report, warn};
use crate::warnings::print_warnings;
use input::InputArgs;
use network::NetworkArgs;
use output::{PlotArgs, RenderArgs};

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
    #[arg(long, short, value_name = "FILE", value_parser = gaussians_file, help_heading = "Output")]
    out: PathBuf,

    /// World frame of the file: the dataset's, in which its cameras fit the Gaussians, or the trial's, whose poses are
    /// normalised for the network.
    #[arg(
        long, value_name = "FRAME", default_value = "dataset", value_parser = named(GAUSSIAN_FRAMES),
        help_heading = "Output"
    )]
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

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    args.check()?;
    let (processor, seed) = (args.network.device.processor, args.network.call_seed());
    let processors = args.network.device.open_for_networks()?;
    let device = processors.network().with_context(|| format!("--device {processor}"))?;
    let mut clock = Clock::default();
    args.check_outputs()?;
    let _outputs = args.lock_outputs()?;

    let mut warnings = Warnings::new();
    let source = args.network.source()?;
    let photos = clock.time("cameras", || args.read(&source, &mut warnings));
    // They may explain the failure.
    let photos = photos.inspect_err(|_failure| print_warnings(&warnings))?;
    let size = photos.size()?;
    // Input that does not fit the model is rejected before weights and images are read.
    budget::budget(&source.config, photos.trial().context().len(), source.input_size(size))?;
    let (network, weights) = clock.time("weights", || source.load(&device))?;
    let views = clock.time("images", || photos.views())?;
    let reconstruction = network.reconstruct(&views, seed).with_context(|| reconstructing(&photos))?;
    clock.extend(reconstruction.seconds.stages());

    let gaussians = &reconstruction.gaussians;
    let (output, notes_of_output) = clock.time("writing", || args.write(gaussians, &photos))?;
    let renders = clock.time("renders", || args.renders.render(gaussians, &photos, &processors.backend()))?;
    let subject = match weights.untrained() {
        Some(_) => format!("{} ({UNTRAINED})", source.config.name),
        None => source.config.name.clone(),
    };
    let plots = clock.time("plots", || {
        let options = args.renders.options(photos.trial().near_far())?;
        args.plots.draw(&network, &photos, options, seed, &subject)
    })?;
    let unknown_images = renders.as_ref().map(RendersRecord::unknown_images_warning).transpose()?.flatten();
    let notes = [reconstruct::warnings(&reconstruction, &photos, processor), notes_of_output].concat();
    let notes: Vec<String> = notes.into_iter().chain(unknown_images).collect();
    let of_dataset = warnings.summary().map(|(kind, count, first)| format!("{count} × {kind}: {first}"));
    let record = Record {
        atsplat: env!("CARGO_PKG_VERSION"),
        input: args.input.record(&photos, args.renders.background_of_photos()),
        model: source.record()?,
        weights,
        seed,
        device: processor,
        adapter: network.adapter().as_ref().map(atsplat_eval::adapter_record),
        input_size: reconstruction.input_size,
        tokens: TokenRecord::of(&reconstruction),
        output,
        renders,
        plots,
        warnings: of_dataset.into_iter().chain(notes.iter().cloned()).collect(),
    };
    write_record(&record, &args.out)?;
    let report = Report {
        record,
        seconds: clock,
        memory: MemoryRecord::of(reconstruction.memory, memory::peak_bytes()),
        size,
        explain: args.explain,
    };
    print_report(&report, args.json)?;
    print_warnings(&warnings);
    for note in &notes {
        warn(note);
    }
    if let Some(message) = report.record.weights.untrained() {
        warn(&format!("UNTRAINED: {message}"));
    }
    Ok(())
}

/// What failed, if the network does.
fn reconstructing(photos: &Photos) -> String {
    let trial = photos.trial();
    let names: Vec<&str> = trial.context().iter().filter_map(|view| photos.name(view.frame)).collect();
    format!("reconstructing {} from {}", trial.scene(), names.join(", "))
}

impl Args {
    /// Rejects contradicting arguments before any file is read or created.
    fn check(&self) -> Result<(), clap::Error> {
        let renders = || self.renders.check(self.input.has_targets(), self.plots.requested(), self.input.composites());
        self.network.check().and_then(|()| renders()).map_err(usage_error)
    }

    /// Rejects files that would overwrite the weights, or be read as part of the dataset.
    fn check_outputs(&self) -> anyhow::Result<()> {
        let weights = self.network.files().map(|file| Input::File("weights file", file));
        let inputs: Vec<Input<'_>> = weights.chain([Input::Dataset(self.input.data())]).collect();
        for file in [&self.out, &record_path(&self.out)] {
            check_output("--out", file, &inputs)?;
        }
        Ok(())
    }

    /// Fails before long work if a file cannot be written, or another process writes it. None stays open meanwhile.
    fn lock_outputs(&self) -> anyhow::Result<OutputFiles> {
        let mut outputs = OutputFiles::default();
        outputs.add(&self.out)?;
        check_writable(&record_path(&self.out))?;
        self.renders.lock(&mut outputs)?;
        self.plots.lock(&mut outputs)?;
        Ok(outputs)
    }

    /// Prepares cameras, and rejects images that would overwrite the photos.
    fn read(&self, source: &NetworkSource, warnings: &mut Warnings) -> anyhow::Result<Photos> {
        let check = |frames: &[Frame], selection: &PhotoSelection| {
            check_outputs("--renders", self.renders.files(selection), photos(frames))?;
            check_outputs("--plots", self.plots.files(frames), photos(frames))
        };
        self.input.read(&source.config, self.renders.background_of_photos(), &check, warnings)
    }

    /// Writes the Gaussians, and returns their record with warnings. The record of an earlier run is removed.
    fn write(&self, gaussians: &Gaussians, photos: &Photos) -> anyhow::Result<(OutputRecord, Vec<String>)> {
        let format = Output::of_path(&self.out)?;
        remove_old(&record_path(&self.out))?;
        if self.frame == GaussianFrame::Trial {
            return Ok(write_gaussians(&self.out, gaussians, format, self.frame)?);
        }
        let in_scene = photos.in_scene(gaussians)?;
        let (output, mut notes) = write_gaussians(&self.out, &in_scene, format, self.frame)?;
        notes.extend(rounding_warning(&in_scene).map(|text| format!("{text}, or write --frame trial")));
        Ok((output, notes))
    }
}
