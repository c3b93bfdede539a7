//! Overlaps of an index that are not known to be those of a preset's bins.

use super::foreign_entries::ForeignEntries;
use super::mismatch::{IndexMismatch, Rule, of_rule};
use crate::{EvaluationIndex, Preset};

/// The kind of entries for which no overlap is binned.
const OTHER_ESTIMATOR: &str = "entries whose overlap was measured otherwise than the bins require, which stay empty";

impl Preset {
    /// Entries of `index`, which is none of the published ones, whose overlap is not known to be by the estimator of the preset's
    /// bins. `estimators` are those of the whole index, of which `index` may be a part: one other keeps the bins empty.
    pub fn foreign_overlaps(&self, index: &EvaluationIndex, estimators: &[String]) -> Option<IndexMismatch> {
        let bins = self.overlap_bins.as_ref()?;
        let expected = bins.estimator().or(estimators.first().map(String::as_str))?;
        let has_other = bins.mismatched_estimator(estimators).is_some();
        // Bins of no stated estimator are for any overlaps of one.
        if !has_other && bins.estimator().is_none() {
            return None;
        }
        let kind = if has_other { OTHER_ESTIMATOR.to_owned() } else { ForeignEntries::UnknownEstimator.to_string() };
        let rule: Rule<'_> = (&kind, &|entry| {
            let found = entry.overlap.as_ref()?.estimator.as_deref();
            let wrong = if has_other { found.is_some_and(|found| found != expected) } else { found.is_none() };
            wrong.then(|| format!("field overlap_estimator: expected {expected}, found {}", found.unwrap_or("none")))
        });
        of_rule(index, &rule)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(preset: &Preset, json: &str) -> Option<(u64, String)> {
        let index = EvaluationIndex::from_json(json.as_bytes()).unwrap();
        let found = preset.foreign_overlaps(&index, &index.overlap_estimators())?;
        Some((found.count, format!("{}: {}", found.kind, found.example)))
    }

    const UNKNOWN: &str = r#"{"context": [0, 9], "target": [3, 4, 5], "overlap": 0.2}"#;

    fn measured_by(estimator: &str) -> String {
        UNKNOWN.replace("0.2", &format!(r#"0.3, "overlap_estimator": "{estimator}""#))
    }

    #[test]
    fn overlaps_of_unknown_origin_are_counted() {
        let preset = Preset::named("re10k-overlap").unwrap();
        let (none, roma) = (r#"{"context": [0, 9], "target": [3, 4, 5]}"#, measured_by("roma"));
        let json = format!(r#"{{"a": [{roma}, {UNKNOWN}], "b": {none}, "c": {UNKNOWN}}}"#);
        let example = "scene a, entry 1, field overlap_estimator: expected roma, found none";
        assert_eq!(found(&preset, &json), Some((2, format!("{}: {example}", ForeignEntries::UnknownEstimator))));
        assert_eq!(found(&preset, &format!(r#"{{"a": {roma}, "b": {none}}}"#)), None);
        assert_eq!(found(&Preset::named("re10k-2v-256").unwrap(), &json), None, "without bins");
    }

    /// One is enough: no overlap of the index is binned then, and nothing is said of unknown ones.
    #[test]
    fn overlaps_of_another_estimator_are_counted() {
        let preset = Preset::named("re10k-overlap").unwrap();
        let other = measured_by("epipolar-ray");
        let json = format!(r#"{{"a": {UNKNOWN}, "b": [{}, {other}], "c": {other}}}"#, measured_by("roma"));
        let example = "scene b, entry 1, field overlap_estimator: expected roma, found epipolar-ray";
        assert_eq!(found(&preset, &json), Some((2, format!("{OTHER_ESTIMATOR}: {example}"))));
        let index = EvaluationIndex::from_json(format!(r#"{{"a": {UNKNOWN}}}"#).as_bytes()).unwrap();
        assert_eq!(preset.foreign_overlaps(&index, &["epipolar-ray".to_owned()]), None, "a shard without them");
    }

    #[test]
    fn bins_without_an_estimator_are_for_any() {
        let mut preset = Preset::named("re10k-overlap").unwrap();
        preset.overlap_bins = preset.overlap_bins.map(crate::OverlapBins::without_estimator);
        assert_eq!(found(&preset, &format!(r#"{{"a": {UNKNOWN}, "b": {}}}"#, measured_by("roma"))), None);
        let json = format!(r#"{{"a": {}, "b": {}}}"#, measured_by("depth-covisibility"), measured_by("roma"));
        let example = "scene b, entry 0, field overlap_estimator: expected depth-covisibility, found roma";
        assert_eq!(found(&preset, &json), Some((1, format!("{OTHER_ESTIMATOR}: {example}"))));
    }
}
