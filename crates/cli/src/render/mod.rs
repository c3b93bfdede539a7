//! `atsplat render`: renders Gaussians along a camera path.

mod check;
mod effects;
mod inputs;
mod preview;
mod round_trip;
mod settings;
mod spline;
mod views;

use std::path::PathBuf;

use anyhow::bail;
use atsplat_eval::rendering::{
    ExposureSource, Exposures, Frame, FrameCounts, FrameFiles, FrameRequest, FrameTimings, RENDER_RECORD, Record,
    RenderFile, RenderSettingsRecord, Report, ViewRecord, empty_frames, empty_frames_warning, render_all,
    unknown_images_warning,
};
use atsplat_pixels::Rounding;
use atsplat_scene::Warnings;
use atsplat_splat::effects::{Explanation, Scene};
use atsplat_splat::files::Output;
use atsplat_splat::round_trip::RoundTrips;
use atsplat_splat::{GaussianCounts, Renderer};
use clap::ValueEnum;

use crate::device::RendererArgs;
use crate::output_lock::OutputLock;
use crate::parse::named;
use crate::paths::PendingFile;
use crate::print::{print_report, warn};
use crate::progress::Progress;
use crate::warnings::print_warnings;
use effects::EffectArgs;
use inputs::{Inputs, Origin, SceneArgs};
use preview::PreviewArgs;
use settings::RenderSettingsArgs;
use views::ViewArgs;

/// The cost of an effect is the median over this many pairs of renders.
const EXPLANATION_PAIRS: usize = 5;

// The scene comes first: `--orbit` and `--spline` take a number where one follows.
#[derive(Debug, clap::Args)]
#[command(
    override_usage = "atsplat render <SCENE> --out <DIR> <--cameras <FILE> | --orbit [N] | --spline <FILE> [N]> [OPTIONS]"
)]
pub(crate) struct Args {
    #[command(flatten)]
    scene: SceneArgs,

    #[command(flatten, next_help_heading = "Cameras")]
    views: ViewArgs,

    #[command(flatten, next_help_heading = "Rendering")]
    settings: RenderSettingsArgs,

    #[command(flatten, next_help_heading = "Rendering")]
    effects: EffectArgs,

    /// Exposure applied after compositing: a gain for every view, or a .json like 3DGS' `exposure.json`, with a 3x4 array per
    /// view name; by default as recorded in a `render.json`, else none.
    #[arg(long, value_name = "GAIN|FILE", help_heading = "Rendering")]
    exposure: Option<ExposureSource>,

    #[command(flatten, next_help_heading = "Rendering")]
    device: RendererArgs,

    /// Folder for `000000.png`, `000000.exr`, … and `render.json`, which records how they were made.
    #[arg(long, short, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,

    /// Files per frame: png (8 bits), exr (colour, alpha, depth as f32).
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "png", help_heading = "Output")]
    formats: Vec<FormatArg>,

    /// Rounding from f32 to 8 bits: to the nearest, which is the default, or truncated as pixelSplat does.
    #[arg(long, value_name = "RULE", value_parser = named(ROUNDINGS), help_heading = "Output")]
    rounding: Option<Rounding>,

    #[command(flatten, next_help_heading = "Output")]
    preview: PreviewArgs,

    /// Print the time per stage; frames are then rendered and written one after the other.
    #[arg(long, help_heading = "Output")]
    timings: bool,

    /// Export, import, render again and print the loss in dB: ply, ply-ascii, ply-big-endian, spz2, spz3. Renders every
    /// view once more, and once per format.
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = named(Output::ALL.map(|format| (format.name(), format))), help_heading = "Output")]
    round_trip: Vec<Output>,

    /// Print JSON.
    #[arg(long, help_heading = "Output")]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FormatArg {
    Png,
    Exr,
}

const ROUNDINGS: [(&str, Rounding); 2] = [("nearest", Rounding::Nearest), ("truncate", Rounding::Truncate)];

/// Renders; `true` if every frame is complete and shows a Gaussian.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    args.check()?;
    let exposures = Exposures::of(args.exposure.as_ref())?;
    let mut warnings = Warnings::new();
    let cameras = args.views.read(&mut warnings)?;
    args.check_outputs(cameras.as_deref())?;
    let backend = args.device.open()?;
    // Before the files in the folder, which is removed last if nothing is written.
    let _lock = OutputLock::of(&args.out)?;
    let record_file = PendingFile::open(&args.out.join(RENDER_RECORD))?;
    let preview_file = args.preview.open()?;

    let (inputs, origin) = Inputs::read(args, cameras, &exposures)?;
    let frames = backend.with(|renderer| args.render(renderer, &inputs, preview_file))?;
    let round_trip = backend.with(|renderer| round_trip::measure(renderer, &inputs, &args.round_trip));
    let record = args.record(&inputs, origin, &frames, backend.name(), round_trip)?;
    let views = inputs.requests.iter().zip(&frames).map(|(request, frame)| ViewRecord::of(request, frame)).collect();
    let text = serde_json::to_string_pretty(&RenderFile { record: &record, views })?;
    record_file.finish(format!("{text}\n").as_bytes())?;

    let report = Report {
        out: args.out.clone(),
        preview: args.preview.preview.clone(),
        timings: args.timings.then(|| timings(&inputs, &frames)),
        explanation: if args.effects.explain {
            backend.with(|renderer| explanation(renderer, &inputs, &frames))?
        } else {
            None
        },
        record,
    };
    args.print(&report, &warnings, &frames)?;
    match report.record.round_trip.as_ref().and_then(RoundTrips::failure) {
        Some(failure) => bail!("{failure}"),
        None => Ok(report.record.frames.failed == 0 && empty_frames(&frames) == 0),
    }
}

