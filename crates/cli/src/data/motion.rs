//! `atsplat data motion`: compares the camera motion of simulated and real clips.

use std::fmt;
use std::path::PathBuf;

use anyhow::ensure;
use atsplat_numeric::counted;
use atsplat_report::plot::{HistogramPanel, Histograms};
use atsplat_rooms::motion_report::{ClipGroup, MOTION_MEASURES, MotionMeasure, MotionReport};
use atsplat_rooms::{SceneKind, Split};
use atsplat_scene::inspect::left_out;
use atsplat_scene::{SceneSource as _, WarningKind, Warnings};
use serde::Serialize;

use super::simulate::{kinds, splits};
use crate::overwrite::WatchedPhotos;
use crate::plot::PlotFile;
use crate::print::{note, print_report};
use crate::progress::Progress;
use crate::warnings::print_warnings;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Datasets; by default the eleven RE10K clips whose statistics the simulator draws from.
    #[arg(value_name = "PATH")]
    data: Vec<PathBuf>,

    /// Number of simulated clips to compare with.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=100_000))]
    simulated: u32,

    /// Kind of the simulated scenes.
    #[arg(long, value_name = "KIND", default_value = "rooms", requires = "simulated", value_parser = kinds())]
    kind: SceneKind,

    /// Split of the simulated scenes.
    #[arg(long, value_name = "SPLIT", default_value = "train", requires = "simulated", value_parser = splits())]
    split: Split,

    /// Histograms of every measure, .svg or .png.
    #[arg(long, value_name = "IMAGE", value_parser = PlotFile::parser())]
    plot: Option<PlotFile>,

    /// Print JSON, every clip with its numbers.
    #[arg(long)]
    json: bool,
}

/// What is printed: the motion, and the scenes of each dataset that are not in it.
#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report {
    #[serde(flatten)]
    motion: MotionReport,
    not_read: Vec<NotRead>,
}

/// Scenes of a dataset without motion; those that are too short are counted with its clips.
#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct NotRead {
    group: String,
    unreadable: u64,
    left_out: u64,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let mut warnings = Warnings::new();
    let measured = measure(args, &mut warnings);
    // Also if nothing was measured: they tell why.
    print_warnings(&warnings);
    let Report { motion: MotionReport { groups, .. }, not_read } = measured?;
    for ClipGroup { name, too_short, without_times, .. } in &groups {
        if *too_short > 0 {
            note(&format!(
                "{name}: skipped {} of less than half a second, or of more than a million",
                counted(*too_short as u64, "clip")
            ));
        }
        if *without_times > 0 {
            note(&format!(
                "{name}: {} without timestamps: speeds and turn rates are not known, and frames count as 30 per second",
                counted(*without_times as u64, "clip")
            ));
        }
    }
    let is_read = |group: &ClipGroup| !group.clips.is_empty() || group.too_short > 0;
    let of_data = groups.iter().skip(groups.len() - not_read.len());
    let names: Vec<String> = args.data.iter().map(|path| path.display().to_string()).collect();
    ensure!(args.data.is_empty() || of_data.into_iter().any(is_read), "no scene of {} can be read", names.join(", "));
    let all_read = not_read.iter().all(|group| group.unreadable == 0 && group.left_out == 0);
    Ok(all_read && groups.iter().all(|group| group.too_short == 0))
}

/// Measures and prints; in the report, the groups of the datasets are the last ones.
fn measure(args: &Args, warnings: &mut Warnings) -> anyhow::Result<Report> {
    let plot = args.plot.as_ref().map(PlotFile::open).transpose()?;
    let (mut groups, mut not_read) = (Vec::new(), Vec::new());
    if args.simulated > 0 {
        let progress = Progress::new("clips", args.simulated as usize);
        groups.push(ClipGroup::simulated(args.kind, args.split, args.simulated, &|| progress.step())?);
    }
    for path in &args.data {
        let mut found = Warnings::new();
        let dataset = atsplat_scene::open(path, &mut found)?;
        let opening = found.clone();
        let group = atsplat_files::name_of(path);
        let progress = Progress::new("scenes", dataset.keys().len());
        let watched = WatchedPhotos::new(&dataset, args.plot.as_ref().map(PlotFile::path));
        groups.push(ClipGroup::of_dataset(group.clone(), &watched, &mut found, &|| progress.step()));
        watched.check()?;
        let [all, before] = [&found, &opening].map(|warnings| warnings.count(WarningKind::UnreadableScene));
        let left_out = left_out(&opening, &found);
        not_read.push(NotRead { group, unreadable: all - before, left_out });
        warnings.merge(found.about_cameras());
    }
    if args.data.is_empty() {
        groups.push(ClipGroup::re10k()?);
    }
    let report = Report { motion: MotionReport::new(groups), not_read };
    if let Some(plot) = plot {
        plot.finish(|format| histograms(&report.motion.groups).draw().encode(format))?;
    }
    print_report(&report, args.json)?;
    Ok(report)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.motion)?;
        for NotRead { group, unreadable, left_out } in &self.not_read {
            for (count, what) in [(*unreadable, "could not be read"), (*left_out, "left out")] {
                if count > 0 {
                    writeln!(f, "{group}: {} {what}", counted(count, "scene"))?;
                }
            }
        }
        Ok(())
    }
}

fn histograms(groups: &[ClipGroup]) -> Histograms {
    let panel = |(measure, read): MotionMeasure| HistogramPanel {
        measure: measure.to_owned(),
        values: groups.iter().map(|group| group.clips.iter().filter_map(read).collect()).collect(),
    };
    let counts: Vec<String> =
        groups.iter().map(|group| format!("{} clips of {}", group.clips.len(), group.name)).collect();
    Histograms {
        title: "Camera motion".to_owned(),
        subtitle: format!(
            "{}; heights: share of a group's clips; groups of fewer than 20: a dot for each clip; lengths in each clip's own \
             units, metres if simulated",
            counts.join(", ")
        ),
        groups: groups.iter().map(|group| group.name.clone()).collect(),
        panels: MOTION_MEASURES.map(panel).into(),
    }
}
