//! `atsplat data motion`: camera motion of clips, simulated next to real.

use std::fmt;
use std::path::{Path, PathBuf};

use atsplat_camera::ImageSize;
use atsplat_numeric::quantile;
use atsplat_report::plot::{HistogramPanel, Histograms};
use atsplat_rooms::{ClipMotion, EffectChoice, Request, RoomsError, SceneSeed, Simulation};
use atsplat_scene::{Scene, SceneSource as _, WarningKind, Warnings};
use rayon::prelude::*;
use serde::Serialize;

use super::simulate::{KindArg, SplitArg};
use crate::output::{print_report, print_warnings, warn};
use crate::plot::PlotFile;
use crate::progress::Progress;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Datasets; by default the eleven RE10K clips whose statistics the simulator draws from.
    #[arg(value_name = "PATH")]
    data: Vec<PathBuf>,

    /// Number of simulated clips to compare with.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=100_000))]
    simulated: u32,

    /// Kind of the simulated scenes.
    #[arg(long, value_name = "KIND", default_value = "rooms")]
    kind: KindArg,

    /// Split of the simulated scenes.
    #[arg(long, value_name = "SPLIT", default_value = "train")]
    split: SplitArg,

    /// Histograms of every measure, .svg or .png.
    #[arg(long, value_name = "PICTURE", value_parser = PlotFile::parser())]
    plot: Option<PlotFile>,

    /// Print JSON, every clip with its numbers.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report {
    groups: Vec<Group>,
    quantiles: Vec<Row>,
}

/// Clips of one source.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Group {
    name: String,
    clips: Vec<ClipMotion>,
    /// Number of skipped clips of less than half a second.
    too_short: usize,
    /// Number of clips without timestamps, assumed to have 30 frames per second.
    without_times: usize,
}

/// Quantiles of one measure over the clips of one group.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Row {
    measure: &'static str,
    group: String,
    measured: usize,
    quantiles: [Option<f64>; QUANTILES.len()],
}

const QUANTILES: [f64; 5] = [0.1, 0.25, 0.5, 0.75, 0.9];
/// Image size of RE10K, so that focal lengths relative to the width are comparable.
const SIZE: ImageSize = ImageSize { width: 640, height: 360 };

/// Name and value of a measure.
type Measure = (&'static str, fn(&ClipMotion) -> Option<f64>);

const MEASURES: [Measure; 8] = [
    ("speed, units/s", |clip| Some(clip.speed)),
    ("turn rate, °/s", |clip| Some(clip.turn_degrees_per_second)),
    ("straightness", |clip| clip.straightness),
    ("travel to axis, °", |clip| clip.travel_to_axis_degrees),
    ("baseline, 45 frames", |clip| clip.baseline_45),
    ("baseline, 90 frames", |clip| clip.baseline_90),
    ("baseline, 135 frames", |clip| clip.baseline_135),
    ("focal length / width", |clip| Some(clip.fx)),
];

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let plot = args.plot.as_ref().map(PlotFile::open).transpose()?;
    let mut warnings = Warnings::new();
    let mut groups = Vec::new();
    if args.simulated > 0 {
        groups.push(args.simulate()?);
    }
    for path in &args.data {
        let mut found = Warnings::new();
        groups.push(Group::of_dataset(path, &mut found)?);
        warnings.merge(found.about_cameras());
    }
    if args.data.is_empty() {
        groups.push(Group { name: "RE10K".to_owned(), clips: ClipMotion::real()?, too_short: 0, without_times: 0 });
    }
    let report = Report { quantiles: rows(&groups), groups };
    if let Some(plot) = plot {
        plot.finish(|format| histograms(&report.groups).draw().encode(format))?;
    }
    print_report(&report, args.json)?;
    print_warnings(&warnings);
    for Group { name, too_short, without_times, .. } in &report.groups {
        if *too_short > 0 {
            warn(&format!("note: {name}: {too_short} clips of less than half a second are skipped"));
        }
        if *without_times > 0 {
            warn(&format!(
                "note: {name}: {without_times} clips without timestamps, assumed to have 30 frames per second"
            ));
        }
    }
    let unread = warnings.counts().any(|(kind, _)| kind == WarningKind::UnreadableScene);
    Ok(!unread && report.groups.iter().all(|group| group.too_short == 0))
}

