//! `atsplat data simulate`: writes scenes simulated from seeds as a dataset.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use atsplat_camera::ImageSize;
use atsplat_numeric::{median, quantile};
use atsplat_report::plot::{EffectCostRow, EffectCosts};
use atsplat_rooms::{
    EffectChoice, EffectKind, FrameCosts, Layout, ManifestScene, PictureCoding, Request, Route, SceneKind, SceneSeed,
    Simulation, Split, WriteOptions, write_dataset,
};
use atsplat_scene::{SceneSource as _, Warnings, scene_key};
use serde::Serialize;

use crate::output::{print_report, print_warnings, warn};
use crate::parse;
use crate::plot::PlotFile;
use crate::progress::Progress;

pub(super) const KINDS: [(&str, SceneKind); 2] = [("rooms", SceneKind::Rooms), ("yards", SceneKind::Yards)];
pub(super) const SPLITS: [(&str, Split); 2] = [("train", Split::Train), ("test", Split::Test)];
const LAYOUTS: [(&str, Layout); 3] =
    [("re10k", Layout::Re10k), ("chunks", Layout::Chunks), ("nerfstudio", Layout::Nerfstudio)];

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for the dataset; it must be new or empty.
    out: PathBuf,

    /// rooms: one or two connected rooms, filmed as in RE10K. yards: courtyards and halls, as in DL3DV.
    #[arg(long, value_name = "KIND", default_value = "rooms", value_parser = parse::named(KINDS))]
    kind: SceneKind,

    /// Split of the scenes; no scene is in both.
    #[arg(long, value_name = "SPLIT", default_value = "test", value_parser = parse::named(SPLITS))]
    split: Split,

    /// Number or range of scenes, as 8 or 16..24.
    #[arg(long, value_name = "N|A..B", default_value = "8", value_parser = numbers)]
    scenes: Range<u32>,

    /// Frames per scene; by default 150 for rooms and 100 for yards.
    #[arg(long, value_name = "N", value_parser = parse::frames, conflicts_with = "route")]
    frames: Option<usize>,

    /// Image size; by default that of the dataset that the layout belongs to: 640x360 for re10k and chunks,
    /// 480x270 for nerfstudio.
    #[arg(long, value_name = "WxH", value_parser = parse::size)]
    size: Option<ImageSize>,

    /// Rays per pixel.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=256))]
    samples: u32,

    /// auto (the effects that can change a scene's images), all, none, or a list, as soft-shadows,motion-blur.
    #[arg(long, value_name = "auto|all|none|LIST", default_value = "auto", value_parser = effects)]
    effects: EffectChoice,

    /// Follow the cameras of this dataset, from a place with enough room.
    #[arg(long, value_name = "DATA")]
    route: Option<PathBuf>,

    /// Which scene of the route's dataset, if it holds several.
    #[arg(long, value_name = "KEY", requires = "route")]
    route_key: Option<String>,

    /// Format of the dataset.
    #[arg(long, value_name = "LAYOUT", default_value = "re10k", value_parser = parse::named(LAYOUTS))]
    layout: Layout,

    /// Image format: png, or jpeg with its quality, as jpeg:90.
    #[arg(long, value_name = "CODING", default_value = "png", value_parser = coding)]
    pictures: PictureCoding,

    /// Also write depth: `depth/<scene>/<frame>.exr`, channel Z, in scene units along the camera's z axis.
    #[arg(long)]
    depth: bool,

    /// Measure in the middle frame of each scene what each effect costs, and what auto saves against all and changes.
    #[arg(long)]
    costs: bool,

    /// Draw the costs, over all scenes, into this file (.svg or .png).
    #[arg(long, value_name = "FILE", requires = "costs", value_parser = PlotFile::parser())]
    plot: Option<PlotFile>,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report {
    folder: PathBuf,
    scenes: Vec<SceneRecord>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct SceneRecord {
    #[serde(flatten)]
    scene: ManifestScene,
    /// Description: the scene's size, its effects and why they run.
    #[serde(skip)]
    description: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    costs: Option<FrameCosts>,
}

/// Simulates; always `true`, because nothing is skipped.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    reject_nonempty_folder(&args.out)?;
    let plot = args.plot.as_ref().map(PlotFile::open).transpose()?;
    let mut warnings = Warnings::new();
    let requests = args.requests(&mut warnings)?;
    let progress = Progress::new("scenes", requests.len());
    let mut records = Vec::new();
    let mut failed = None;
    let record = |simulation: &Simulation, scene: &ManifestScene| {
        match args.costs_of(simulation) {
            Ok(costs) => records.push(SceneRecord { scene: scene.clone(), description: simulation.to_string(), costs }),
            Err(error) => failed = Some(error),
        }
        progress.step();
    };
    let options = WriteOptions { layout: args.layout, coding: args.pictures, depth: args.depth };
    write_dataset(&args.out, requests, &options, &mut warnings, record)?;
    drop(progress);
    if let Some(error) = failed {
        return Err(error);
    }
    let report = Report { folder: args.out.clone(), scenes: records };
    if let Some(plot) = plot {
        plot.finish(|format| report.plot(args).draw().encode(format))?;
    }
    print_report(&report, args.json)?;
    print_warnings(&warnings);
    if args.layout != Layout::Nerfstudio && warnings.counts().next().is_some() {
        warn("note: --layout nerfstudio keeps lens distortion; --effects without lens-distortion simulates none");
    }
    Ok(true)
}

