//! `atsplat render`: Gaussians along a path of cameras, into pictures.

pub(crate) mod backend;
pub(crate) mod camera_file;
mod check;
mod effects;
mod exposures;
pub(crate) mod frames;
mod framing;
mod look;
pub(crate) mod picture;
mod preview;
mod report;
mod round_trip;
mod scene_file;
mod timings;
mod views;
pub(crate) mod words;

use std::path::PathBuf;

use anyhow::bail;
use atsplat_pixels::Rounding;
use atsplat_scene::Warnings;
use atsplat_splat::Census;
use atsplat_splat::gpu::AdapterChoice;
use clap::{Args, ValueEnum};

use crate::output::{complain, print_report, print_warnings};
use backend::{Backend, BackendWord, adapter, backend};
use effects::EffectWords;
use exposures::{ExposureWord, Exposures};
use frames::{Frame, FrameFiles, open_folder, shoot, strangers, unseen};
use look::{LookRecord, LookWords, ignored};
use preview::PreviewWords;
use report::{FrameCounts, Record, RenderFile, Report, ViewRecord};
use round_trip::{RoundTripWord, RoundTrips};
use scene_file::SceneWords;
use timings::Timings;
use views::{Plan, Shot, ViewWords};

/// Pairs of renderings that an effect's cost is the median of.
const EXPLAINING_PAIRS: usize = 5;

// The scene comes first: `--orbit` and `--spline` take a number where one follows.
#[derive(Debug, Args)]
#[command(
    override_usage = "atsplat render <SCENE> --out <DIR> <--cameras <FILE> | --orbit [N] | --spline <FILE> [N]> [OPTIONS]"
)]
pub(crate) struct Words {
    #[command(flatten)]
    scene: SceneWords,

    #[command(flatten, next_help_heading = "Cameras")]
    views: ViewWords,

    #[command(flatten, next_help_heading = "Rendering")]
    look: LookWords,

    #[command(flatten, next_help_heading = "Rendering")]
    effects: EffectWords,

    /// What becomes of colour after compositing: a gain for every view, or a .json like 3DGS's `exposure.json`, with a
    /// 3x4 array for each view's name; by default what a `render.json` says, else nothing.
    #[arg(long, value_name = "GAIN|FILE", help_heading = "Rendering")]
    exposure: Option<ExposureWord>,

    /// Who renders.
    #[arg(long, value_name = "NAME", default_value = "cpu", help_heading = "Rendering")]
    backend: BackendWord,

    /// Adapter that `--backend gpu` renders on: its number, or a part of its name; see `atsplat adapters`.
    #[arg(long, value_name = "NAME", value_parser = adapter, help_heading = "Rendering")]
    adapter: Option<AdapterChoice>,

    /// Folder for `000000.png`, `000000.exr`, … and `render.json`, which tells how they were made.
    #[arg(long, short, value_name = "DIR", help_heading = "Output")]
    out: PathBuf,

    /// What is written of each frame: png (8 bits), exr (colour, opacity, depth as f32).
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "png", help_heading = "Output")]
    formats: Vec<FormatWord>,

    /// How f32 becomes 8 bits: to the nearest, or truncated as pixelSplat does.
    #[arg(long, value_name = "RULE", default_value = "nearest", help_heading = "Output")]
    rounding: RoundingWord,

    #[command(flatten, next_help_heading = "Output")]
    preview: PreviewWords,

    /// Print where the time goes, stage by stage; frames are then written one after the other, not meanwhile.
    #[arg(long, help_heading = "Output")]
    timings: bool,

    /// Export, import, render again and print what that cost in dB: ply, ply-ascii, ply-big-endian, spz2, spz3. Renders
    /// every view once more, and once for each format.
    #[arg(long, value_name = "LIST", value_delimiter = ',', help_heading = "Output")]
    round_trip: Vec<RoundTripWord>,

    /// Print JSON.
    #[arg(long, help_heading = "Output")]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FormatWord {
    Png,
    Exr,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum RoundingWord {
    Nearest,
    Truncate,
}

