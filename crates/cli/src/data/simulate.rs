//! `atsplat data simulate`: scenes from seeds, written as a dataset.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use atsplat_camera::ImageSize;
use atsplat_rooms::{
    EffectChoice, EffectKind, Layout, ManifestScene, PictureCoding, Request, Route, SceneKind, SceneSeed, Simulation,
    Split, WriteOptions, write_dataset,
};
use atsplat_scene::{SceneSource as _, Warnings};
use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::dataset_words::key_of;
use crate::output::{complain, print_report, print_warnings};
use crate::progress::Progress;
use crate::render::words;

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// Folder for the dataset; it must be new or empty.
    out: PathBuf,

    /// rooms: one or two connected rooms, filmed as RE10K is. yards: courtyards and halls, as DL3DV.
    #[arg(long, value_name = "KIND", default_value = "rooms")]
    kind: KindWord,

    /// What the scenes are for; no scene is in both.
    #[arg(long, value_name = "SPLIT", default_value = "test")]
    split: SplitWord,

    /// How many scenes, or which, as 8 or 16..24.
    #[arg(long, value_name = "N|A..B", default_value = "8", value_parser = numbers)]
    scenes: Range<u32>,

    /// Frames of each scene; by default 150 for rooms and 100 for yards.
    #[arg(long, value_name = "N", value_parser = words::frames, conflicts_with = "route")]
    frames: Option<usize>,

    /// Size of the pictures; by default that of the dataset that the layout belongs to: 640x360 for re10k and chunks,
    /// 480x270 for nerfstudio.
    #[arg(long, value_name = "WxH", value_parser = words::size)]
    size: Option<ImageSize>,

    /// Rays a pixel.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=256))]
    samples: u32,

    /// auto runs the effects that can change a scene's pictures; all; none; or a list, as soft-shadows,motion-blur.
    #[arg(long, value_name = "auto|all|none|LIST", default_value = "auto", value_parser = effects)]
    effects: EffectChoice,

    /// Follow this dataset's cameras from a place that has room for them.
    #[arg(long, value_name = "DATA")]
    route: Option<PathBuf>,

    /// Which scene of the route's dataset, where it holds several.
    #[arg(long, value_name = "KEY", requires = "route")]
    route_key: Option<String>,

    /// How the dataset lies on disk.
    #[arg(long, value_name = "LAYOUT", default_value = "re10k")]
    layout: LayoutWord,

    /// png, or jpeg with its quality, as jpeg:90.
    #[arg(long, value_name = "CODING", default_value = "png", value_parser = coding)]
    pictures: PictureCoding,

    /// Write depth too: `depth/<scene>/<frame>.exr`, channel Z, in scene units along the camera's z axis.
    #[arg(long)]
    depth: bool,

    /// Measure what each effect costs in a scene's middle frame.
    #[arg(long)]
    costs: bool,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum KindWord {
    Rooms,
    Yards,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum SplitWord {
    Train,
    Test,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum LayoutWord {
    Re10k,
    Chunks,
    Nerfstudio,
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
    /// The scene's size, its effects and why they run.
    #[serde(skip)]
    told: String,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    costs: Vec<CostRecord>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct CostRecord {
    effect: &'static str,
    secs_a_frame: f64,
}

/// Simulates; `true`, since nothing is skipped.
pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    refuse_full_folder(&words.out)?;
    let mut warnings = Warnings::new();
    let requests = words.requests(&mut warnings)?;
    let progress = Progress::new("scenes", requests.len());
    let mut records = Vec::new();
    let mut failed = None;
    let told = |simulation: &Simulation, scene: &ManifestScene| {
        match words.costs_of(simulation) {
            Ok(costs) => records.push(SceneRecord { scene: scene.clone(), told: simulation.to_string(), costs }),
            Err(error) => failed = Some(error),
        }
        progress.step();
    };
    write_dataset(&words.out, requests, &words.options(), &mut warnings, told)?;
    drop(progress);
    if let Some(error) = failed {
        return Err(error);
    }
    print_report(&Report { folder: words.out.clone(), scenes: records }, words.json)?;
    print_warnings(&warnings);
    if words.layout != LayoutWord::Nerfstudio && warnings.counts().next().is_some() {
        complain("note: --layout nerfstudio keeps lenses; --effects without lens-distortion makes none");
    }
    Ok(true)
}

impl Words {
    fn requests(&self, warnings: &mut Warnings) -> anyhow::Result<Vec<Request>> {
        let route = self.route(warnings)?;
        let request = |number| {
            let (kind, split) = (self.kind.into(), self.split.into());
            let plain = Request::new(kind, SceneSeed { split, number });
            Request {
                size: self.size.unwrap_or_else(|| self.layout.native_size()),
                samples: self.samples,
                effects: self.effects.clone(),
                frames: self.frames.unwrap_or(plain.frames),
                route: route.clone(),
                ..plain
            }
        };
        Ok(self.scenes.clone().map(request).collect())
    }

    fn route(&self, warnings: &mut Warnings) -> anyhow::Result<Route> {
        let Some(path) = &self.route else { return Ok(Route::Natural) };
        let dataset = atsplat_scene::open(path, warnings)?;
        let scene = dataset.load(key_of(&dataset, self.route_key.as_deref())?, warnings)?;
        // Datasets without times are taken as films of 30 frames a second.
        let cameras = scene.frames.iter().enumerate().map(|(at, frame)| {
            let micros = frame.timestamp_micros.unwrap_or(i64::try_from(at * 33_333).unwrap_or(i64::MAX));
            (micros, frame.camera)
        });
        Ok(Route::Given(cameras.collect()))
    }

    fn options(&self) -> WriteOptions {
        let layout = match self.layout {
            LayoutWord::Re10k => Layout::Re10k,
            LayoutWord::Chunks => Layout::Chunks,
            LayoutWord::Nerfstudio => Layout::Nerfstudio,
        };
        WriteOptions { layout, coding: self.pictures, depth: self.depth }
    }

    fn costs_of(&self, simulation: &Simulation) -> anyhow::Result<Vec<CostRecord>> {
        if !self.costs {
            return Ok(Vec::new());
        }
        let costs = simulation.effect_costs(simulation.shots().len() / 2)?;
        Ok(costs.iter().map(|cost| CostRecord { effect: cost.effect.name(), secs_a_frame: cost.secs }).collect())
    }
}

/// Files of an earlier dataset would stand among this one's.
fn refuse_full_folder(folder: &Path) -> anyhow::Result<()> {
    if folder.is_file() {
        bail!("{} is a file, expected a folder", folder.display());
    }
    if folder.is_dir() {
        let mut entries = folder.read_dir().with_context(|| format!("reading {}", folder.display()))?;
        if entries.next().is_some() {
            bail!("{} is not empty: a dataset is written into a new folder", folder.display());
        }
    }
    std::fs::create_dir_all(folder).with_context(|| format!("making the folder {}", folder.display()))
}

impl LayoutWord {
    /// What the papers' protocols expect of the dataset.
    const fn native_size(self) -> ImageSize {
        match self {
            Self::Re10k | Self::Chunks => ImageSize { width: 640, height: 360 },
            Self::Nerfstudio => ImageSize { width: 480, height: 270 },
        }
    }
}

impl From<KindWord> for SceneKind {
    fn from(word: KindWord) -> Self {
        match word {
            KindWord::Rooms => Self::Rooms,
            KindWord::Yards => Self::Yards,
        }
    }
}

impl From<SplitWord> for Split {
    fn from(word: SplitWord) -> Self {
        match word {
            SplitWord::Train => Self::Train,
            SplitWord::Test => Self::Test,
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for SceneRecord { told, costs, .. } in &self.scenes {
            f.write_str(told)?;
            for CostRecord { effect, secs_a_frame } in costs {
                writeln!(f, "    {effect}: {:+.1} ms a frame", secs_a_frame * 1e3)?;
            }
        }
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
    let told = || format!("expected a number of scenes, or a range as 16..24, found {text:?}");
    range.filter(|range| !range.is_empty()).ok_or_else(told)
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
            let known: Vec<&str> = EffectKind::ALL.into_iter().map(EffectKind::name).collect();
            format!("expected auto, all, none, or a list of {}, found {name:?}", known.join(", "))
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
    fn words_and_what_is_none() {
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
        let told = effects("fog").unwrap_err();
        assert!(told.contains("sensor-noise") && told.contains("\"fog\""), "{told}");
    }
}
