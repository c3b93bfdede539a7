use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use anyhow::{bail, ensure};
use atsplat_protocol::overlap::{DepthFolder, OverlapEstimator, UnmeasuredExample, annotate_overlaps};
use atsplat_protocol::{BinCounts, BinPlace, BinRule, EvaluationIndex, IndexFile, KnownIndex, OverlapBins};
use atsplat_report::plot::OverlapHistogram;
use atsplat_scene::Warnings;
use serde::Serialize;

use crate::dataset_args::PictureArgs;
use crate::output::{PendingFile, print_report, print_warnings};
use crate::parse;
use crate::plot::PlotFile;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Evaluation index (JSON). Without `--data`, its own overlaps are used.
    index: PathBuf,

    /// Dataset on whose cameras or images overlaps are measured.
    #[arg(long, value_name = "PATH")]
    data: Option<PathBuf>,

    #[command(flatten)]
    pictures: PictureArgs,

    /// Definition of overlap: epipolar-ray (only cameras), feature-coverage (images, feature `opencv`) or
    /// depth-covisibility (depth maps, `--depth`).
    #[arg(
        long,
        value_name = "NAME",
        default_value = "epipolar-ray",
        requires = "data",
        value_parser = parse::estimator
    )]
    estimator: OverlapEstimator,

    /// Depth maps for depth-covisibility: one `<scene>/<frame name>.exr` per context frame, channel `Z` or the only
    /// channel, in scene units along the camera's z axis.
    #[arg(long, value_name = "FOLDER", requires = "data", required_if_eq("estimator", "depth-covisibility"))]
    depth: Option<PathBuf>,

    /// Index file with overlaps to write.
    #[arg(long, short, value_name = "INDEX")]
    out: Option<PathBuf>,

    /// Histogram coloured by bin, .svg or .png.
    #[arg(long, value_name = "PICTURE", value_parser = PlotFile::parser())]
    plot: Option<PlotFile>,

    /// Bins as NAME:UPPER,… after the lowest edge, e.g. `0.05,small:0.3,medium:0.55,large:0.8` (the default).
    #[arg(long, value_name = "BINS", value_parser = parse::bins)]
    bins: Option<OverlapBins>,

    /// Put overlaps below the first edge in no bin, instead of the second one as NoPoSplat's code does.
    #[arg(long)]
    strict_bins: bool,

    /// Use the published bins even if they belong to another estimator, which is then noted. Without it, and without
    /// `--bins`, such overlaps get their own bins with a third of the values in each.
    #[arg(long)]
    force: bool,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report {
    definition: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    measured: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    replaced: Option<usize>,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    unmeasured: BTreeMap<&'static str, usize>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    examples: Vec<UnmeasuredExample>,
    bins: BinCounts,
    edges: Vec<f64>,
    /// Caveat about these bins.
    #[serde(skip_serializing_if = "Option::is_none")]
    footer: Option<String>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let depth = depth(args)?;
    let file = IndexFile::read(&args.index)?;
    let out = args.out.as_deref().map(PendingFile::open).transpose()?;
    let plot = args.plot.as_ref().map(PlotFile::open).transpose()?;
    let layout = file.layout;
    let name = match KnownIndex::by_sha256(&file.sha256) {
        Some(known) => known.name.to_owned(),
        None => args.index.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
    };
    let mut warnings = Warnings::new();
    let mut index = file.into_unambiguous().map_err(|error| error.in_file(&args.index))?;
    let mut measured = None;
    if let Some(path) = &args.data {
        let estimator = &args.estimator;
        let dataset = args.pictures.open(path, &mut warnings)?;
        let found = annotate_overlaps(&index, &dataset, estimator, depth.as_ref(), &mut warnings);
        index.clone_from(&found.index);
        measured = Some(found);
    }
    let (bins, footer) = args.bins_of(&index);
    let definition = match (&measured, index.overlap_estimators().as_slice()) {
        (Some(_), _) => format!("{}: {}", args.estimator.name(), args.estimator.definition()),
        (None, []) => "as given in the index".to_owned(),
        (None, recorded) => format!("as the index records them, by {}", recorded.join(" and ")),
    };
    let report = Report {
        definition,
        measured: measured.as_ref().map(|found| found.measured),
        replaced: measured.as_ref().map(|found| found.replaced),
        bins: bins.count(&index),
        edges: bins.edges().to_vec(),
        footer,
        unmeasured: measured.as_ref().map_or_else(BTreeMap::new, |found| found.unmeasured.clone()),
        examples: measured.map_or_else(Vec::new, |found| found.examples),
    };
    if let Some(plot) = plot {
        let overlaps = placed_overlaps(&index, &bins);
        let subtitle = format!("index {name}; {} context sets; {}", overlaps.len(), report.definition);
        let title = "Overlap of the context views";
        let histogram = OverlapHistogram { title, subtitle: &subtitle, overlaps: &overlaps, bins: bins.names() };
        plot.finish(|format| histogram.draw().encode(format))?;
    }
    if let Some(out) = out {
        out.finish(index.to_json(&layout).as_bytes())?;
    }
    let complete = report.unmeasured.is_empty();
    print_report(&report, args.json)?;
    print_warnings(&warnings);
    let nothing = report.measured == Some(0) && !report.unmeasured.is_empty();
    ensure!(!nothing, "no overlap of {} could be measured", args.index.display());
    Ok(complete)
}

