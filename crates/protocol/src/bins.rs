use std::fmt;

use atsplat_numeric::quantile;
use serde::{Deserialize, Serialize};

use crate::{EvaluationIndex, ProtocolError};

/// Named intervals of overlap, with a rule for values at and beyond their edges.
///
/// `n` bins have `n + 1` edges; bin `i` is `edges[i] < overlap ≤ edges[i + 1]`, and the first bin includes its lower
/// edge.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", try_from = "UncheckedBins")]
pub struct OverlapBins {
    rule: BinRule,
    names: Vec<String>,
    edges: Vec<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    estimator: Option<String>,
}

/// What happens to an overlap below the first edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BinRule {
    /// As NoPoSplat's tagger (`src/misc/utils.py:38-48`): `if e₀ ≤ o ≤ e₁ … elif o ≤ e₂ …`, so that a
    /// value below the first edge falls into the *second* bin. With the published edges, 3 of 5601 RE10K
    /// scenes and 4 of 1341 ACID scenes of small overlap count as medium.
    Published,
    /// A value below the first edge is in no bin.
    Strict,
}

/// Where an overlap value falls.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BinPlace {
    /// In the bin at this position of [`OverlapBins::names`].
    Bin(usize),
    /// Below the first edge.
    Below,
    /// Above the last edge, or not a number.
    Above,
}

/// The number of an index's entries in each bin and outside the bins.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct BinCounts {
    /// The rule applied.
    pub rule: BinRule,
    /// Each bin's count, in the bins' order.
    pub bins: Vec<BinCount>,
    /// Entries below the first edge that the rule puts in no bin.
    pub below: u64,
    /// Entries above the last edge.
    pub above: u64,
    /// Entries without an overlap.
    pub without_overlap: u64,
}

/// The number of entries in one bin.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct BinCount {
    /// The bin's name.
    pub name: String,
    /// Entries in it.
    pub count: u64,
}

impl OverlapBins {
    /// Named bins between strictly increasing edges.
    ///
    /// # Errors
    /// [`ProtocolError::Bins`] unless there are at least one bin, one more edge than names, finite and strictly
    /// increasing edges, and distinct names that are not empty.
    pub fn new(rule: BinRule, names: Vec<String>, edges: Vec<f64>) -> Result<Self, ProtocolError> {
        let invalid = |expected, found: String| Err(ProtocolError::Bins { expected, found });
        if names.is_empty() || edges.len() != names.len() + 1 {
            let found = format!("{} names and {} edges", names.len(), edges.len());
            return invalid("at least one name, and one more edge than names", found);
        }
        let increasing = edges.windows(2).all(|pair| matches!(pair, [low, high] if low < high));
        if !increasing || !edges.iter().all(|edge| edge.is_finite()) {
            return invalid("finite edges that increase", format!("{edges:?}"));
        }
        let repeated = names.iter().enumerate().find(|(at, name)| name.is_empty() || names[..*at].contains(name));
        match repeated {
            Some((_, name)) if name.is_empty() => invalid("names that are not empty", "an empty name".to_owned()),
            Some((_, name)) => invalid("distinct names", format!("{name:?} twice")),
            None => Ok(Self { rule, names, edges, estimator: None }),
        }
    }

    /// NoPoSplat's bins, for overlaps by dense matching with `RoMa`: small 0.05–0.3, medium –0.55, large –0.8.
    pub fn noposplat(rule: BinRule) -> Self {
        Self {
            rule,
            names: ["small", "medium", "large"].map(str::to_owned).to_vec(),
            edges: vec![0.05, 0.3, 0.55, 0.8],
            estimator: Some("roma".to_owned()),
        }
    }

