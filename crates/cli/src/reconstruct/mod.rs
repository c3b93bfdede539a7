//! `atsplat reconstruct`: posed photos through the network into Gaussians.

mod input;
pub(crate) mod network;
mod output;
mod plots;
mod rendered;
mod renders;
mod report;

use std::path::PathBuf;

use anyhow::Context as _;
use atsplat_model::network::{Processor, Reconstruction};
use atsplat_model::{ImageSize, budget};
use atsplat_scene::Warnings;
use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::expansion::UNTRAINED;
use crate::memory;
use crate::output::{PendingFile, complain, print_report, print_warnings};
use input::InputWords;
use network::NetworkWords;
use output::SceneFormat;
use plots::PlotWords;
use renders::RenderWords;
use report::{Clock, Record, Report, TokenRecord};

// The dataset comes first, as in the other commands.
#[derive(Debug, Args)]
#[command(
    mut_arg("weights", |weights| weights.required(true)),
    override_usage = "atsplat reconstruct <DATA> --views <SEL> --weights <FILE|random:SEED> --out <FILE> [OPTIONS]"
)]
pub(crate) struct Words {
    #[command(flatten)]
    input: InputWords,

    #[command(flatten, next_help_heading = "Network")]
    network: NetworkWords,

    /// File that ends in .ply or .spz. FILE.json beside it tells how it was made.
    #[arg(long, short, value_name = "FILE", value_parser = output::path, help_heading = "Output")]
    out: PathBuf,

    /// Whose axes and unit of length the file has: the dataset's, so that its cameras see the Gaussians where the photos
    /// see the scene, or the network's, which are those of the normalised poses.
    #[arg(long, value_name = "FRAME", default_value = "scene", help_heading = "Output")]
    frame: FrameWord,

    #[command(flatten, next_help_heading = "Output")]
    renders: RenderWords,

    #[command(flatten, next_help_heading = "Output")]
    plots: PlotWords,

    /// Print tokens and Gaussians of each block, seconds of each stage, and memory.
    #[arg(long, help_heading = "Output")]
    explain: bool,

    /// Print JSON.
    #[arg(long, help_heading = "Output")]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
enum FrameWord {
    Scene,
    Network,
}

/// Reconstructs; `true`, since nothing is skipped.
pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    words.check()?;
    let device = words.network.processor.open()?;
    let mut clock = Clock::default();
    let format = SceneFormat::of_path(&words.out).map_err(anyhow::Error::msg)?;
    let record_file = PendingFile::open(&output::record_path(&words.out))?;
    // The file itself is tried before long work too.
    drop(PendingFile::open(&words.out)?);
    words.renders.open()?;
    words.plots.open()?;

    let mut warnings = Warnings::new();
    let source = words.network.source()?;
    let input = clock.time("cameras", || words.input.read(&source.config, &mut warnings))?;
    let size = input.size()?;
    // What does not fit is told before weights and pictures are read.
    budget::budget(&source.config, input.trial.context().len(), source.sees(size))?;
    let (network, weights) = clock.time("weights", || source.load(&device))?;
    let views = clock.time("pictures", || input.views())?;
    let made = network.reconstruct(&views, words.network.seed).context("reconstructing")?;
    clock.extend(made.seconds.stages());

    let normalisation = input.trial.normalisation();
    let output = clock.time("writing", || {
        let in_scene = match words.frame {
            FrameWord::Network => None,
            FrameWord::Scene => Some(made.gaussians.transformed(&normalisation.new_from_old.inverse())?),
        };
        output::write(&words.out, in_scene.as_ref().unwrap_or(&made.gaussians), format, words.frame)
    })?;
    let renders = clock.time("renders", || words.renders.render(&made.gaussians, &input))?;
    let subject = match weights.untrained() {
        Some(_) => format!("{} ({UNTRAINED})", source.config.name),
        None => source.config.name.clone(),
    };
    let plots = clock.time("plots", || {
        let options = words.renders.options(input.trial.near_far())?;
        words.plots.draw(&network, &input, options, words.network.seed, &subject)
    })?;
    let record = Record {
        atsplat: env!("CARGO_PKG_VERSION"),
        input: input.record(&words.input),
        model: source.record()?,
        weights,
        seed: words.network.seed,
        device: words.network.processor.into(),
        seen_at: made.seen_at,
        tokens: TokenRecord::of(&made),
        output,
        renders,
        plots,
        warnings: notes(&made, &input, words.network.processor.into()),
    };
    let text = serde_json::to_string_pretty(&record)?;
    record_file.finish(format!("{text}\n").as_bytes())?;
    let report = Report {
        record,
        seconds: clock,
        memory: report::MemoryRecord::of(made.memory, memory::peak_bytes()),
        size,
        explain: words.explain,
    };
    print_report(&report, words.json)?;
    print_warnings(&warnings);
    for note in &report.record.warnings {
        complain(&format!("warning: {note}"));
    }
    if let Some(told) = report.record.weights.untrained() {
        complain(&format!("warning: UNTRAINED: {told}"));
    }
    Ok(true)
}

/// What a user should know.
fn notes(made: &Reconstruction, input: &input::Input, processor: Processor) -> Vec<String> {
    let refused = |why| format!("the graphics processor makes no pictures of the network's Gaussians: {why}");
    let mut notes: Vec<String> = processor.refusal().map(refused).into_iter().collect();
    let fallbacks = &input.trial.normalisation().fallbacks;
    if !fallbacks.is_empty() {
        let names: Vec<String> = fallbacks.iter().map(|fallback| format!("{fallback:?}")).collect();
        notes.push(format!("the pose normalisation had no stable answer for these views: {}", names.join(", ")));
    }
    let bent = input.trial.context().iter().filter(|view| view.camera.distortion != input::NO_DISTORTION).count();
    if bent > 0 {
        notes.push(format!(
            "{bent} views have lens distortion: their rays bend as the lens does, which the papers' networks have never \
             seen; `atsplat data undistort` takes it out of the photos, --no-distortion ignores it"
        ));
    }
    let found = made.gaussians.validate();
    if !found.is_clean() {
        let (invalid, total) = (found.invalid, found.total);
        notes.push(format!("{invalid} of {total} Gaussians have a problem; `atsplat render` tells which"));
    }
    notes
}

impl Words {
    /// Words that do not fit together, told before any file is read or made.
    fn check(&self) -> Result<(), clap::Error> {
        let told =
            self.network.check().and_then(|()| self.renders.check(self.input.has_targets() && !self.plots.asked()));
        told.map_err(|text| clap::Command::new("atsplat").error(clap::error::ErrorKind::ValueValidation, text))
    }
}

/// Height and width, as the model counts pixels.
fn model_size(size: atsplat_camera::ImageSize) -> ImageSize {
    ImageSize::new(size.height as usize, size.width as usize)
}
