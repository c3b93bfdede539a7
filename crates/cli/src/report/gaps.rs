//! What a results store is missing: everything that makes `run --strict` fail.

use std::collections::{BTreeMap, BTreeSet};

use atsplat_eval::runner::{DROPPED_BY_SPLIT, MISSING_SCENES, NOT_SAMPLED};
use atsplat_eval::store::Unfinished;
use atsplat_eval::{Results, TargetStatus};
use atsplat_report::table::Source;

/// A kind of gap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Gap {
    MissingScenes,
    /// Scenes or frames of the data, of this kind.
    NotSampled(&'static str),
    DroppedBySplit,
    Unfinished,
    Skipped,
    Incomplete,
    NonFinite,
    Undrawn,
}

/// How often each gap occurs under a protocol, and its first case. An empty method means all methods.
type Counts<'a> = BTreeMap<(&'a str, &'a str, Gap), (u64, String)>;

/// One line for each gap, by protocol and method.
pub(super) fn gaps_in(Source { label, results }: &Source<'_>) -> Vec<String> {
    let line = |((preset, method, gap), (count, first)): ((&str, &str, Gap), (u64, String))| {
        format!("{label}: {preset}: {}: {first}", gap.text(count, method))
    };
    counts(results, &results.interrupted()).into_iter().map(line).collect()
}

fn counts<'a>(results: &'a Results, interrupted: &'a [Unfinished]) -> Counts<'a> {
    let mut counts = Counts::new();
    let mut add = |at, count: u64, first: String| counts.entry(at).or_insert((0, first)).0 += count;
    let provenance = &results.provenance;
    for warning in &provenance.warnings {
        let gap = match warning.kind.as_str() {
            MISSING_SCENES => Gap::MissingScenes,
            kind if kind.starts_with(DROPPED_BY_SPLIT) => Gap::DroppedBySplit,
            kind => match NOT_SAMPLED.into_iter().find(|of| kind.starts_with(of)) {
                Some(kind) => Gap::NotSampled(kind),
                None => continue,
            },
        };
        add((warning.preset.as_str(), "", gap), warning.count, warning.example.clone());
    }
    for Unfinished { preset, method, entries, total, .. } in interrupted {
        let at = (preset.as_str(), method.as_str(), Gap::Unfinished);
        add(at, total - entries, format!("{entries} of {total} index entries"));
    }
    // Methods with other poses may give other reasons for one entry.
    let mut seen = BTreeSet::new();
    for entry in provenance.skipped.iter().filter(|entry| seen.insert((&entry.preset, &entry.scene, entry.entry))) {
        let first = format!("scene {}, entry {}: {}: {}", entry.scene, entry.entry, entry.reason, entry.detail);
        // Methods with the same poses skip the same entries: the first is named.
        let method = entry.methods.first().map_or("", String::as_str);
        add((entry.preset.as_str(), method, Gap::Skipped), 1, first);
    }
    for trial in &results.trials {
        let at = |gap| (trial.key.preset.as_str(), trial.key.method.as_str(), gap);
        let scene = &trial.key.scene;
        if trial.status.is_incomplete() {
            let (status, reason) = (trial.status.name(), trial.detail.as_deref().unwrap_or("no reason recorded"));
            add(at(Gap::Incomplete), 1, format!("{scene} {status}: {reason}"));
        }
        if trial.draws_nothing() {
            add(at(Gap::Undrawn), 1, format!("scene {scene}, entry {}", trial.key.entry));
        }
    }
    for target in results.targets.iter().filter(|target| target.status == TargetStatus::NonFinite) {
        let at = (target.key.preset.as_str(), target.key.method.as_str(), Gap::NonFinite);
        let reason = target.detail.as_deref().unwrap_or("no reason recorded");
        add(at, 1, format!("scene {}, frame {}: {reason}", target.key.scene, target.frame));
    }
    counts
}