    /// Bins for an estimator without published edges: `low`, `middle` and `high`, with a third of the values in each;
    /// fewer bins if too many values are equal. Without values, thirds of [0, 1].
    pub fn thirds(values: &[f64], estimator: &str) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let third = |share: f64| quantile(&sorted, share).unwrap_or(share);
        let mut edges = vec![0.0, third(1.0 / 3.0), third(2.0 / 3.0), 1.0];
        edges.dedup_by(|later, earlier| *later <= *earlier);
        let names: &[&str] = match edges.len() {
            4 => &["low", "middle", "high"],
            3 => &["low", "high"],
            _ => &["all"],
        };
        let names = names.iter().map(|name| (*name).to_owned()).collect();
        Self { rule: BinRule::Strict, names, edges, estimator: Some(estimator.to_owned()) }
    }

    /// [`Self::thirds`] of the overlaps of an index.
    pub(crate) fn thirds_of(index: &EvaluationIndex) -> Self {
        let values: Vec<f64> = index.overlaps().map(|overlap| overlap.value).collect();
        Self::thirds(&values, &index.overlap_estimators().join(" and "))
    }

    /// The same edges under another rule.
    #[must_use]
    pub fn with_rule(&self, rule: BinRule) -> Self {
        Self { rule, ..self.clone() }
    }

    /// The estimator of the overlaps that the edges were published for; `None` if unknown.
    pub fn estimator(&self) -> Option<&str> {
        self.estimator.as_deref()
    }

    /// The same bins for overlaps of any estimator.
    pub(crate) fn without_estimator(self) -> Self {
        Self { estimator: None, ..self }
    }

    /// The first of an index's recorded `estimators` that these bins were not published for; `None` if they fit all.
    pub fn mismatched_estimator<'a>(&self, estimators: &'a [String]) -> Option<&'a str> {
        let expected = self.estimator.as_deref().or(estimators.first().map(String::as_str));
        estimators.iter().map(String::as_str).find(|name| Some(*name) != expected)
    }

    /// The rule for values below the first edge.
    pub const fn rule(&self) -> BinRule {
        self.rule
    }

    /// The bins' names, in order of increasing overlap.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The edges, increasing; one more than bins.
    pub fn edges(&self) -> &[f64] {
        &self.edges
    }

    /// The published bins for the overlaps of this index; or, if they were published for another estimator and not
    /// `force`d, bins with a third of the values in each. In both cases with a caveat.
    pub fn for_index(index: &EvaluationIndex, rule: BinRule, force: bool) -> (Self, Option<String>) {
        let published = Self::noposplat(rule);
        let estimators = index.overlap_estimators();
        let Some(actual) = published.mismatched_estimator(&estimators) else { return (published, None) };
        let published_for = published.estimator().unwrap_or("another estimator");
        if force {
            let footer = format!(
                "the bins were published for {published_for}, but these overlaps were measured by {actual}: results are not comparable"
            );
            return (published, Some(footer));
        }
        let footer = format!(
            "bins with a third of the overlaps each, as measured by {actual}: small, medium and large were published for overlaps by \
             {published_for}; --force uses them nevertheless"
        );
        (Self::thirds_of(index), Some(footer))
    }

    /// Each overlap of an index with its bin; `None` outside all bins.
    pub fn placed(&self, index: &EvaluationIndex) -> Vec<(f64, Option<usize>)> {
        let place = |overlap| match self.place(overlap) {
            BinPlace::Bin(bin) => Some(bin),
            BinPlace::Below | BinPlace::Above => None,
        };
        index.overlaps().map(|overlap| (overlap.value, place(overlap.value))).collect()
    }

    /// Where `overlap` falls.
    pub fn place(&self, overlap: f64) -> BinPlace {
        let (first, second) = (self.edges[0], self.edges[1]);
        if (first..=second).contains(&overlap) {
            return BinPlace::Bin(0);
        }
        if self.rule == BinRule::Strict && overlap < first {
            return BinPlace::Below;
        }
        match self.edges.iter().skip(2).position(|upper| overlap <= *upper) {
            Some(later) => BinPlace::Bin(later + 1),
            // With a single bin, the published rule has no second bin for values below the range.
            None if overlap < first => BinPlace::Below,
            None => BinPlace::Above,
        }
    }

    /// The name of the bin that `overlap` falls in.
    pub fn name_of(&self, overlap: f64) -> Option<&str> {
        match self.place(overlap) {
            BinPlace::Bin(at) => Some(&self.names[at]),
            BinPlace::Below | BinPlace::Above => None,
        }
    }

    /// Counts the entries of an index in each bin.
    pub fn count(&self, index: &EvaluationIndex) -> BinCounts {
        let mut counts = BinCounts {
            rule: self.rule,
            bins: self.names.iter().map(|name| BinCount { name: name.clone(), count: 0 }).collect(),
            below: 0,
            above: 0,
            without_overlap: 0,
        };
        for (_, _, entry) in index.entries() {
            *match entry.overlap.as_ref().map(|overlap| self.place(overlap.value)) {
                None => &mut counts.without_overlap,
                Some(BinPlace::Below) => &mut counts.below,
                Some(BinPlace::Above) => &mut counts.above,
                Some(BinPlace::Bin(at)) => &mut counts.bins[at].count,
            } += 1;
        }
        counts
    }
}

/// [`OverlapBins`] before validation.
#[derive(Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct UncheckedBins {
    rule: BinRule,
    names: Vec<String>,
    edges: Vec<f64>,
    #[serde(default)]
    estimator: Option<String>,
}

impl TryFrom<UncheckedBins> for OverlapBins {
    type Error = ProtocolError;

    fn try_from(UncheckedBins { rule, names, edges, estimator }: UncheckedBins) -> Result<Self, ProtocolError> {
        Ok(Self { estimator, ..Self::new(rule, names, edges)? })
    }
}

