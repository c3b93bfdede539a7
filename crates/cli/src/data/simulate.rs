//! `atsplat data simulate`: writes scenes simulated from seeds as a dataset.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use atsplat_camera::ImageSize;
use atsplat_files::FolderLock;
use atsplat_numeric::counted;
use atsplat_report::plot::{EffectCostRow, EffectCosts};
use atsplat_rooms::{
    CostSummary, EffectChoice, EffectKind, EffectMillis, FrameCosts, ImageEncoding, Layout, ManifestScene, Request,
    Route, SceneKind, SceneSeed, Simulation, Split, WriteOptions, write_dataset,
};
use atsplat_scene::{AmbiguousScene, Scene, SceneSource as _, Warnings, scene_key};
use clap::builder::TypedValueParser;
use serde::{Deserialize, Serialize};

use crate::output_lock::OutputLock;
use crate::parse::{self, usage_error};
use crate::paths::PendingFile;
use crate::plot::PlotFile;
use crate::print::{note, print_report, warn};
use crate::progress::Progress;
use crate::warnings::print_warnings;

/// Lists the scenes of a simulation until it has ended: a dataset with it is incomplete.
pub(super) const PLAN: &str = "planned.json";

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for the dataset; it must be new or empty.
    out: PathBuf,

    /// rooms: one or two connected rooms, filmed as in RE10K. yards: courtyards and halls, as in DL3DV.
    #[arg(long, value_name = "KIND", default_value = "rooms", value_parser = kinds())]
    kind: SceneKind,

    /// Split of the scenes; no scene is in both.
    #[arg(long, value_name = "SPLIT", default_value = "test", value_parser = splits())]
    split: Split,

    /// Number or range of scenes, such as 8 or 16..24.
    #[arg(long, value_name = "N|A..B", default_value = "8", value_parser = numbers)]
    scenes: Range<u32>,

    /// Frames per scene; by default 150 for rooms and 100 for yards.
    #[arg(long, value_name = "N", value_parser = parse::frames, conflicts_with = "route")]
    frames: Option<usize>,

    /// Image size; by default that of the dataset that the layout belongs to: 640x360 for re10k and chunks,
    /// 480x270 for nerfstudio.
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<ImageSize>,

    /// Rays per pixel.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=256))]
    samples: u32,

    /// auto (the effects that can change a scene's images), all, none, or a list such as soft-shadows,motion-blur. How strong an
    /// effect is in a scene is drawn from its seed, and may be 0. Where --layout stores no lens, auto leaves lens-distortion out.
    #[arg(long, value_name = "auto|all|none|LIST", default_value = "auto")]
    effects: EffectChoice,

    /// Follow the cameras of this dataset, from a place with enough room. If their aspect ratio is known and differs from that
    /// of --size, they show more or less at the sides.
    #[arg(long, value_name = "DATA")]
    route: Option<PathBuf>,

    /// Which scene of the route's dataset, if it contains several.
    #[arg(long, value_name = "KEY", requires = "route", conflicts_with = "frames")]
    route_key: Option<String>,

    /// Format of the dataset; only nerfstudio stores lens distortion.
    #[arg(long, value_name = "LAYOUT", default_value = "re10k", value_parser = parse::named(Layout::ALL.map(|layout| (layout.name(), layout))))]
    layout: Layout,

    /// Image format: png, or jpeg with its quality, such as jpeg:90.
    #[arg(long, value_name = "ENCODING", default_value = "png")]
    images: ImageEncoding,

    /// Also write depth: `depth/<scene>/<frame>.exr`, channel Z, in scene units along the camera's z axis.
    #[arg(long)]
    depth: bool,

    /// Measure in each scene's middle frame what each effect costs, and how much auto saves and changes compared with
    /// all.
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

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    args.check_lens()?;
    let _lock = lock_empty(&args.out)?;
    let plot = args.plot.as_ref().map(PlotFile::open).transpose()?;
    let mut warnings = Warnings::new();
    let requests = args.requests(&mut warnings)?;
    let plan = Plan::write(&args.out, &requests)?;
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
    let options = WriteOptions { layout: args.layout, encoding: args.images, depth: args.depth };
    let written = write_dataset(&args.out, requests, &options, &mut warnings, record);
    drop(progress);
    if written.is_ok() || OutputLock::is_alone(&args.out, &[PLAN]).unwrap_or(false) {
        plan.remove()?;
    }
    written?;
    if let Some(error) = failed {
        return Err(error);
    }
    let report = Report { folder: args.out.clone(), scenes: records };
    if let Some((plot, costs)) = plot.zip(report.costs()) {
        plot.finish(|format| args.plot(costs).draw().encode(format))?;
    }
    print_report(&report, args.json)?;
    print_warnings(&warnings);
    args.report_absent(&report);
    Ok(())
}

