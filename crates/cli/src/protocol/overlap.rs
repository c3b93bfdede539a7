use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use anyhow::{Context as _, bail};
use atsplat_protocol::overlap::{OverlapEstimator, annotate_overlaps};
use atsplat_protocol::{BinCounts, BinPlace, BinRule, EvaluationIndex, IndexFile, KnownIndex, OverlapBins};
use atsplat_scene::Warnings;
use clap::Args;
use serde::Serialize;

use crate::output::{PendingFile, print_report, print_warnings};
use crate::plot::{OverlapHistogram, draw_overlap_histogram};

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// Evaluation index (JSON). Without `--data`, the overlaps that it ships are used.
    index: PathBuf,

    /// Dataset whose cameras, or pictures, the overlaps are measured on.
    #[arg(long, value_name = "PATH")]
    data: Option<PathBuf>,

    /// Definition of overlap: epipolar-ray (cameras alone) or feature-coverage (pictures, feature `opencv`).
    #[arg(long, value_name = "NAME", default_value = "epipolar-ray", requires = "data")]
    estimator: String,

    /// Where the index with overlaps goes.
    #[arg(long, short, value_name = "INDEX")]
    out: Option<PathBuf>,

    /// Histogram coloured by bin, .svg or .png.
    #[arg(long, value_name = "PICTURE")]
    plot: Option<PathBuf>,

    /// Bins as NAME:UPPER,… after the lowest edge, e.g. `0.05,small:0.3,medium:0.55,large:0.8` (the default).
    #[arg(long, value_name = "BINS")]
    bins: Option<String>,

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
    bins: BinCounts,
}

pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    let file = IndexFile::read(&words.index)?;
    let rule = if words.strict_bins { BinRule::Strict } else { BinRule::Published };
    let bins = match &words.bins {
        Some(text) => parse_bins(text, rule)?,
        None => OverlapBins::noposplat(rule),
    };
    let out = words.out.as_deref().map(PendingFile::open).transpose()?;
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
        bins: bins.count(&file.index),
    };
    let mut index = file.into_unambiguous()?;
    if let Some(path) = &words.data {
        let estimator = estimator(&words.estimator)?;
        let dataset = atsplat_scene::open(path, &mut warnings)?;
        let measured = annotate_overlaps(&index, &dataset, &estimator, &mut warnings);
        index = measured.index;
        report = Report {
            definition: format!("{}: {}", estimator.name(), estimator.definition()),
            measured: Some(measured.measured),
            unmeasured: measured.unmeasured,
            bins: bins.count(&index),
        };
    }
    if let Some(path) = &words.plot {
        plot(&index, &bins, &title, path)?;
    }
    if let Some(out) = out {
        out.finish(index.to_json(&layout).as_bytes())?;
    }
    let complete = report.unmeasured.is_empty();
    print_report(&report, words.json)?;
    print_warnings(&warnings);
    Ok(complete)
}

fn estimator(name: &str) -> anyhow::Result<OverlapEstimator> {
    let text = format!("estimator = {name:?}");
    toml::from_str(&text).map_err(|error| anyhow::anyhow!("--estimator: {}", error.message()))
}

/// `0.05,small:0.3,medium:0.55,large:0.8`: the lowest edge, then each bin's name and upper edge.
fn parse_bins(text: &str, rule: BinRule) -> anyhow::Result<OverlapBins> {
    let mut parts = text.split(',');
    let mut edges = vec![edge(parts.next().unwrap_or_default())?];
    let mut names = Vec::new();
    for part in parts {
        let Some((name, upper)) = part.split_once(':') else {
            bail!("--bins: expected NAME:UPPER, found {part:?}");
        };
        names.push(name.trim().to_owned());
        edges.push(edge(upper)?);
    }
    Ok(OverlapBins::new(rule, names, edges)?)
}

fn edge(text: &str) -> anyhow::Result<f64> {
    text.trim().parse().with_context(|| format!("--bins: expected a number, found {text:?}"))
}

fn plot(index: &EvaluationIndex, bins: &OverlapBins, title: &str, path: &std::path::Path) -> anyhow::Result<()> {
    let place = |overlap| match bins.place(overlap) {
        BinPlace::Bin(bin) => Some(bin),
        BinPlace::Below | BinPlace::Above => None,
    };
    let overlaps: Vec<(f64, Option<usize>)> =
        index.entries().filter_map(|(_, _, entry)| entry.overlap).map(|overlap| (overlap, place(overlap))).collect();
    draw_overlap_histogram(&OverlapHistogram { title, overlaps: &overlaps, bins: bins.names() }, path)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "overlap: {}", self.definition)?;
        if let Some(measured) = self.measured {
            writeln!(f, "{measured:>7}  measured")?;
        }
        for (reason, count) in &self.unmeasured {
            writeln!(f, "{count:>7}  not measured: {reason}")?;
        }
        for bin in &self.bins.bins {
            writeln!(f, "{:>7}  {}", bin.count, bin.name)?;
        }
        writeln!(f, "{:>7}  below the bins", self.bins.below)?;
        writeln!(f, "{:>7}  above the bins", self.bins.above)?;
        writeln!(f, "{:>7}  without an overlap", self.bins.without_overlap)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_as_words() {
        let bins = parse_bins("0.05,small:0.3, medium:0.55,large:0.8", BinRule::Strict).unwrap();
        assert_eq!(bins, OverlapBins::noposplat(BinRule::Strict));
        for broken in ["", "0.1", "0.1,a", "0.1,a:x", "0.3,a:0.1", "0.1,a:0.2,a:0.3"] {
            assert!(parse_bins(broken, BinRule::Strict).is_err(), "{broken:?}");
        }
    }

    #[test]
    fn estimators_by_name() {
        assert_eq!(estimator("epipolar-ray").unwrap().name(), "epipolar-ray");
        let error = estimator("guess").unwrap_err().to_string();
        assert!(error.contains("epipolar-ray"), "the names are listed: {error}");
    }
}
