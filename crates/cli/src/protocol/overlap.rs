use std::path::PathBuf;

use anyhow::{bail, ensure};
use atsplat_numeric::counted;
use atsplat_protocol::overlap::{
    BinnedOverlaps, DepthFolder, OverlapEstimator, OverlapReport, UnmeasuredExample, annotate_overlaps,
};
use atsplat_protocol::{BinRule, EvaluationIndex, IndexFile, KnownIndex, OverlapBins};
use atsplat_report::plot::OverlapHistogram;
use atsplat_scene::Warnings;

use crate::dataset_args::ImageArgs;
use crate::objects::check_reading;
use crate::output_lock::OutputFiles;
use crate::overwrite::{Input, WatchedPhotos, check_output};
use crate::parse;
use crate::paths::PendingFile;
use crate::plot::PlotFile;
use crate::print::{note, print_report, warn};
use crate::requirements::{Requirement, check_all};
use crate::warnings::print_warnings;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Evaluation index (JSON). Without `--data`, its own overlaps are used.
    index: PathBuf,

    /// Dataset on whose cameras or images overlaps are measured.
    #[arg(long, value_name = "PATH")]
    data: Option<PathBuf>,

    #[command(flatten)]
    images: ImageArgs,

    /// Definition of overlap: epipolar-ray (only cameras), feature-coverage (images, feature `opencv`) or
    /// depth-covisibility (depth maps, `--depth`), which the index records as depth-covisibility-2x2.
    #[arg(
        long,
        value_name = "NAME",
        default_value = "epipolar-ray",
        requires = "data",
        value_parser = parse::estimator
    )]
    estimator: OverlapEstimator,

    /// Depth maps for depth-covisibility: one `<scene>/<frame name>.exr` per context frame, channel `Z`, the only channel or the
    /// only one stated to be depth, in scene units along the camera's z axis, through its lens. A map may have another scale than
    /// its frame, but not another shape. `<scene>` may be the output of `render --cameras --formats exr` for the same data.
    #[arg(long, value_name = "FOLDER", requires = "data", required_if_eq("estimator", "depth-covisibility"))]
    depth: Option<PathBuf>,

    /// Index file with overlaps to write.
    #[arg(long, short, value_name = "INDEX")]
    out: Option<PathBuf>,

    /// Histogram coloured by bin, .svg or .png.
    #[arg(long, value_name = "IMAGE", value_parser = PlotFile::parser())]
    plot: Option<PlotFile>,

    /// Bins as NAME:UPPER,… after the lowest edge; an overlap below that edge is in no bin. The published ones, the default
    /// (but see `--strict-bins`), are `0.05,small:0.3,medium:0.55,large:0.8`.
    #[arg(long, value_name = "BINS", value_parser = parse::bins)]
    bins: Option<OverlapBins>,

    /// Put overlaps below the lowest published edge in no bin, instead of the second one as NoPoSplat's code does.
    #[arg(long, conflicts_with = "bins")]
    strict_bins: bool,

    /// Use the published bins even if they belong to another estimator, which is then noted. Without it, and without
    /// `--bins`, such overlaps get their own bins with a third of the values in each.
    #[arg(long, conflicts_with = "bins")]
    force: bool,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let depth = depth(args)?;
    check_outputs(args)?;
    let file = IndexFile::read(&args.index)?;
    let _outputs = OutputFiles::of(args.out.as_deref().into_iter().chain(args.plot.as_ref().map(PlotFile::path)))?;
    let out = args.out.as_deref().map(PendingFile::open).transpose()?;
    let plot = args.plot.as_ref().map(PlotFile::open).transpose()?;
    let layout = file.layout;
    let name = match KnownIndex::by_sha256(&file.sha256) {
        Some(known) => known.name.to_owned(),
        None => args.index.file_stem().unwrap_or(args.index.as_os_str()).to_string_lossy().into_owned(),
    };
    let mut warnings = Warnings::new();
    if out.is_some() {
        file.warn_of_unknown_fields(&args.index, &mut warnings);
    }
    let mut index = file.into_unambiguous().map_err(|error| error.in_file(&args.index))?;
    let mut measured = None;
    if let Some(path) = &args.data {
        let estimator = &args.estimator;
        let dataset = args.images.open(path, &mut warnings)?;
        let watched = WatchedPhotos::new(&dataset, args.plot.as_ref().map(PlotFile::path));
        let found = annotate_overlaps(&index, &watched, estimator, depth.as_ref(), &mut warnings);
        watched.check()?;
        check_reading()?;
        index.clone_from(&found.index);
        measured = Some(found);
    } else if index.entries().all(|(.., entry)| entry.overlap.is_none()) {
        bail!("no entry of {} states an overlap: --data measures it", args.index.display());
    }
    let (bins, footer) = bins(args, &index);
    let report = BinnedOverlaps::new(&index, &bins, footer, measured.as_ref().map(|found| (found, &args.estimator)));
    let complete = report.unmeasured.is_empty();
    let nothing = report.measured == Some(0);
    if let Some(plot) = plot.filter(|_| !nothing) {
        let overlaps = bins.placed(&index);
        let subtitle =
            format!("index {name}; {}; {}", counted(overlaps.len() as u64, "context set"), report.definition);
        let title = "Overlap of the context views";
        let histogram = OverlapHistogram { title, subtitle: &subtitle, overlaps: &overlaps, bins: bins.names() };
        plot.finish(|format| histogram.draw().encode(format))?;
    }
    if let Some(out) = out.filter(|_| !nothing) {
        out.finish(index.to_json(&layout).as_bytes())?;
    }
    print_report(&report, args.json)?;
    print_warnings(&warnings);
    let why = || measured.as_ref().map_or_else(String::new, why_nothing);
    ensure!(!nothing, "no overlap of {} could be measured: {}", args.index.display(), why());
    Ok(complete)
}

