use std::collections::BTreeSet;
use std::fmt;

use serde::Serialize;

use super::display::phrase;
use crate::{EvaluationIndex, IndexEntry};

/// A comparison of two indices.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Comparability {
    /// Keys in both indices.
    pub common_keys: u64,
    /// Keys with entries in the first and in the second index.
    pub scenes: (u64, u64),
    /// Keys with entries in both.
    pub common_scenes: u64,
    /// Common scenes whose entries have the same context frames, in order, and the same targets.
    pub identical_scenes: u64,
    /// Common scenes whose entries have the same *sets* of context frames.
    pub same_context: u64,
    /// Common scenes whose entries have the same sets of targets.
    pub same_targets: u64,
    /// Identical scenes whose overlap values differ, so that bins may differ.
    pub other_overlap: u64,
    /// Whether results may share a table.
    #[serde(rename = "verdict")]
    pub table_sharing: TableSharing,
    /// The reasons for that, as text.
    pub reasons: Vec<String>,
}

/// Whether results on two indices may share a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TableSharing {
    /// They define the same trials.
    Same,
    /// Means over all scenes may share a table; overlap bins may not.
    SameButBins,
    /// Only means over the common scenes, recomputed, may share a table.
    OnCommonScenes,
    /// They define different trials.
    Different,
}

/// Compares two indices: whether results on `a` and `b` may share a table, and why.
pub fn compare(a: &EvaluationIndex, b: &EvaluationIndex) -> Comparability {
    let scenes_of = |index: &EvaluationIndex| index.scene_count() as u64;
    let common_keys = a.scenes.keys().filter(|key| b.scenes.contains_key(*key)).count() as u64;
    let mut result = Comparability {
        common_keys,
        scenes: (scenes_of(a), scenes_of(b)),
        common_scenes: 0,
        identical_scenes: 0,
        same_context: 0,
        same_targets: 0,
        other_overlap: 0,
        table_sharing: TableSharing::Different,
        reasons: Vec::new(),
    };
    for (key, ours) in &a.scenes {
        let Some(theirs) = b.scenes.get(key) else { continue };
        if ours.is_empty() || theirs.is_empty() {
            continue;
        }
        let identical = ours.len() == theirs.len() && ours.iter().zip(theirs).all(|(a, b)| same_trial(a, b));
        let other_overlap = identical && ours.iter().zip(theirs).any(|(a, b)| a.overlap != b.overlap);
        result.common_scenes += 1;
        result.identical_scenes += u64::from(identical);
        result.other_overlap += u64::from(other_overlap);
        result.same_context += u64::from(same_sets(ours, theirs, |entry| &entry.context));
        result.same_targets += u64::from(same_sets(ours, theirs, |entry| &entry.target));
    }
    result.table_sharing = table_sharing(&result);
    result.reasons = reasons(&result);
    result
}

/// The order of context frames matters: the first is the reference of relative poses.
fn same_trial(a: &IndexEntry, b: &IndexEntry) -> bool {
    let sorted = |frames: &[usize]| {
        let mut frames = frames.to_vec();
        frames.sort_unstable();
        frames
    };
    a.context == b.context && sorted(&a.target) == sorted(&b.target)
}

fn same_sets(a: &[IndexEntry], b: &[IndexEntry], frames: impl Fn(&IndexEntry) -> &Vec<usize>) -> bool {
    let set = |entry| frames(entry).iter().copied().collect::<BTreeSet<usize>>();
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| set(a) == set(b))
}

fn are_all_identical(found: &Comparability) -> bool {
    found.common_scenes > 0 && found.identical_scenes == found.common_scenes
}

fn table_sharing(found: &Comparability) -> TableSharing {
    let common = found.common_scenes;
    match (are_all_identical(found), found.scenes == (common, common), found.other_overlap) {
        (false, _, _) => TableSharing::Different,
        (true, false, _) => TableSharing::OnCommonScenes,
        (true, true, 0) => TableSharing::Same,
        (true, true, _) => TableSharing::SameButBins,
    }
}