/// Renders; `true` where every frame is whole.
pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    words.check()?;
    words.views.spare(&words.out.join("render.json"))?;
    let exposures = Exposures::read(words.exposure.as_ref())?;
    let Backend { mut renderer, note } = backend(words.backend, words.adapter.as_ref())?;
    let record_file = open_folder(&words.out)?;
    let preview_file = words.preview.open()?;
    let constants = words.look.constants()?;
    let mut warnings = Warnings::new();
    let cameras = words.views.read(&mut warnings)?;

    let scene = words.scene.read()?;
    let look = words.effects.look(words.look.options(constants, &scene, words.writes(FormatWord::Exr))?);
    let Plan { mut shots, path, notes } = words.views.plan(cameras, &scene.gaussians)?;
    exposures.expose(&mut shots)?;
    let (gaussians, mut notes) = (scene.gaussians, [scene.notes, notes].concat());
    notes.extend(note);
    notes.extend(ignored(&look.options.constants, &shots));

    let mut preview = preview_file.map(|file| words.preview.start(file, &shots)).transpose()?;
    let files = words.files();
    let frames = shoot(renderer.as_mut(), (&gaussians, &shots), &look, &files, preview.as_mut(), words.timings)?;
    let done = frames.iter().filter(|frame| frame.fault.is_none()).count();
    let faults = || shots.iter().zip(&frames).filter_map(|(shot, frame)| Some((shot.number, frame.fault.as_ref()?)));
    if done == 0 {
        let first = faults().next().map_or_else(String::new, |(number, fault)| format!("frame {number}: {fault}"));
        bail!("no frame could be rendered; {first}");
    }
    if let Some(preview) = preview {
        preview.finish()?;
    }
    notes.extend(faults().map(|(number, fault)| format!("frame {number}: {fault}")));
    notes.extend(unseen(&frames, &gaussians));
    let formats = &words.round_trip;
    let round_trip = (!formats.is_empty())
        .then(|| RoundTrips::measure(renderer.as_mut(), (&gaussians, &shots), &look.options, formats));
    let broken_promise = round_trip.as_ref().and_then(RoundTrips::broken_promise);

    let mut census = Census::default();
    frames.iter().filter_map(|frame| frame.census).for_each(|of_frame| census += of_frame);
    let record = Record {
        atsplat: env!("CARGO_PKG_VERSION"),
        scene: scene.record,
        path,
        backend: renderer.name(),
        look: LookRecord::of(&look.options)?,
        effects: look.record(&frames),
        rounding: files.rounding,
        values: "display-referred RGB, over the background",
        frames: FrameCounts { asked: shots.len(), done, failed: shots.len() - done },
        census,
        round_trip,
        warnings: notes,
    };
    let views = shots.iter().zip(&frames).map(|(shot, frame)| ViewRecord::of(shot, frame)).collect();
    let text = serde_json::to_string_pretty(&RenderFile { record: &record, views })?;
    record_file.finish(format!("{text}\n").as_bytes())?;
    let timings = words.timings.then(|| Timings::of(scene.reading_secs, &frames));
    let explanation = match whole(&shots, &frames).filter(|_| words.effects.explain) {
        Some(shot) => Some(look.plan(&gaussians, shot)?.explain(renderer.as_mut(), &gaussians, EXPLAINING_PAIRS)?),
        None => None,
    };
    let preview = words.preview.preview.clone();
    let report = Report { out: words.out.clone(), preview, record, timings, explanation };
    print_report(&report, words.json)?;
    print_warnings(&warnings);
    for note in &report.record.warnings {
        complain(&format!("warning: {note}"));
    }
    let strangers = strangers(&words.out, &frames)?;
    if strangers > 0 {
        complain(&format!("warning: {} holds {strangers} pictures of another call", words.out.display()));
    }
    broken_promise.map_or(Ok(report.record.frames.failed == 0), |promise| bail!("{promise}"))
}

/// The first frame that nothing is wrong with.
fn whole<'a>(shots: &'a [Shot], frames: &[Frame]) -> Option<&'a Shot> {
    shots.iter().zip(frames).find(|(_, frame)| frame.fault.is_none()).map(|(shot, _)| shot)
}

impl Words {
    fn writes(&self, format: FormatWord) -> bool {
        self.formats.contains(&format)
    }

    fn files(&self) -> FrameFiles {
        FrameFiles {
            folder: self.out.clone(),
            png: self.writes(FormatWord::Png),
            exr: self.writes(FormatWord::Exr),
            rounding: match self.rounding {
                RoundingWord::Nearest => Rounding::Nearest,
                RoundingWord::Truncate => Rounding::Truncate,
            },
        }
    }
}