impl Gap {
    /// The count, and what is counted.
    fn text(self, count: u64, method: &str) -> String {
        let one = count == 1;
        let [scenes, entries, trials, targets] =
            if one { ["scene", "entry", "trial", "target"] } else { ["scenes", "entries", "trials", "targets"] };
        let [are, have, draw] = if one { ["is", "has", "draws"] } else { ["are", "have", "draw"] };
        match self {
            Self::MissingScenes => format!("{count} {scenes} of the index {are} not in the data"),
            Self::NotSampled(kind) => format!("{count} {kind}"),
            Self::Unfinished => format!("the run of {method} is unfinished"),
            Self::DroppedBySplit => {
                format!("{count} {entries} of the published index {are} dropped by the split derived from it")
            }
            Self::Skipped => {
                let of = if method.is_empty() { String::new() } else { format!(" for {method}") };
                format!("{count} index {entries} {} skipped{of}", if one { "was" } else { "were" })
            }
            Self::Incomplete => format!("{count} {trials} of {method} {are} incomplete"),
            Self::NonFinite => format!("{count} {targets} of {method} {have} NaN or infinite samples"),
            Self::Undrawn => format!("{count} {trials} of {method} {draw} no Gaussian in any target"),
        }
    }
}

#[cfg(test)]
mod tests {
    use atsplat_eval::{MethodRecord, PresetRecord, TrialRow, WarningCount};
    use serde_json::json;

    use super::*;

    fn trial(method: &str, scene: &str) -> TrialRow {
        serde_json::from_value(json!({
            "preset": "p", "method": method, "scene": scene, "entry": 0, "trial_hash": "", "pose_hash": "",
            "status": "done", "context": [0, 2], "targets": 1, "width": 8, "height": 8, "effects": [], "notes": [],
        }))
        .unwrap()
    }

    #[test]
    fn entries_that_a_derived_split_drops_are_gaps() {
        let warning = |kind: String, count, example: &str| WarningCount {
            preset: "p".to_owned(),
            kind,
            count,
            example: example.to_owned(),
        };
        let mut results = Results::default();
        results.provenance.warnings = vec![
            warning(format!("{DROPPED_BY_SPLIT}: scene too short"), 2, "short"),
            warning("entries with a target twice".to_owned(), 5, "a"),
        ];
        let lines = gaps_in(&Source { label: "run", results: &results });
        assert_eq!(lines, ["run: p: 2 entries of the published index are dropped by the split derived from it: short"]);
    }

    #[test]
    fn what_is_not_sampled_is_a_gap() {
        let warning = |kind: &str, count, example: &str| WarningCount {
            preset: "p".to_owned(),
            kind: kind.to_owned(),
            count,
            example: example.to_owned(),
        };
        let mut results = Results::default();
        results.provenance.warnings = vec![
            warning("frames without an image, which are not sampled", 15, "rule"),
            warning("sampled entries rejected for their overlap", 3, "rule"),
            warning("scenes that are not read, and not sampled: ignored-scene", 1, "b: holds images"),
            warning("scenes that are not read, and not sampled: unreadable-scene", 2, "c: cut off"),
            warning("scenes without an entry in the sampled index", 1, "d, …: 1 unreadable"),
        ];
        let expected = [
            "run: p: 15 frames without an image, which are not sampled: rule",
            "run: p: 3 scenes that are not read, and not sampled: b: holds images",
            "run: p: 1 scenes without an entry in the sampled index: d, …: 1 unreadable",
        ];
        assert_eq!(gaps_in(&Source { label: "run", results: &results }), expected);
    }

    /// Killed after two of three entries under the second method; the third was never requested under this protocol.
    #[test]
    fn a_killed_run_is_a_gap() {
        let method = |name: &str| MethodRecord { name: name.to_owned(), ..MethodRecord::default() };
        let mut results = Results::default();
        results.provenance.presets = vec![PresetRecord { name: "p".to_owned(), entries: 3, ..PresetRecord::default() }];
        results.provenance.methods = ["first", "second", "third"].map(method).to_vec();
        let rows = [("first", "a"), ("first", "b"), ("first", "c"), ("second", "a"), ("second", "b")];
        results.trials = rows.map(|(method, scene)| trial(method, scene)).to_vec();
        let lines = |results: &Results| gaps_in(&Source { label: "run", results });
        assert_eq!(lines(&results), ["run: p: the run of second is unfinished: 2 of 3 index entries"]);
        results.trials.push(trial("second", "c"));
        assert_eq!(lines(&results), [""; 0]);
    }
}