fn reasons(found: &Comparability) -> Vec<String> {
    let common = found.common_scenes;
    let mut reasons = Vec::new();
    if common == 0 {
        reasons.push("no scene is in both".to_owned());
    }
    let others = [
        (common - found.same_context, "have other context frames"),
        (common - found.same_targets, "have other targets"),
    ];
    for (count, what) in others.into_iter().filter(|(count, _)| *count > 0) {
        reasons.push(format!("{count} of {common} common scenes {what}"));
    }
    if !are_all_identical(found) && reasons.is_empty() {
        let differ = common - found.identical_scenes;
        reasons.push(format!("{differ} of {common} common scenes differ in order or repeats"));
    }
    let only = [(found.scenes.0 - common, "first"), (found.scenes.1 - common, "second")];
    for (count, which) in only.into_iter().filter(|(count, _)| *count > 0 && common > 0) {
        reasons.push(format!("{} only in the {which}", phrase(count, ["scene is", "scenes are"])));
    }
    if found.other_overlap > 0 {
        let what = ["scene has another overlap", "scenes have another overlap"];
        reasons.push(phrase(found.other_overlap, what));
    }
    reasons
}

impl fmt::Display for TableSharing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Same => "results may share a table",
            Self::SameButBins => "means over all scenes may share a table, overlap bins may not",
            Self::OnCommonScenes => "results may share a table once both are averaged over the common scenes only",
            Self::Different => "results may not share a table",
        })
    }
}

impl fmt::Display for Comparability {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "scenes              {} and {}, {} in both", self.scenes.0, self.scenes.1, self.common_scenes)?;
        writeln!(f, "identical           {}", self.identical_scenes)?;
        writeln!(f, "same context        {}", self.same_context)?;
        writeln!(f, "same targets        {}", self.same_targets)?;
        writeln!(f, "verdict             {}", self.table_sharing)?;
        self.reasons.iter().try_for_each(|reason| writeln!(f, "                    {reason}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BASE: &str = r#"{"a": {"context": [0, 9], "target": [3, 4], "overlap": 0.5},
        "b": {"context": [1, 5], "target": [2]}, "c": null}"#;

    fn against_base(from: &str, to: &str) -> Comparability {
        let read = |json: &str| EvaluationIndex::from_json(json.as_bytes()).unwrap();
        assert!(BASE.contains(from), "{from}");
        compare(&read(BASE), &read(&BASE.replace(from, to)))
    }

    #[test]
    fn every_change_has_its_effect_on_tables_and_its_reason() {
        for (from, to, table_sharing, reason) in [
            ("[3, 4]", "[4, 3]", TableSharing::Same, ""),
            (", \"c\": null", "", TableSharing::Same, ""),
            ("0.5", "0.4", TableSharing::SameButBins, "1 scene has another overlap"),
            (
                "\"c\": null",
                "\"c\": {\"context\": [1], \"target\": [1]}",
                TableSharing::OnCommonScenes,
                "1 scene is only in the second",
            ),
            ("[0, 9]", "[9, 0]", TableSharing::Different, "1 of 2 common scenes differ in order or repeats"),
            ("[0, 9]", "[0, 8]", TableSharing::Different, "1 of 2 common scenes have other context frames"),
            ("[3, 4]", "[3, 5]", TableSharing::Different, "1 of 2 common scenes have other targets"),
        ] {
            let found = against_base(from, to);
            assert_eq!(found.table_sharing, table_sharing, "{from} to {to}");
            assert_eq!(found.reasons.concat(), reason, "{from} to {to}");
        }
    }

    #[test]
    fn compares_empty_and_partly_disjoint_indices() {
        let empty = EvaluationIndex::default();
        assert_eq!(compare(&empty, &empty).table_sharing, TableSharing::Different);
        let found = against_base("\"a\"", "\"z\"");
        assert_eq!((found.common_keys, found.common_scenes, found.table_sharing), (2, 1, TableSharing::OnCommonScenes));
    }

    #[test]
    fn comparison_is_symmetric() {
        for (from, to) in [("[0, 9]", "[0, 8]"), ("\"a\"", "\"z\""), ("0.5", "0.4")] {
            let read = |json: &str| EvaluationIndex::from_json(json.as_bytes()).unwrap();
            let (a, b) = (read(BASE), read(&BASE.replace(from, to)));
            let (there, back) = (compare(&a, &b), compare(&b, &a));
            assert_eq!((there.table_sharing, there.identical_scenes), (back.table_sharing, back.identical_scenes));
            assert_eq!(there.scenes, (back.scenes.1, back.scenes.0));
        }
    }
}