impl Args {
    fn requests(&self, warnings: &mut Warnings) -> anyhow::Result<Vec<Request>> {
        let route = self.route(warnings)?;
        let request = |number| {
            let plain = Request::new(self.kind, SceneSeed { split: self.split, number });
            Request {
                size: self.size(),
                samples: self.samples,
                effects: self.effects.clone(),
                frames: self.frames.unwrap_or(plain.frames),
                route: route.clone(),
                ..plain
            }
        };
        Ok(self.scenes.clone().map(request).collect())
    }

    fn size(&self) -> ImageSize {
        self.size.unwrap_or_else(|| native_size(self.layout))
    }

    fn route(&self, warnings: &mut Warnings) -> anyhow::Result<Route> {
        let Some(path) = &self.route else { return Ok(Route::Natural) };
        let dataset = atsplat_scene::open(path, warnings)?;
        let scene = dataset.load(scene_key(&dataset, self.route_key.as_deref())?, warnings)?;
        // Datasets without timestamps are assumed to have 30 frames per second.
        let cameras = scene.frames.iter().zip(0i64..).map(|(frame, at)| {
            let micros = frame.timestamp_micros.unwrap_or(at * 33_333);
            (micros, frame.camera)
        });
        Ok(Route::Given(cameras.collect()))
    }

    fn costs_of(&self, simulation: &Simulation) -> anyhow::Result<Option<FrameCosts>> {
        let costs = self.costs.then(|| simulation.costs(simulation.shots().len() / 2));
        Ok(costs.transpose()?)
    }
}

/// Files of an earlier dataset would mix with the new ones.
fn reject_nonempty_folder(folder: &Path) -> anyhow::Result<()> {
    if folder.is_file() {
        bail!("expected a folder, found the file {}", folder.display());
    }
    if folder.is_dir() {
        let mut entries = folder.read_dir().with_context(|| format!("reading {}", folder.display()))?;
        if entries.next().is_some() {
            bail!("{} is not empty: expected a new or empty folder", folder.display());
        }
    }
    std::fs::create_dir_all(folder).with_context(|| format!("creating the folder {}", folder.display()))
}

/// Image size that the papers' protocols expect.
const fn native_size(layout: Layout) -> ImageSize {
    match layout {
        Layout::Re10k | Layout::Chunks => ImageSize { width: 640, height: 360 },
        Layout::Nerfstudio => ImageSize { width: 480, height: 270 },
    }
}

impl Report {
    /// What was measured in each scene.
    fn costs(&self) -> Vec<&FrameCosts> {
        self.scenes.iter().filter_map(|record| record.costs.as_ref()).collect()
    }

    /// A table of what was measured in all scenes.
    fn summary(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let costs = self.costs();
        if costs.is_empty() {
            return Ok(());
        }
        writeln!(f, "{:<20} {:>7}  {:>16}", "effect", "scenes", "median ms a frame")?;
        for EffectCostRow { effect, called_for, scenes, millis } in effect_rows(&costs) {
            let measured = millis.map_or_else(|| "-".to_owned(), |[_, median, _]| format!("{median:.1}"));
            writeln!(f, "{effect:<20} {called_for:>3}/{scenes:<3}  {measured:>16}")?;
        }
        writeln!(f, "{}", against_all(&costs))
    }

    /// The median and the quartiles of each effect's costs over the scenes that call for it.
    fn plot(&self, args: &Args) -> EffectCosts {
        let costs = self.costs();
        let frame = median(costs.iter().filter_map(|costs| costs.frame.secs));
        let frame = frame.map_or_else(String::new, |secs| format!("; a frame takes {:.0} ms, median", secs * 1e3));
        let ImageSize { width, height } = args.size();
        EffectCosts {
            title: "What each effect costs in simulated frames, and where it is called for".to_owned(),
            subtitle: format!("{} {}, {width}×{height}, {} rays a pixel{frame}", costs.len(), args.kind, args.samples),
            rows: effect_rows(&costs),
            note: format!("Bars: medians over scenes; lines: quartiles; {}.", against_all(&costs)),
        }
    }
}