impl Args {
    /// Rejects a lens that the layout cannot store.
    fn check_lens(&self) -> Result<(), clap::Error> {
        if self.layout.stores_lenses() || !self.effects.requests(EffectKind::LensDistortion) {
            return Ok(());
        }
        Err(usage_error(format!(
            "--effects {}: lens-distortion requires a layout that stores it: --layout nerfstudio (found --layout {})",
            self.effects,
            self.layout.name()
        )))
    }

    /// Says in how many scenes which effects are missing that the scenes need, or that were requested by name.
    fn report_absent(&self, report: &Report) {
        let scenes = report.scenes.len();
        let absent = |effect: EffectKind| {
            let is_absent =
                |record: &&SceneRecord| record.scene.absent_effects.iter().any(|absent| absent.effect == effect);
            report.scenes.iter().filter(is_absent).count()
        };
        match &self.effects {
            EffectChoice::Auto => {
                let count = absent(EffectKind::LensDistortion);
                if count > 0 {
                    note(&format!(
                        "lens distortion is left out in {count} of {scenes} scenes: --layout {} stores none, --layout nerfstudio does",
                        self.layout.name()
                    ));
                }
            }
            EffectChoice::Only(kinds) => {
                for (kind, count) in kinds.iter().map(|kind| (kind, absent(*kind))).filter(|(_, count)| *count > 0) {
                    warn(&format!("--effects {}: {count} of {scenes} scenes have none that can be seen", kind.name()));
                }
            }
            EffectChoice::All | EffectChoice::None => {}
        }
    }

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
        self.size.unwrap_or_else(|| self.layout.native_size())
    }

    fn route(&self, warnings: &mut Warnings) -> anyhow::Result<Route> {
        let Some(path) = &self.route else { return Ok(Route::Natural) };
        let dataset = atsplat_scene::open(path, warnings)?;
        let key = scene_key(&dataset, self.route_key.as_deref());
        let key = key.map_err(|error| AmbiguousScene { option: "--route-key", ..error })?;
        let scene = dataset.load(key, warnings)?;
        if !scene.has_times(dataset.times()) {
            let (path, key) = (path.display(), &scene.key);
            note(&format!("{path}: scene {key} has no timestamps, assumed to have 30 frames per second"));
        }
        if let Some(message) = stretched(&scene, self.size()) {
            warn(&format!("{}: scene {}: {message}", path.display(), scene.key));
        }
        Ok(Route::of_scene(&scene, dataset.times(), self.size()))
    }

    fn costs_of(&self, simulation: &Simulation) -> anyhow::Result<Option<FrameCosts>> {
        let costs = self.costs.then(|| simulation.costs(simulation.shots().len() / 2));
        Ok(costs.transpose()?)
    }
}

/// The warning for a route whose pixels are not square in images of `size`. Where the size of its own images is known, pixels
/// keep their shape.
fn stretched(scene: &Scene, size: ImageSize) -> Option<String> {
    let unknown = scene.frames.iter().filter(|frame| frame.has_pose() && frame.stated_size.is_none());
    let mut intrinsics = unknown.map(|frame| frame.camera.intrinsics.pixel_from_normalized(size));
    let k = intrinsics.find(|k| (k.fx / k.fy - 1.0).abs() > 0.01)?;
    Some(format!(
        "pixels are not square: focal lengths at {size} are {:.1} and {:.1} pixels; choose --size with the aspect ratio of the \
         route's images",
        k.fx, k.fy
    ))
}

