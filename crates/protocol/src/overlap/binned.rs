use std::collections::BTreeMap;
use std::fmt;

use atsplat_numeric::counted;
use serde::Serialize;

use super::annotate::EXAMPLES_PER_REASON;
use super::{OverlapEstimator, OverlapReport, UnmeasuredExample};
use crate::{BinCounts, EvaluationIndex, OverlapBins};

/// The overlaps of an index by bins, and how they were measured.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct BinnedOverlaps {
    /// What the overlaps are.
    pub definition: String,
    /// Entries whose overlap was measured; `None` if those of the index are used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured: Option<usize>,
    /// Overlaps of the index that were replaced.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub replaced: Option<usize>,
    /// Overlaps of the index that could not be measured again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub removed: Option<usize>,
    /// Number of entries whose overlap could not be measured, by reason.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub unmeasured: BTreeMap<&'static str, usize>,
    /// Number of scenes with such entries, by reason.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    failed_scenes: BTreeMap<&'static str, usize>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    examples: Vec<UnmeasuredExample>,
    bins: BinCounts,
    edges: Vec<f64>,
    /// Caveat about these bins.
    #[serde(skip_serializing_if = "Option::is_none")]
    footer: Option<String>,
}

impl BinnedOverlaps {
    /// Counts the overlaps of an index: those of a report, with the estimator that measured them, or else those that it states.
    pub fn new(
        index: &EvaluationIndex,
        bins: &OverlapBins,
        footer: Option<String>,
        measured: Option<(&OverlapReport, &OverlapEstimator)>,
    ) -> Self {
        let definition = match (measured, index.overlap_estimators().as_slice()) {
            (Some((_, estimator)), _) => format!("{}: {}", estimator.name(), estimator.definition()),
            (None, []) => "as given in the index".to_owned(),
            (None, recorded) => format!("as the index records them, by {}", recorded.join(" and ")),
        };
        let measured = measured.map(|(report, _)| report);
        Self {
            definition,
            measured: measured.map(|found| found.measured),
            replaced: measured.map(|found| found.replaced),
            removed: measured.map(|found| found.removed),
            bins: bins.count(index),
            edges: bins.edges().to_vec(),
            footer,
            unmeasured: measured.map_or_else(BTreeMap::new, |found| found.unmeasured.clone()),
            failed_scenes: measured.map_or_else(BTreeMap::new, |found| found.failed_scenes.clone()),
            examples: measured.map_or_else(Vec::new, |found| found.examples.clone()),
        }
    }
}

impl fmt::Display for BinnedOverlaps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "overlap: {}", self.definition)?;
        if let Some(measured) = self.measured {
            writeln!(f, "{measured:>7}  measured")?;
        }
        for (count, what) in [(self.replaced, "replaced"), (self.removed, "removed")] {
            if let Some(count) = count.filter(|count| *count > 0) {
                writeln!(f, "{count:>7}  of the index {what}")?;
            }
        }
        // Both have the same reasons.
        for ((reason, count), scenes) in self.unmeasured.iter().zip(self.failed_scenes.values().copied()) {
            writeln!(f, "{count:>7}  not measured: {reason}, in {}", counted(scenes as u64, "scene"))?;
            for example in self.examples.iter().filter(|example| example.reason == *reason) {
                writeln!(f, "         {:?} entry {}: {}", example.scene, example.entry, example.detail)?;
            }
            if scenes > EXAMPLES_PER_REASON {
                let others = (scenes - EXAMPLES_PER_REASON) as u64;
                writeln!(f, "         and {}", counted(others, "more scene"))?;
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
