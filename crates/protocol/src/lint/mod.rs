//! What is in an evaluation index that a reader of its numbers should know: the figures nobody prints.

mod compare;
mod dataset;
mod display;
mod report;

pub use compare::{Comparability, Verdict, compare};
pub use dataset::{DatasetCheck, DatasetFacts, DropExample};
pub use report::{FileFacts, LintReport, OverlapFacts, Places, RecognisedIndex, Repeats, Spread};

use atsplat_scene::Warnings;

use crate::{BinRule, EvaluationIndex, IndexFile, KnownIndex, OverlapBins};

/// What a lint looks at beyond the index itself.
#[derive(Clone, Debug)]
pub struct LintOptions<'a> {
    /// Names and edges of the overlap bins; both rules are counted.
    pub bins: OverlapBins,
    /// A dataset in which the index's scenes are looked up.
    pub dataset: Option<DatasetCheck<'a>>,
}

impl Default for LintOptions<'_> {
    /// NoPoSplat's bins, no dataset.
    fn default() -> Self {
        Self { bins: OverlapBins::noposplat(BinRule::Published), dataset: None }
    }
}

/// Counts what is in an index. With a dataset, every scene's cameras and the headers of the pictures that the index
/// asks for are read, in parallel, and what is wrong with them goes to `warnings`.
pub fn lint(index: &EvaluationIndex, options: &LintOptions<'_>, warnings: &mut Warnings) -> LintReport {
    let mut report = report::of(index, &options.bins);
    report.dataset = options.dataset.as_ref().map(|dataset| dataset::check(index, dataset, warnings));
    report
}

/// [`lint`] for an index that was read from a file: the file's hash, name and oddities are reported too.
pub fn lint_file(file: &IndexFile, options: &LintOptions<'_>, warnings: &mut Warnings) -> LintReport {
    let mut report = lint(&file.index, options, warnings);
    if let Some(known) = KnownIndex::by_sha256(&file.sha256) {
        report.recognised = Some(RecognisedIndex { by_bytes: true, known });
    }
    report.file = Some(report::file_facts(file));
    report
}

#[cfg(test)]
mod tests;
