use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use anyhow::bail;
use atsplat_protocol::overlap::{DepthFolder, OverlapEstimator, UnmeasuredExample, annotate_overlaps};
use atsplat_protocol::{BinCounts, BinPlace, BinRule, EvaluationIndex, IndexFile, KnownIndex, OverlapBins};
use atsplat_scene::Warnings;
use clap::Args;
use serde::Serialize;

use super::parse;
use crate::dataset_words::PictureWords;
use crate::output::{PendingFile, print_report, print_warnings};
use crate::plot::{OverlapHistogram, PlotFile, PlotFormat, draw_overlap_histogram};

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// Evaluation index (JSON). Without `--data`, the overlaps that it ships are used.
    index: PathBuf,

    /// Dataset whose cameras, or pictures, the overlaps are measured on.
    #[arg(long, value_name = "PATH")]
    data: Option<PathBuf>,

    #[command(flatten)]
    pictures: PictureWords,

    /// Definition of overlap: epipolar-ray (cameras alone), feature-coverage (pictures, feature `opencv`) or
    /// depth-covisibility (depth maps, `--depth`).
    #[arg(
        long,
        value_name = "NAME",
        default_value = "epipolar-ray",
        requires = "data",
        value_parser = parse::estimator
    )]
    estimator: OverlapEstimator,

    /// Depth maps for depth-covisibility: one `<scene>/<frame name>.exr` a context frame, channel `Z` or the only
    /// channel, in scene units along the camera's z axis.
    #[arg(long, value_name = "FOLDER", requires = "data", required_if_eq("estimator", "depth-covisibility"))]
    depth: Option<PathBuf>,

    /// Where the index with overlaps goes.
    #[arg(long, short, value_name = "INDEX")]
    out: Option<PathBuf>,

    /// Histogram coloured by bin, .svg or .png.
    #[arg(long, value_name = "PICTURE", value_parser = PlotFile::parser())]
    plot: Option<PlotFile>,

    /// Bins as NAME:UPPER,… after the lowest edge, e.g. `0.05,small:0.3,medium:0.55,large:0.8` (the default).
    #[arg(long, value_name = "BINS", value_parser = parse::bins)]
    bins: Option<OverlapBins>,

    /// File overlaps below the first edge in no bin instead of the second, where NoPoSplat's code puts them.
    #[arg(long)]
    strict_bins: bool,

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
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    unmeasured: BTreeMap<&'static str, usize>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    examples: Vec<UnmeasuredExample>,
    bins: BinCounts,
}

pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    let depth = depth(words)?;
    let file = IndexFile::read(&words.index)?;
    let rule = if words.strict_bins { BinRule::Strict } else { BinRule::Published };
    let bins = words.bins.as_ref().map_or_else(|| OverlapBins::noposplat(rule), |bins| bins.with_rule(rule));
    let out = words.out.as_deref().map(PendingFile::open).transpose()?;
    let plot = match &words.plot {
        Some(plot) => Some((PendingFile::open(&plot.path)?, plot.format)),
        None => None,
    };
    let layout = file.layout;
    let title = match KnownIndex::by_sha256(&file.sha256) {
        Some(known) => format!("{} {}", known.repository, known.path),
        None => words.index.file_name().unwrap_or_default().to_string_lossy().into_owned(),
    };
    let mut warnings = Warnings::new();
    let mut report = Report {
        definition: "as the index ships them".to_owned(),
        measured: None,
        unmeasured: BTreeMap::new(),
        examples: Vec::new(),
        bins: bins.count(&file.index),
    };
    let mut index = file.into_unambiguous()?;
    if let Some(path) = &words.data {
        let estimator = &words.estimator;
        let dataset = words.pictures.open(path, &mut warnings)?;
        let measured = annotate_overlaps(&index, &dataset, estimator, depth.as_ref(), &mut warnings);
        index = measured.index;
        report = Report {
            definition: format!("{}: {}", estimator.name(), estimator.definition()),
            measured: Some(measured.measured),
            unmeasured: measured.unmeasured,
            examples: measured.examples,
            bins: bins.count(&index),
        };
    }
    if let Some((file, format)) = plot {
        file.finish(&histogram(&index, &bins, &title, format)?)?;
    }
    if let Some(out) = out {
        out.finish(index.to_json(&layout).as_bytes())?;
    }
    let complete = report.unmeasured.is_empty();
    print_report(&report, words.json)?;
    print_warnings(&warnings);
    Ok(complete)
}

/// The folder of depth maps, where the estimator looks at them.
fn depth(words: &Words) -> anyhow::Result<Option<DepthFolder>> {
    let estimator = &words.estimator;
    #[cfg(not(feature = "opencv"))]
    if *estimator == OverlapEstimator::FeatureCoverage {
        bail!("feature-coverage needs a build with `--features opencv`; see CONTRIBUTING.md for what it takes");
    }
    if words.depth.is_some() && !estimator.needs_depth() {
        bail!("--depth is for --estimator depth-covisibility; {} looks at no depth", estimator.name());
    }
    Ok(words.depth.as_deref().map(DepthFolder::open).transpose()?)
}

fn histogram(index: &EvaluationIndex, bins: &OverlapBins, title: &str, format: PlotFormat) -> anyhow::Result<Vec<u8>> {
    let place = |overlap| match bins.place(overlap) {
        BinPlace::Bin(bin) => Some(bin),
        BinPlace::Below | BinPlace::Above => None,
    };
    let overlaps: Vec<(f64, Option<usize>)> =
        index.entries().filter_map(|(_, _, entry)| entry.overlap).map(|overlap| (overlap, place(overlap))).collect();
    draw_overlap_histogram(&OverlapHistogram { title, overlaps: &overlaps, bins: bins.names() }, format)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "overlap: {}", self.definition)?;
        if let Some(measured) = self.measured {
            writeln!(f, "{measured:>7}  measured")?;
        }
        for (reason, count) in &self.unmeasured {
            writeln!(f, "{count:>7}  not measured: {reason}")?;
            for example in self.examples.iter().filter(|example| example.reason == *reason) {
                writeln!(f, "         {:?} entry {}: {}", example.scene, example.entry, example.detail)?;
            }
        }
        for bin in &self.bins.bins {
            writeln!(f, "{:>7}  {}", bin.count, bin.name)?;
        }
        writeln!(f, "{:>7}  below the bins", self.bins.below)?;
        writeln!(f, "{:>7}  above the bins", self.bins.above)?;
        writeln!(f, "{:>7}  without an overlap", self.bins.without_overlap)
    }
}
