//! `atsplat data motion`: compares the camera motion of simulated and real clips.

use std::path::PathBuf;

use atsplat_report::plot::{HistogramPanel, Histograms};
use atsplat_rooms::motion_report::{ClipGroup, MOTION_MEASURES, MotionMeasure, MotionReport};
use atsplat_rooms::{SceneKind, Split};
use atsplat_scene::{SceneSource as _, WarningKind, Warnings};

use super::simulate::{KINDS, SPLITS};
use crate::parse;
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
    #[arg(long, value_name = "KIND", default_value = "rooms", requires = "simulated", value_parser = parse::named(KINDS))]
    kind: SceneKind,

    /// Split of the simulated scenes.
    #[arg(long, value_name = "SPLIT", default_value = "train", requires = "simulated", value_parser = parse::named(SPLITS))]
    split: Split,

    /// Histograms of every measure, .svg or .png.
    #[arg(long, value_name = "IMAGE", value_parser = PlotFile::parser())]
    plot: Option<PlotFile>,

    /// Print JSON, every clip with its numbers.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let plot = args.plot.as_ref().map(PlotFile::open).transpose()?;
    let mut warnings = Warnings::new();
    let mut groups = Vec::new();
    if args.simulated > 0 {
        let progress = Progress::new("clips", args.simulated as usize);
        groups.push(ClipGroup::simulated(args.kind, args.split, args.simulated, &|| progress.step())?);
    }
    for path in &args.data {
        let mut found = Warnings::new();
        let dataset = atsplat_scene::open(path, &mut found)?;
        let name = atsplat_files::name_of(path);
        let progress = Progress::new("scenes", dataset.keys().len());
        groups.push(ClipGroup::of_dataset(name, &dataset, &mut found, &|| progress.step()));
        warnings.merge(found.about_cameras());
    }
    if args.data.is_empty() {
        groups.push(ClipGroup::re10k()?);
    }
    let report = MotionReport::new(groups);
    if let Some(plot) = plot {
        plot.finish(|format| histograms(&report.groups).draw().encode(format))?;
    }
    print_report(&report, args.json)?;
    print_warnings(&warnings);
    for ClipGroup { name, too_short, without_times, .. } in &report.groups {
        if *too_short > 0 {
            note(&format!("{name}: {too_short} clips of less than half a second are skipped"));
        }
        if *without_times > 0 {
            note(&format!("{name}: {without_times} clips without timestamps, assumed to have 30 frames per second"));
        }
    }
    let unread = warnings.counts().any(|(kind, _)| kind == WarningKind::UnreadableScene);
    Ok(!unread && report.groups.iter().all(|group| group.too_short == 0))
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