impl fmt::Display for BinCounts {
    /// `small 1403, medium 2565, large 1630, below range 3`; zero counts outside the bins are omitted.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let outside = [("below range", self.below), ("above range", self.above), ("without", self.without_overlap)];
        let bins = self.bins.iter().map(|bin| (bin.name.as_str(), bin.count));
        let shown = bins.chain(outside.into_iter().filter(|(_, count)| *count > 0));
        for (at, (name, count)) in shown.enumerate() {
            write!(f, "{}{name} {count}", if at == 0 { "" } else { ", " })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn bins_values_at_the_edges_by_both_rules() {
        let (published, strict) = (OverlapBins::noposplat(BinRule::Published), OverlapBins::noposplat(BinRule::Strict));
        for (overlap, in_published, in_strict) in [
            (0.0, Some("medium"), None),
            (0.04351, Some("medium"), None),
            (0.05, Some("small"), Some("small")),
            (0.3, Some("small"), Some("small")),
            (0.300_01, Some("medium"), Some("medium")),
            (0.55, Some("medium"), Some("medium")),
            (0.8, Some("large"), Some("large")),
            (0.800_01, None, None),
            (f64::NAN, None, None),
            (f64::NEG_INFINITY, Some("medium"), None),
        ] {
            assert_eq!((published.name_of(overlap), strict.name_of(overlap)), (in_published, in_strict), "{overlap}");
        }
        assert_eq!(strict.place(0.01), BinPlace::Below);
        assert_eq!(strict.place(0.9), BinPlace::Above);
    }

    #[test]
    fn finds_estimators_the_bins_were_not_published_for() {
        let published = OverlapBins::noposplat(BinRule::Published);
        let recorded = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        assert_eq!(published.mismatched_estimator(&recorded(&[])), None, "an index that records no estimator");
        assert_eq!(published.mismatched_estimator(&recorded(&["roma"])), None);
        assert_eq!(published.mismatched_estimator(&recorded(&["epipolar-ray", "roma"])), Some("epipolar-ray"));
        let any = OverlapBins::new(BinRule::Strict, recorded(&["a"]), vec![0.0, 1.0]).unwrap();
        assert_eq!(any.mismatched_estimator(&recorded(&["epipolar-ray"])), None);
        assert_eq!(any.mismatched_estimator(&recorded(&["a", "b"])), Some("b"), "two estimators share no bins");
    }

    #[test]
    fn thirds_hold_a_third_each_and_merge_ties() {
        let values: Vec<f64> = (0..9).map(|n| 0.1 * f64::from(n) + 0.05).collect();
        let bins = OverlapBins::thirds(&values, "epipolar-ray");
        let named: Vec<&str> = values.iter().filter_map(|value| bins.name_of(*value)).collect();
        assert_eq!(["low", "middle", "high"].map(|bin| named.iter().filter(|name| **name == bin).count()), [3, 3, 3]);
        assert_eq!(
            (bins.name_of(0.05), bins.name_of(0.85), bins.estimator()),
            (Some("low"), Some("high"), Some("epipolar-ray"))
        );
        assert_eq!(OverlapBins::thirds(&[0.5; 7], "x").names(), ["low", "high"]);
        assert_eq!(OverlapBins::thirds(&[1.0; 7], "x").names(), ["all"]);
        assert_eq!(OverlapBins::thirds(&[], "x").names().len(), 3);
    }

    #[test]
    fn rejects_invalid_names_and_edges() {
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        for (names, edges) in [
            (names(&[]), vec![0.0]),
            (names(&["a"]), vec![0.0]),
            (names(&["a"]), vec![0.5, 0.5]),
            (names(&["a"]), vec![0.5, 0.1]),
            (names(&["a"]), vec![0.0, f64::INFINITY]),
            (names(&["a"]), vec![f64::NAN, 1.0]),
            (names(&["a", "a"]), vec![0.0, 0.5, 1.0]),
            (names(&[""]), vec![0.0, 0.5]),
        ] {
            assert!(OverlapBins::new(BinRule::Strict, names.clone(), edges.clone()).is_err(), "{names:?} {edges:?}");
        }
    }

    #[test]
    fn a_single_published_bin_ignores_values_below_it() {
        let bins = OverlapBins::new(BinRule::Published, vec!["only".to_owned()], vec![0.2, 0.4]).unwrap();
        assert_eq!([0.1, 0.3, 0.5].map(|o| bins.place(o)), [BinPlace::Below, BinPlace::Bin(0), BinPlace::Above]);
    }

    #[test]
    fn validates_toml() {
        let good = "rule = \"strict\"\nnames = [\"low\", \"high\"]\nedges = [0.0, 0.5, 1.0]";
        let bins: OverlapBins = toml::from_str(good).unwrap();
        assert_eq!(bins.name_of(0.75), Some("high"));
        assert!(toml::from_str::<OverlapBins>(&good.replace("0.5", "5.0")).is_err());
        assert!(toml::from_str::<OverlapBins>(&format!("{good}\nextra = 1")).is_err());
    }

    proptest! {
        #[test]
        fn the_rules_differ_only_below_the_first_edge(overlap in -1.0f64..2.0) {
            let published = OverlapBins::noposplat(BinRule::Published);
            let same = published.place(overlap) == published.with_rule(BinRule::Strict).place(overlap);
            prop_assert_eq!(same, overlap >= 0.05);
        }
    }
}