/// Creates and locks the folder, and rejects one that is not empty: files of an earlier dataset would mix with the new ones.
fn lock_empty(folder: &Path) -> anyhow::Result<OutputLock> {
    if folder.is_file() {
        bail!("expected a folder, found the file {}", folder.display());
    }
    // A folder that another process writes to is reported as such.
    if folder.is_dir() && !FolderLock::was_taken(folder) {
        check_empty(folder)?;
    }
    let lock = OutputLock::of(folder)?;
    // Now that no other process writes to it.
    check_empty(folder)?;
    Ok(lock)
}

fn check_empty(folder: &Path) -> anyhow::Result<()> {
    let shown = folder.display();
    let is_empty = OutputLock::is_alone(folder, &[PLAN]).with_context(|| format!("reading {shown}"))?;
    match Plan::left_in(folder) {
        _ if is_empty => Ok(()),
        Some(Plan { scenes, .. }) => bail!(
            "{shown} is not empty: a simulation of {} scenes into it did not end ({PLAN} lists them); remove the folder and \
             simulate again, or choose another",
            scenes.len()
        ),
        None => bail!("{shown} is not empty; choose a new or empty folder, or remove this one first"),
    }
}

/// The scenes of a simulation that has not ended; the file is removed when the dataset is complete.
#[derive(Debug, Serialize, Deserialize)]
struct Plan {
    scenes: Vec<String>,
    #[serde(skip)]
    file: PathBuf,
}

impl Plan {
    fn write(folder: &Path, requests: &[Request]) -> anyhow::Result<Self> {
        let file = folder.join(PLAN);
        let plan = Self { scenes: requests.iter().map(|request| request.seed.key(request.kind)).collect(), file };
        let text = serde_json::to_string_pretty(&plan)?;
        PendingFile::open(&plan.file)?.finish(format!("{text}\n").as_bytes())?;
        Ok(plan)
    }

    /// The plan that a simulation left in a folder.
    fn left_in(folder: &Path) -> Option<Self> {
        serde_json::from_slice(&std::fs::read(folder.join(PLAN)).ok()?).ok()
    }

    fn remove(self) -> anyhow::Result<()> {
        std::fs::remove_file(&self.file).with_context(|| format!("removing {}", self.file.display()))
    }
}

impl Report {
    fn costs(&self) -> Option<CostSummary> {
        CostSummary::of(&self.scenes.iter().filter_map(|record| record.costs.as_ref()).collect::<Vec<_>>())
    }
}

impl Args {
    /// The median and the quartiles of each effect's costs over the scenes that need it.
    fn plot(&self, CostSummary { scenes, effects, frame_secs, against_all }: CostSummary) -> EffectCosts {
        let frame = frame_secs.map(|secs| format!("; a frame takes {:.0} ms, median", secs * 1e3)).unwrap_or_default();
        let ImageSize { width, height } = self.size();
        let row = |EffectMillis { effect, needed_by, millis }| EffectCostRow {
            effect: effect.to_string(),
            needed_by,
            scenes,
            millis,
        };
        EffectCosts {
            title: "What each effect costs in simulated frames, and how many scenes need it".to_owned(),
            subtitle: format!("{scenes} {}, {width}×{height}, {} rays a pixel{frame}", self.kind, self.samples),
            rows: effects.into_iter().map(row).collect(),
            note: format!("Bars: medians over scenes; lines: quartiles; {against_all}."),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for SceneRecord { description, costs, .. } in &self.scenes {
            f.write_str(description)?;
            costs.iter().try_for_each(|costs| write!(f, "{costs}"))?;
        }
        if let Some(costs) = self.costs() {
            costs.fmt(f)?;
        }
        let frames: usize = self.scenes.iter().map(|record| record.scene.frames).sum();
        let (scenes, frames) = (counted(self.scenes.len() as u64, "scene"), counted(frames as u64, "frame"));
        writeln!(f, "{scenes}, {frames}, in {}", self.folder.display())
    }
}

/// A kind of scenes by its name.
pub(super) fn kinds() -> impl TypedValueParser<Value = SceneKind> {
    parse::named(SceneKind::ALL.map(|kind| (kind.name(), kind)))
}

/// A split of scenes by its name.
pub(super) fn splits() -> impl TypedValueParser<Value = Split> {
    parse::named(Split::ALL.map(|split| (split.name(), split)))
}

/// A size of images that can be simulated.
fn size(text: &str) -> Result<ImageSize, String> {
    let size = text.parse().ok().filter(|size: &ImageSize| size.width.max(size.height) <= Request::MAX_SIDE);
    size.ok_or_else(|| format!("expected WxH, such as 640x360, each from 1 to {}, found {text:?}", Request::MAX_SIDE))
}

fn numbers(text: &str) -> Result<Range<u32>, String> {
    let number = |text: &str| text.parse::<u32>().ok();
    let range = match text.split_once("..") {
        Some((first, past)) => number(first).zip(number(past)).map(|(first, past)| first..past),
        None => number(text).map(|count| 0..count),
    };
    let message = || format!("expected a number of scenes, or a range such as 16..24, found {text:?}");
    range.filter(|range| !range.is_empty()).ok_or_else(message)
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics};
    use atsplat_scene::{Frame, FrameImage};

