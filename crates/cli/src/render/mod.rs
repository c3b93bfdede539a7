//! `atsplat render`: renders Gaussians along a camera path.

pub(crate) mod backend;
mod check;
mod effects;
mod inputs;
mod preview;
mod scene_file;
mod settings;
mod times;
mod views;

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use atsplat_eval::rendering::FrameTimings;
use atsplat_eval::rendering::{
    ExposureSource, Exposures, Frame, FrameCounts, FrameFiles, FrameRequest, RENDER_RECORD, Record, RenderFile,
    RenderPlan, RenderSettingsRecord, Report, ViewRecord, empty_frames, empty_frames_warning, ignored_principal_points,
    render_all, unknown_images,
};
use atsplat_pixels::Rounding;
use atsplat_scene::Warnings;
use atsplat_splat::effects::Scene;
use atsplat_splat::gpu::AdapterChoice;
use atsplat_splat::round_trip::{RoundTripFormat, RoundTrips};
use atsplat_splat::{GaussianCounts, Gaussians, RenderOptions, Renderer, View};
use clap::ValueEnum;

use crate::output_lock::OutputLock;
use crate::parse::named;
use crate::paths::PendingFile;
use crate::print::{print_report, warn};
use crate::progress::Progress;
use crate::warnings::print_warnings;
use backend::{Backend, BackendArg, adapter, backend};
use effects::EffectArgs;
use preview::PreviewArgs;
use scene_file::SceneArgs;
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

    /// Renderer.
    #[arg(long, value_name = "NAME", default_value = "cpu", help_heading = "Rendering")]
    backend: BackendArg,

    /// Adapter that `--backend gpu` renders on: its number, or a part of its name; see `atsplat adapters`.
    #[arg(long, value_name = "NAME", value_parser = adapter, help_heading = "Rendering")]
    adapter: Option<AdapterChoice>,

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
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = named(RoundTripFormat::ALL.map(|format| (format.name(), format))), help_heading = "Output")]
    round_trip: Vec<RoundTripFormat>,

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
    args.check_inputs(cameras.as_deref())?;
    let Backend { mut renderer, note, .. } = backend(args.backend, args.adapter.as_ref())?;
    // Before the files in the folder, which is removed last if nothing is written.
    let _lock = OutputLock::of(&args.out)?;
    let record_file = PendingFile::open(&args.out.join(RENDER_RECORD))?;
    let preview_file = args.preview.open()?;
    let constants = args.settings.constants()?;

    let scene = args.scene.read()?;
    let settings = args.effects.settings(args.settings.options(constants, &scene, args.writes(FormatArg::Exr))?);
    let RenderPlan { mut requests, path, notes } = args.views.plan(cameras, &scene, args.exposure.is_some())?;
    exposures.expose(&mut requests)?;
    let (gaussians, mut notes) = (scene.gaussians, [scene.warnings, notes].concat());
    notes.extend(note);
    notes.extend(args.settings.warning(&gaussians, settings.options.mode).map(str::to_owned));
    notes.extend(ignored_principal_points(&settings.options.constants, &requests));
    notes.extend(settings.options.ignored_harmonics(&gaussians));

    let mut preview = preview_file.map(|file| args.preview.start(file, &requests)).transpose()?;
    let files = args.files();
    let progress = Progress::new("frames", requests.len());
    let frames = render_all(
        renderer.as_mut(),
        (&Scene::new(&gaussians, requests.len()), &requests),
        &settings,
        &files,
        preview.as_mut().map(|pending| &mut pending.preview),
        args.timings,
        &|| progress.step(),
    )?;
    drop(progress);
    let done = frames.iter().filter(|frame| frame.fault.is_none()).count();
    let faults =
        || requests.iter().zip(&frames).filter_map(|(request, frame)| Some((request.number, frame.fault.as_ref()?)));
    if done == 0 {
        let first = faults().next().map_or_else(String::new, |(number, fault)| format!("frame {number}: {fault}"));
        bail!("no frame could be rendered; {first}");
    }
    if let Some(preview) = preview {
        preview.finish()?;
    }
    notes.extend(faults().map(|(number, fault)| format!("frame {number}: {fault}")));
    let is_drawn = empty_frames(&frames) == 0;
    notes.extend(empty_frames_warning(&frames, &gaussians));
    let round_trip = (!args.round_trip.is_empty()).then(|| {
        let views: Vec<_> = requests.iter().map(|request| (request.view, request.exposed(&settings.options))).collect();
        let measured = measure_round_trips(renderer.as_mut(), &gaussians, &views, &args.round_trip);
        // The images are already written: a failure is recorded with them.
        measured.unwrap_or_else(|error| RoundTrips::failed(format!("--round-trip: {error:#}")))
    });
    let failure = round_trip.as_ref().and_then(RoundTrips::failure);

    let mut gaussian_counts = GaussianCounts::default();
    frames.iter().filter_map(|frame| frame.counts).for_each(|counts| gaussian_counts += counts);
    let record = Record {
        atsplat: env!("CARGO_PKG_VERSION"),
        scene: scene.record,
        path,
        backend: renderer.name(),
        settings: RenderSettingsRecord::of(&settings.options)?,
        effects: settings.summary(&frames),
        rounding: files.rounding,
        values: "display-referred RGB, over the background",
        frames: FrameCounts { requested: requests.len(), done, failed: requests.len() - done },
        gaussian_counts,
        round_trip,
        warnings: notes,
    };
    let views = requests.iter().zip(&frames).map(|(request, frame)| ViewRecord::of(request, frame)).collect();
    let text = serde_json::to_string_pretty(&RenderFile { record: &record, views })?;
    record_file.finish(format!("{text}\n").as_bytes())?;
    let rendered = frames.iter().filter(|frame| frame.counts.is_some()).map(|frame| &frame.timing);
    let timings = args.timings.then(|| FrameTimings::of(scene.reading_secs, rendered));
    let explanation = match first_complete(&requests, &frames).filter(|_| args.effects.explain) {
        Some(request) => {
            // A new scene, so that what is computed once per scene is timed too.
            let scene = Scene::new(&gaussians, requests.len());
            Some(settings.plan(&scene, request)?.explain(renderer.as_mut(), &scene, EXPLANATION_PAIRS)?)
        }
        None => None,
    };
    let preview = args.preview.preview.clone();
    let report = Report { out: args.out.clone(), preview, record, timings, explanation };
    print_report(&report, args.json)?;
    print_warnings(&warnings);
    for warning in &report.record.warnings {
        warn(warning);
    }
    let unknown = unknown_images(&args.out, &frames)?;
    if unknown > 0 {
        warn(&format!("{} holds {unknown} images from another run", args.out.display()));
    }
    failure.map_or(Ok(report.record.frames.failed == 0 && is_drawn), |failure| bail!("{failure}"))
}

