//! Lint of evaluation indices: what readers of their numbers should know, and papers do not report.

mod compare;
mod dataset;
mod display;
mod full;
mod report;

pub use compare::{Comparability, TableSharing, compare};
pub use dataset::{DatasetCheck, DatasetFacts, DropExample};
pub use full::{FullLint, PresetMatch};
pub use report::{CountDistribution, FileFacts, LintReport, OverlapFacts, RecognisedIndex, Repeats, TargetCount};

use atsplat_scene::Warnings;

use crate::{BinRule, EvaluationIndex, IndexFile, KnownIndex, OverlapBins};

/// What a lint examines in addition to the index.
#[derive(Clone, Debug)]
pub struct LintOptions<'a> {
    /// Names and edges of the overlap bins; both rules are counted.
    pub bins: OverlapBins,
    /// The dataset in which the index's scenes are looked up.
    pub dataset: Option<DatasetCheck<'a>>,
}

impl Default for LintOptions<'_> {
    /// NoPoSplat's bins, no dataset.
    fn default() -> Self {
        Self { bins: OverlapBins::noposplat(BinRule::Published), dataset: None }
    }
}

/// Lints an index. With a dataset, the cameras of every scene and the headers of the images that the index uses are
/// read in parallel, and their irregularities are pushed to `warnings`.
pub fn lint(index: &EvaluationIndex, options: &LintOptions<'_>, warnings: &mut Warnings) -> LintReport {
    let mut report = report::of(index, &options.bins);
    report.dataset = options.dataset.as_ref().map(|dataset| dataset::check(index, dataset, warnings));
    report
}

/// [`lint`] for an index file: also reports the file's hash, name and irregularities.
pub fn lint_file(file: &IndexFile, options: &LintOptions<'_>, warnings: &mut Warnings) -> LintReport {
    let mut report = lint(&file.index, options, warnings);
    if let Some(known) = KnownIndex::by_sha256(&file.sha256) {
        report.recognised = Some(RecognisedIndex { by_bytes: true, known });
    }
    report.file = Some(FileFacts { sha256: file.sha256, size: file.size, notices: file.notices.clone() });
    report
}

#[cfg(test)]
mod tests;