fn effect_rows(costs: &[&FrameCosts]) -> Vec<EffectCostRow> {
    let row = |effect: EffectKind| {
        let of = || costs.iter().flat_map(|costs| &costs.effects).filter(|cost| cost.effect == effect);
        let mut millis: Vec<f64> = of().filter_map(|cost| cost.time.secs).map(|secs| secs * 1e3).collect();
        millis.sort_by(f64::total_cmp);
        let at = |share| quantile(&millis, share);
        EffectCostRow {
            effect: effect.to_string(),
            called_for: of().count(),
            scenes: costs.len(),
            millis: at(0.25).zip(at(0.5)).zip(at(0.75)).map(|((low, median), high)| [low, median, high]),
        }
    };
    EffectKind::ALL.into_iter().map(row).collect()
}

/// What the effects that scenes call for save against all of them, and change.
fn against_all(costs: &[&FrameCosts]) -> String {
    let total = |read: fn(&FrameCosts) -> Option<f64>| costs.iter().filter_map(|costs| read(costs)).sum::<f64>();
    let (own, all) = (total(|costs| costs.frame.secs), total(|costs| costs.all.secs));
    let largest = costs.iter().map(|costs| costs.difference.largest).fold(0.0, |a, b| if b > a { b } else { a });
    let beyond = costs.iter().map(|costs| costs.difference.beyond).sum::<f64>() / costs.len() as f64;
    format!(
        "all effects take {:.2} times as long; the largest difference is {:.1} of 255, and {:.3} % of pixels differ by more than 1",
        all / own,
        largest * 255.0,
        beyond * 100.0
    )
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for SceneRecord { description, costs, .. } in &self.scenes {
            f.write_str(description)?;
            costs.iter().try_for_each(|costs| write!(f, "{costs}"))?;
        }
        self.summary(f)?;
        let frames: usize = self.scenes.iter().map(|record| record.scene.frames).sum();
        writeln!(f, "{} scenes, {frames} frames, in {}", self.scenes.len(), self.folder.display())
    }
}

fn numbers(text: &str) -> Result<Range<u32>, String> {
    let number = |text: &str| text.parse::<u32>().ok();
    let range = match text.split_once("..") {
        Some((first, past)) => number(first).zip(number(past)).map(|(first, past)| first..past),
        None => number(text).map(|count| 0..count),
    };
    let message = || format!("expected a number of scenes, or a range as 16..24, found {text:?}");
    range.filter(|range| !range.is_empty()).ok_or_else(message)
}

fn coding(text: &str) -> Result<PictureCoding, String> {
    let quality = |text: &str| text.parse().ok().filter(|quality| (1..=100).contains(quality));
    let coding = match text.split_once(':') {
        None if text == "png" => Some(PictureCoding::Png),
        Some(("jpeg", text)) => quality(text).map(PictureCoding::Jpeg),
        _ => None,
    };
    coding.ok_or_else(|| format!("expected png, or jpeg:QUALITY from 1 to 100, found {text:?}"))
}

fn effects(text: &str) -> Result<EffectChoice, String> {
    let kind = |name: &str| {
        EffectKind::ALL.into_iter().find(|kind| kind.name() == name).ok_or_else(|| {
            let names: Vec<&str> = EffectKind::ALL.into_iter().map(EffectKind::name).collect();
            format!("expected auto, all, none, or a list of {}, found {name:?}", names.join(", "))
        })
    };
    match text {
        "auto" => Ok(EffectChoice::Auto),
        "all" => Ok(EffectChoice::All),
        "none" => Ok(EffectChoice::None),
        list => list.split(',').map(kind).collect::<Result<_, _>>().map(EffectChoice::Only),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_scene_ranges_codings_and_effects() {
        assert_eq!(numbers("8"), Ok(0..8));
        assert_eq!(numbers("16..24"), Ok(16..24));
        for broken in ["0", "", "5..5", "7..3", "-1", "a..b", "1.."] {
            assert!(numbers(broken).is_err(), "{broken:?}");
        }
        assert_eq!(coding("jpeg:90"), Ok(PictureCoding::Jpeg(90)));
        for broken in ["jpeg", "jpeg:0", "jpeg:101", "webp", "png:1"] {
            assert!(coding(broken).is_err(), "{broken:?}");
        }
        let only = EffectChoice::Only(vec![EffectKind::MotionBlur, EffectKind::SoftShadows]);
        assert_eq!(effects("motion-blur,soft-shadows"), Ok(only));
        let message = effects("fog").unwrap_err();
        assert!(message.contains("sensor-noise") && message.contains("\"fog\""), "{message}");
    }
}