impl Args {
    /// Simulates trajectories without rendering.
    fn simulate(&self) -> anyhow::Result<Group> {
        let progress = Progress::new("clips", self.simulated as usize);
        let clip = |number| {
            let request = Request::new(self.kind.into(), SceneSeed { split: self.split.into(), number });
            let simulation = Simulation::new(Request { size: SIZE, effects: EffectChoice::None, ..request })?;
            progress.step();
            Ok(ClipMotion::of_shots(&simulation.key(), simulation.shots()))
        };
        let clips = (0..self.simulated).into_par_iter().map(clip).collect::<Result<Vec<_>, RoomsError>>()?;
        let name = format!("simulated {}", atsplat_rooms::SceneKind::from(self.kind));
        Ok(Group::new(name, clips, 0))
    }
}

impl Group {
    fn new(name: String, clips: Vec<Option<ClipMotion>>, without_times: usize) -> Self {
        let too_short = clips.iter().filter(|clip| clip.is_none()).count();
        Self { name, clips: clips.into_iter().flatten().collect(), too_short, without_times }
    }

    fn of_dataset(path: &Path, warnings: &mut Warnings) -> anyhow::Result<Self> {
        let dataset = atsplat_scene::open(path, warnings)?;
        let progress = Progress::new("scenes", dataset.keys().len());
        let read = dataset.keys().par_iter().map(|key| {
            let mut warnings = Warnings::new();
            let clip = dataset.load(key, &mut warnings).map(|scene| (motion_of(&scene), has_times(&scene)));
            progress.step();
            (key, clip, warnings)
        });
        let read: Vec<_> = read.collect();
        let (mut clips, mut without_times) = (Vec::new(), 0);
        for (key, clip, of_scene) in read {
            warnings.merge(of_scene);
            match clip {
                Ok((clip, has_times)) => {
                    clips.push(clip);
                    without_times += usize::from(!has_times);
                }
                Err(error) => warnings.push(WarningKind::UnreadableScene, key.as_str(), error.to_string()),
            }
        }
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        Ok(Self::new(name, clips, without_times))
    }
}

/// Whether the timestamps can be microseconds: captures number their frames consecutively.
fn has_times(scene: &Scene) -> bool {
    const MIN_STEP_MICROS: i64 = 1000;
    let times: Option<Vec<i64>> = scene.frames.iter().map(|frame| frame.timestamp_micros).collect();
    let Some(times) = times else { return false };
    let span = times.iter().max().zip(times.iter().min()).map_or(0, |(last, first)| last - first);
    (1i64..).zip(&times).last().is_none_or(|(count, _)| span >= MIN_STEP_MICROS * (count - 1))
}

fn motion_of(scene: &Scene) -> Option<ClipMotion> {
    let timed = has_times(scene);
    let cameras = scene.frames.iter().zip(0i64..).map(|(frame, at)| {
        let micros = frame.timestamp_micros.filter(|_| timed).unwrap_or(at * 1_000_000 / 30);
        (micros, frame.camera)
    });
    ClipMotion::of(&scene.key, cameras)
}

fn rows(groups: &[Group]) -> Vec<Row> {
    let row = |(measure, read): Measure, group: &Group| {
        let mut values: Vec<f64> = group.clips.iter().filter_map(read).collect();
        values.sort_by(f64::total_cmp);
        Row {
            measure,
            group: group.name.clone(),
            measured: values.len(),
            quantiles: QUANTILES.map(|share| quantile(&values, share)),
        }
    };
    MEASURES.iter().flat_map(|measure| groups.iter().map(|group| row(*measure, group))).collect()
}

fn histograms(groups: &[Group]) -> Histograms {
    let panel = |(measure, read): Measure| HistogramPanel {
        measure: measure.to_owned(),
        values: groups.iter().map(|group| group.clips.iter().filter_map(read).collect()).collect(),
    };
    Histograms {
        title: "Camera motion".to_owned(),
        subtitle: "height: share of a group's clips; marks: single clips; lengths in each clip's own units, metres if \
                   simulated"
            .to_owned(),
        groups: groups.iter().map(|group| group.name.clone()).collect(),
        panels: MEASURES.map(panel).into(),
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.groups.iter().map(|group| group.name.chars().count()).fold(5, usize::max);
        write!(f, "{:<21} {:<width$} {:>5}", "", "", "clips")?;
        QUANTILES.iter().try_for_each(|share| write!(f, " {:>8}", format!("{:.0} %", share * 100.0)))?;
        writeln!(f)?;
        for Row { measure, group, measured, quantiles } in &self.quantiles {
            write!(f, "{measure:<21} {group:<width$} {measured:>5}")?;
            for value in quantiles {
                write!(f, " {:>8}", value.map_or("-".to_owned(), |value| format!("{value:.3}")))?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