fn measure_round_trips(
    renderer: &mut dyn Renderer,
    gaussians: &Gaussians,
    views: &[(View, RenderOptions)],
    formats: &[RoundTripFormat],
) -> anyhow::Result<RoundTrips> {
    let temporary = std::env::temp_dir();
    let scratch = tempfile::tempdir_in(&temporary)
        .with_context(|| format!("creating a folder for the round trip in {}", temporary.display()))?;
    let progress = Progress::new("views of the round trip", views.len());
    Ok(RoundTrips::measure(renderer, gaussians, views, formats, scratch.path(), &mut || progress.step())?)
}

/// The first complete frame.
fn first_complete<'a>(requests: &'a [FrameRequest], frames: &[Frame]) -> Option<&'a FrameRequest> {
    requests.iter().zip(frames).find(|(_, frame)| frame.fault.is_none()).map(|(request, _)| request)
}

impl Args {
    fn writes(&self, format: FormatArg) -> bool {
        self.formats.contains(&format)
    }

    fn files(&self) -> FrameFiles {
        FrameFiles {
            folder: self.out.clone(),
            png: self.writes(FormatArg::Png),
            exr: self.writes(FormatArg::Exr),
            rounding: self.rounding.unwrap_or(Rounding::Nearest),
        }
    }
}
