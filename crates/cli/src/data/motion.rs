//! `atsplat data motion`: how the cameras of clips move, simulated ones beside real ones.

use std::fmt;
use std::path::{Path, PathBuf};

use atsplat_camera::ImageSize;
use atsplat_numeric::quantile;
use atsplat_report::plot::{HistogramPanel, Histograms};
use atsplat_rooms::{ClipMotion, EffectChoice, Request, RoomsError, SceneSeed, Simulation};
use atsplat_scene::{Scene, SceneSource as _, WarningKind, Warnings};
use clap::Args;
use rayon::prelude::*;
use serde::Serialize;

use super::simulate::{KindWord, SplitWord};
use crate::output::{PendingFile, complain, print_report, print_warnings};
use crate::plot::PlotFile;
use crate::progress::Progress;

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// Datasets; without any, the eleven RE10K clips whose figures the simulator draws from.
    #[arg(value_name = "PATH")]
    data: Vec<PathBuf>,

    /// How many simulated clips to show beside them.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=100_000))]
    simulated: u32,

    /// What kind of scenes these clips show.
    #[arg(long, value_name = "KIND", default_value = "rooms")]
    kind: KindWord,

    /// What they are for.
    #[arg(long, value_name = "SPLIT", default_value = "train")]
    split: SplitWord,

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

/// Clips of one origin.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Group {
    name: String,
    clips: Vec<ClipMotion>,
    /// Clips of less than half a second, which have no motion to speak of.
    too_short: usize,
    /// Clips whose frames have no times, taken as films of 30 frames a second.
    without_times: usize,
}

/// One measure of one group: the values at [`SHARES`] of its clips.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Row {
    measure: &'static str,
    group: String,
    measured: usize,
    quantiles: [Option<f64>; SHARES.len()],
}

const SHARES: [f64; 5] = [0.1, 0.25, 0.5, 0.75, 0.9];
/// RE10K's shape, by which focal lengths over the width compare.
const SIZE: ImageSize = ImageSize { width: 640, height: 360 };

/// A measure's name and how a clip answers.
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

pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    let plot = match &words.plot {
        Some(plot) => Some((PendingFile::open(&plot.path)?, plot.format)),
        None => None,
    };
    let mut warnings = Warnings::new();
    let mut groups = Vec::new();
    if words.simulated > 0 {
        groups.push(words.simulate()?);
    }
    for path in &words.data {
        let mut found = Warnings::new();
        groups.push(Group::of_dataset(path, &mut found)?);
        warnings.merge(found.about_cameras());
    }
    if words.data.is_empty() {
        groups.push(Group { name: "RE10K".to_owned(), clips: ClipMotion::real()?, too_short: 0, without_times: 0 });
    }
    let report = Report { quantiles: rows(&groups), groups };
    if let Some((file, format)) = plot {
        file.finish(&histograms(&report.groups).draw().encode(format)?)?;
    }
    print_report(&report, words.json)?;
    print_warnings(&warnings);
    for Group { name, too_short, without_times, .. } in &report.groups {
        if *too_short > 0 {
            complain(&format!("note: {name}: {too_short} clips of less than half a second are left out"));
        }
        if *without_times > 0 {
            complain(&format!("note: {name}: {without_times} clips without times, taken as 30 frames a second"));
        }
    }
    let unread = warnings.counts().any(|(kind, _)| kind == WarningKind::UnreadableScene);
    Ok(!unread && report.groups.iter().all(|group| group.too_short == 0))
}

impl Words {
    /// Trajectories alone: nothing is rendered, so the least that a scene can be asked for will do.
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
            let clip = dataset.load(key, &mut warnings).map(|scene| (motion(&scene), has_times(&scene)));
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

/// Whether the frames' numbers can be microseconds: captures are numbered one by one.
fn has_times(scene: &Scene) -> bool {
    const LEAST_STEP: i64 = 1000;
    let times: Option<Vec<i64>> = scene.frames.iter().map(|frame| frame.timestamp_micros).collect();
    let Some(times) = times else { return false };
    let span = times.iter().max().zip(times.iter().min()).map_or(0, |(last, first)| last - first);
    (1i64..).zip(&times).last().is_none_or(|(count, _)| span >= LEAST_STEP * (count - 1))
}

fn motion(scene: &Scene) -> Option<ClipMotion> {
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
            quantiles: SHARES.map(|share| quantile(&values, share)),
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
        title: "How cameras move".to_owned(),
        subtitle:
            "height: share of a group's clips; marks: single clips; lengths in each clip's own units, metres where \
                   simulated"
                .to_owned(),
        groups: groups.iter().map(|group| group.name.clone()).collect(),
        panels: MEASURES.map(panel).into(),
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let wide = self.groups.iter().map(|group| group.name.chars().count()).fold(5, usize::max);
        write!(f, "{:<21} {:<wide$} {:>5}", "", "", "clips")?;
        SHARES.iter().try_for_each(|share| write!(f, " {:>8}", format!("{:.0} %", share * 100.0)))?;
        writeln!(f)?;
        for Row { measure, group, measured, quantiles } in &self.quantiles {
            write!(f, "{measure:<21} {group:<wide$} {measured:>5}")?;
            for value in quantiles {
                write!(f, " {:>8}", value.map_or("-".to_owned(), |value| format!("{value:.3}")))?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