/// The bins of the overlaps, with a caveat. Options about the published bins that change nothing are reported.
fn bins(args: &Args, index: &EvaluationIndex) -> (OverlapBins, Option<String>) {
    if let Some(bins) = &args.bins {
        return (bins.clone(), None);
    }
    let rule = if args.strict_bins { BinRule::Strict } else { BinRule::Published };
    let (bins, caveat) = OverlapBins::for_index(index, rule, args.force);
    let fit = caveat.is_none();
    if args.force && fit {
        note("--force has no effect: the published bins are for these overlaps");
    }
    if args.strict_bins && !fit && !args.force {
        warn("--strict-bins has no effect: it is about the published bins, which are not for these overlaps");
    }
    (bins, caveat)
}

/// Why no overlap was measured.
fn why_nothing(found: &OverlapReport) -> String {
    found.examples.first().map_or_else(
        || "no scene of the index has an entry".to_owned(),
        |UnmeasuredExample { scene, entry, reason, detail }| {
            let unmeasured: usize = found.unmeasured.values().sum();
            let failed = counted(unmeasured as u64, "entry");
            format!("{failed} failed, the first with {reason}: scene {scene:?}, entry {entry}: {detail}")
        },
    )
}

/// Rejects outputs that would overwrite inputs. A plot may be an image in the folder of the dataset.
fn check_outputs(args: &Args) -> anyhow::Result<()> {
    let index = Input::File("index", &args.index);
    if let Some(out) = &args.out {
        let folders = [&args.data, &args.depth].into_iter().flatten().map(|folder| Input::Dataset(folder));
        check_output("--out", out, &folders.chain([index]).collect::<Vec<_>>())?;
    }
    // Photos are known when their scenes are read.
    args.plot.as_ref().map_or(Ok(()), |plot| check_output("--plot", plot.path(), &[index]))
}

/// The folder of depth maps, if the estimator uses them.
fn depth(args: &Args) -> anyhow::Result<Option<DepthFolder>> {
    let estimator = &args.estimator;
    if matches!(estimator, OverlapEstimator::FeatureCoverage { measure: None }) {
        bail!("feature-coverage requires a build with `--features opencv`; see CONTRIBUTING.md for its dependencies");
    }
    let checked = check_all(&[Requirement {
        options: &[("--depth", args.depth.is_some())],
        requires: &format!("--estimator depth-covisibility (found --estimator {})", estimator.name()),
        satisfied: estimator.needs_depth(),
    }]);
    checked.map_err(parse::usage_error)?;
    Ok(args.depth.as_deref().map(DepthFolder::open).transpose()?)
}