impl Args {
    fn writes(&self, format: FormatArg) -> bool {
        self.formats.contains(&format)
    }

    fn rounding(&self) -> Rounding {
        self.rounding.unwrap_or(Rounding::Nearest)
    }

    /// Renders and writes the frames and their animation. An incomplete frame is not an error, unless all are.
    fn render(
        &self,
        renderer: &mut dyn Renderer,
        Inputs { gaussians, requests, settings, .. }: &Inputs,
        preview_file: Option<PendingFile>,
    ) -> anyhow::Result<Vec<Frame>> {
        let mut preview = preview_file.map(|file| self.preview.start(file, requests)).transpose()?;
        let files = FrameFiles {
            folder: self.out.clone(),
            png: self.writes(FormatArg::Png),
            exr: self.writes(FormatArg::Exr),
            rounding: self.rounding(),
        };
        let progress = Progress::new("frames", requests.len());
        let frames = render_all(
            renderer,
            (&Scene::new(gaussians, requests.len()), requests),
            settings,
            &files,
            preview.as_mut().map(|pending| &mut pending.preview),
            self.timings,
            &|| progress.step(),
        )?;
        drop(progress);
        if frames.iter().all(|frame| frame.fault.is_some()) {
            bail!("no frame could be rendered; {}", faults(requests, &frames).next().unwrap_or_default());
        }
        if let Some(preview) = preview {
            preview.finish()?;
        }
        Ok(frames)
    }

    /// What all images have in common.
    fn record(
        &self,
        Inputs { gaussians, requests, settings, .. }: &Inputs,
        Origin { scene, path, mut notes }: Origin,
        frames: &[Frame],
        backend: String,
        round_trip: Option<RoundTrips>,
    ) -> anyhow::Result<Record> {
        notes.extend(faults(requests, frames));
        notes.extend(empty_frames_warning(frames, gaussians));
        let done = frames.iter().filter(|frame| frame.fault.is_none()).count();
        let mut gaussian_counts = GaussianCounts::default();
        frames.iter().filter_map(|frame| frame.counts).for_each(|counts| gaussian_counts += counts);
        Ok(Record {
            atsplat: env!("CARGO_PKG_VERSION"),
            scene,
            path,
            backend,
            settings: RenderSettingsRecord::of(&settings.options)?,
            effects: settings.summary(frames),
            rounding: self.rounding(),
            values: "display-referred RGB, over the background",
            frames: FrameCounts { requested: requests.len(), done, failed: requests.len() - done },
            gaussian_counts,
            round_trip,
            warnings: notes,
        })
    }

    fn print(&self, report: &Report, warnings: &Warnings, frames: &[Frame]) -> anyhow::Result<()> {
        print_report(report, self.json)?;
        print_warnings(warnings);
        for warning in &report.record.warnings {
            warn(warning);
        }
        if let Some(warning) = unknown_images_warning(&self.out, &[""], frames.iter().flat_map(|frame| &frame.files))? {
            warn(&warning);
        }
        Ok(())
    }
}

/// Why frames are incomplete.
fn faults(requests: &[FrameRequest], frames: &[Frame]) -> impl Iterator<Item = String> {
    let pairs = requests.iter().zip(frames);
    pairs.filter_map(|(request, frame)| Some(format!("frame {}: {}", request.number, frame.fault.as_ref()?)))
}

fn timings(inputs: &Inputs, frames: &[Frame]) -> FrameTimings {
    let rendered = frames.iter().filter(|frame| frame.counts.is_some()).map(|frame| &frame.timing);
    FrameTimings::of(inputs.reading_secs, rendered)
}

/// Explains the effects of the first complete frame.
fn explanation(
    renderer: &mut dyn Renderer,
    Inputs { gaussians, requests, settings, .. }: &Inputs,
    frames: &[Frame],
) -> anyhow::Result<Option<Explanation>> {
    let Some((request, _)) = requests.iter().zip(frames).find(|(_, frame)| frame.fault.is_none()) else {
        return Ok(None);
    };
    // A new scene, so that what is computed once per scene is timed too.
    let scene = Scene::new(gaussians, requests.len());
    Ok(Some(settings.plan(&scene, request)?.explain(renderer, &scene, EXPLANATION_PAIRS)?))
}