impl Args {
    /// The bins for these overlaps, and a caveat if there is one.
    fn bins_of(&self, index: &EvaluationIndex) -> (OverlapBins, Option<String>) {
        let rule = if self.strict_bins { BinRule::Strict } else { BinRule::Published };
        if let Some(bins) = &self.bins {
            return (bins.with_rule(rule), None);
        }
        let published = OverlapBins::noposplat(rule);
        let estimators = index.overlap_estimators();
        let Some(foreign) = published.foreign(&estimators) else { return (published, None) };
        let of = published.estimator().unwrap_or("another estimator");
        if self.force {
            let footer =
                format!("the bins were published for {of}, and these overlaps are {foreign}'s: they do not compare");
            return (published, Some(footer));
        }
        let values: Vec<f64> = index.overlaps().map(|overlap| overlap.value).collect();
        let footer = format!(
            "bins of {foreign}'s own, a third of the values in each: small, medium and large were published for {of} (--force)"
        );
        (OverlapBins::thirds(&values, &estimators.join(" and ")), Some(footer))
    }
}

/// The folder of depth maps, if the estimator uses them.
fn depth(args: &Args) -> anyhow::Result<Option<DepthFolder>> {
    let estimator = &args.estimator;
    if matches!(estimator, OverlapEstimator::FeatureCoverage { measure: None }) {
        bail!("feature-coverage needs a build with `--features opencv`; see CONTRIBUTING.md for its dependencies");
    }
    if args.depth.is_some() && !estimator.needs_depth() {
        bail!("--depth is for --estimator depth-covisibility; {} does not use depth", estimator.name());
    }
    Ok(args.depth.as_deref().map(DepthFolder::open).transpose()?)
}

/// Each overlap with its bin; `None` outside all bins.
fn placed_overlaps(index: &EvaluationIndex, bins: &OverlapBins) -> Vec<(f64, Option<usize>)> {
    let place = |overlap| match bins.place(overlap) {
        BinPlace::Bin(bin) => Some(bin),
        BinPlace::Below | BinPlace::Above => None,
    };
    index.overlaps().map(|overlap| (overlap.value, place(overlap.value))).collect()
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "overlap: {}", self.definition)?;
        if let Some(measured) = self.measured {
            writeln!(f, "{measured:>7}  measured")?;
        }
        if let Some(replaced) = self.replaced.filter(|count| *count > 0) {
            writeln!(f, "{replaced:>7}  of the index replaced")?;
        }
        for (reason, count) in &self.unmeasured {
            writeln!(f, "{count:>7}  not measured: {reason}")?;
            for example in self.examples.iter().filter(|example| example.reason == *reason) {
                writeln!(f, "         {:?} entry {}: {}", example.scene, example.entry, example.detail)?;
            }
        }
        for (bin, edges) in self.bins.bins.iter().zip(self.edges.windows(2)) {
            let [low, high] = edges else { continue };
            writeln!(f, "{:>7}  {}, {low:.4} to {high:.4}", bin.count, bin.name)?;
        }
        writeln!(f, "{:>7}  below the bins", self.bins.below)?;
        writeln!(f, "{:>7}  above the bins", self.bins.above)?;
        writeln!(f, "{:>7}  without an overlap", self.bins.without_overlap)?;
        self.footer.iter().try_for_each(|footer| writeln!(f, "{footer}"))
    }
}