    use super::*;

    #[test]
    fn a_route_of_unknown_size_whose_pixels_become_oblong_is_warned_of() {
        let intrinsics = NormalizedIntrinsics::new(0.48, 0.86, 0.5, 0.5).unwrap();
        let scene = |stated_size| {
            let camera = Camera::pinhole(CameraFromWorld::IDENTITY, intrinsics);
            let (name, image) = ("0".to_owned(), FrameImage::Absent);
            let frame = Frame { name, timestamp_micros: None, camera, stated_size, image };
            Scene { key: "route".to_owned(), url: None, frames: vec![frame] }
        };
        let [wide, square] = [(640, 360), (256, 256)].map(|(width, height)| ImageSize { width, height });
        assert_eq!(stretched(&scene(None), wide), None);
        assert_eq!(stretched(&scene(Some(wide)), square), None);
        let message = stretched(&scene(None), square).unwrap();
        assert!(message.contains("focal lengths at 256×256 are 122.9 and 220.2 pixels"), "{message}");
    }

    #[test]
    fn the_help_states_the_defaults_of_kinds_and_layouts() {
        let command = <Args as clap::Args>::augment_args(clap::Command::new("simulate"));
        let help = |option: &str| {
            let argument = command.get_arguments().find(|argument| argument.get_id() == option).unwrap();
            argument.get_help().unwrap().to_string()
        };
        for kind in SceneKind::ALL {
            let frames = Request::new(kind, SceneSeed { split: Split::Test, number: 0 }).frames;
            assert!(help("frames").contains(&format!("{frames} for {kind}")), "{}", help("frames"));
            assert!(help("kind").contains(&format!("{kind}: ")), "{}", help("kind"));
        }
        for layout in Layout::ALL {
            let (size, name) = (layout.native_size(), layout.name());
            let sizes = help("size");
            let of_layout = sizes.split([':', ',']).find(|part| part.contains(name)).unwrap();
            assert!(of_layout.contains(&format!("{}x{} for ", size.width, size.height)), "{name}: {sizes}");
            assert_eq!(help("layout").contains(name), layout.stores_lenses(), "{name}");
        }
    }

    #[test]
    fn sizes_that_cannot_be_simulated_are_usage_errors() {
        assert_eq!(size("16384x2"), Ok(ImageSize { width: 16384, height: 2 }));
        for broken in ["16385x2", "2x20000", "0x2", "640", "70000x2"] {
            let message = size(broken).unwrap_err();
            assert!(message.contains("each from 1 to 16384") && message.contains(broken), "{message}");
        }
    }

    #[test]
    fn parses_scene_ranges() {
        assert_eq!(numbers("8"), Ok(0..8));
        assert_eq!(numbers("16..24"), Ok(16..24));
        for broken in ["0", "", "5..5", "7..3", "-1", "a..b", "1.."] {
            assert!(numbers(broken).is_err(), "{broken:?}");
        }
    }
}
