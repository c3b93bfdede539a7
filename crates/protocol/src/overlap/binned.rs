use std::collections::BTreeMap;
use std::fmt;

use atsplat_numeric::counted;
use serde::Serialize;

use super::annotate::EXAMPLES_PER_REASON;
use super::{OverlapEstimator, OverlapReport, UnmeasuredExample};
use crate::{BinCounts, EvaluationIndex, IndexEntry, OverlapBins};

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
    /// Measured overlaps of more than two context views: each the smallest of neighbours ([`super::chain_overlap`]).
    #[serde(skip_serializing_if = "Option::is_none")]
    smallest_of_neighbours: Option<usize>,
    bins: BinCounts,
    /// Overlaps below the lowest edge that the rule puts in the second bin.
    #[serde(skip_serializing_if = "Option::is_none")]
    below_in_second_bin: Option<usize>,
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
        let is_below = |overlap: f64| bins.edges().first().is_some_and(|lowest| overlap < *lowest);
        let placed = bins.placed(index).into_iter();
        let below_in_second = placed.filter(|(overlap, bin)| *bin == Some(1) && is_below(*overlap)).count();
        // Overlaps without an estimator were measured elsewhere, by another rule perhaps.
        let is_measured =
            |entry: &IndexEntry| entry.overlap.as_ref().is_some_and(|overlap| overlap.estimator.is_some());
        let of_several = index.entries().filter(|(.., entry)| entry.context.len() > 2 && is_measured(entry)).count();
        Self {
            definition,
            measured: measured.map(|found| found.measured),
            replaced: measured.map(|found| found.replaced),
            removed: measured.map(|found| found.removed),
            unmeasured: measured.map_or_else(BTreeMap::new, |found| found.unmeasured.clone()),
            failed_scenes: measured.map_or_else(BTreeMap::new, |found| found.failed_scenes.clone()),
            examples: measured.map_or_else(Vec::new, |found| found.examples.clone()),
            smallest_of_neighbours: Some(of_several).filter(|count| *count > 0),
            bins: bins.count(index),
            below_in_second_bin: Some(below_in_second).filter(|count| *count > 0),
            edges: bins.edges().to_vec(),
            footer,
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
        if let Some(count) = self.smallest_of_neighbours {
            writeln!(f, "{count:>7}  of more than two views: the smallest overlap of two neighbours in frame order")?;
        }
        for (at, (bin, edges)) in self.bins.bins.iter().zip(self.edges.windows(2)).enumerate() {
            let [low, high] = edges else { continue };
            write!(f, "{:>7}  {}, {low:.4} to {high:.4}", bin.count, bin.name)?;
            if let (1, Some(below), Some(lowest)) = (at, self.below_in_second_bin, self.edges.first()) {
                write!(f, ", and {below} below {lowest:.4}, as NoPoSplat's code does")?;
            }
            writeln!(f)?;
        }
        writeln!(f, "{:>7}  below the bins", self.bins.below)?;
        writeln!(f, "{:>7}  above the bins", self.bins.above)?;
        writeln!(f, "{:>7}  without an overlap", self.bins.without_overlap)?;
        self.footer.iter().try_for_each(|footer| writeln!(f, "{footer}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BinRule, IndexFile};

    fn printed(json: &str, rule: BinRule) -> (String, serde_json::Value) {
        let index = IndexFile::parse(json.as_bytes()).unwrap().index;
        let found = BinnedOverlaps::new(&index, &OverlapBins::noposplat(rule), None, None);
        (found.to_string(), serde_json::to_value(&found).unwrap())
    }

    /// Overlaps at 0 and just below 0.05 are in the second bin by the published rule, that of 0.05 in the first.
    #[test]
    fn overlaps_below_the_lowest_edge_are_named_where_they_are_counted() {
        let index = r#"{"a": {"context": [0, 9], "target": [3], "overlap": 0.0},
            "b": {"context": [0, 9], "target": [3], "overlap": 0.0499999},
            "c": {"context": [0, 9], "target": [3], "overlap": 0.05},
            "d": {"context": [0, 9], "target": [3], "overlap": 0.4}}"#;
        let (published, json) = printed(index, BinRule::Published);
        let medium = "      3  medium, 0.3000 to 0.5500, and 2 below 0.0500, as NoPoSplat's code does\n";
        assert!(published.contains(medium) && published.contains("1  small, 0.0500 to 0.3000\n"), "{published}");
        assert_eq!(json["below-in-second-bin"], 2);
        assert_eq!(json["bins"]["below"], 0);
        let (strict, json) = printed(index, BinRule::Strict);
        let expected = "      1  medium, 0.3000 to 0.5500\n";
        assert!(strict.contains(expected) && strict.contains("2  below the bins"), "{strict}");
        assert!(json.get("below-in-second-bin").is_none(), "{json}");
    }

    /// Two of four entries: one has two views, the overlap of one was measured elsewhere.
    #[test]
    fn measured_overlaps_of_several_views_are_said_to_be_of_neighbours() {
        let measured = r#""target": [3], "overlap": 0.2, "overlap_estimator": "epipolar-ray""#;
        let index = format!(
            r#"{{"a": [{{"context": [0, 5, 9], {measured}}}, {{"context": [0, 4, 6, 9], {measured}}}],
            "b": {{"context": [0, 9], {measured}}},
            "c": {{"context": [0, 5, 9], "target": [3], "overlap": 0.2}}}}"#
        );
        let (text, json) = printed(&index, BinRule::Published);
        let expected = "      2  of more than two views: the smallest overlap of two neighbours in frame order\n";
        assert!(text.contains(expected), "{text}");
        assert_eq!(json["smallest-of-neighbours"], 2);
        let (text, json) = printed(r#"{"c": {"context": [0, 5], "target": [3], "overlap": 0.2}}"#, BinRule::Published);
        assert!(!text.contains("neighbours") && json.get("smallest-of-neighbours").is_none(), "{text}");
    }
}
