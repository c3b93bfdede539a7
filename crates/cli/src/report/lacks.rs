//! What a results store lacks.

use std::collections::{BTreeMap, BTreeSet};

use atsplat_eval::runner::{DROPPED_BY_SPLIT, MISSING_SCENES, NOT_SAMPLED};
use atsplat_eval::store::Unfinished;
use atsplat_eval::{Results, TargetStatus};
use atsplat_report::table::Source;

/// Something that a store lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Lack {
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

/// How often something is lacking under a protocol, and the first case; the method is empty where it is of all methods.
type Counts<'a> = BTreeMap<(&'a str, &'a str, Lack), (u64, String)>;

/// A line for everything that makes `run --strict` exit with another code than 0, by protocol and method.
pub(super) fn of(Source { label, results }: &Source<'_>) -> Vec<String> {
    let line = |((preset, method, lack), (count, first)): ((&str, &str, Lack), (u64, String))| {
        format!("{label}: {preset}: {}: {first}", lack.text(count, method))
    };
    counts(results, &results.interrupted()).into_iter().map(line).collect()
}

fn counts<'a>(results: &'a Results, interrupted: &'a [Unfinished]) -> Counts<'a> {
    let mut counts = Counts::new();
    let mut add = |at, count: u64, first: String| counts.entry(at).or_insert((0, first)).0 += count;
    let provenance = &results.provenance;
    for warning in &provenance.warnings {
        let lack = match warning.kind.as_str() {
            MISSING_SCENES => Lack::MissingScenes,
            kind if kind.starts_with(DROPPED_BY_SPLIT) => Lack::DroppedBySplit,
            kind => match NOT_SAMPLED.into_iter().find(|of| kind.starts_with(of)) {
                Some(kind) => Lack::NotSampled(kind),
                None => continue,
            },
        };
        add((warning.preset.as_str(), "", lack), warning.count, warning.example.clone());
    }
    for Unfinished { preset, method, entries, of, .. } in interrupted {
        let at = (preset.as_str(), method.as_str(), Lack::Unfinished);
        add(at, of - entries, format!("{entries} of {of} index entries"));
    }
    // Methods with other poses may give other reasons for one entry.
    let mut seen = BTreeSet::new();
    for entry in provenance.skipped.iter().filter(|entry| seen.insert((&entry.preset, &entry.scene, entry.entry))) {
        let first = format!("scene {}, entry {}: {}: {}", entry.scene, entry.entry, entry.reason, entry.detail);
        // Of several, the first stands for those that share its poses.
        let method = entry.methods.first().map_or("", String::as_str);
        add((entry.preset.as_str(), method, Lack::Skipped), 1, first);
    }
    for trial in &results.trials {
        let at = |lack| (trial.key.preset.as_str(), trial.key.method.as_str(), lack);
        let scene = &trial.key.scene;
        if trial.status.is_incomplete() {
            let (status, reason) = (trial.status.name(), trial.detail.as_deref().unwrap_or("no reason recorded"));
            add(at(Lack::Incomplete), 1, format!("{scene} {status}: {reason}"));
        }
        if trial.draws_nothing() {
            add(at(Lack::Undrawn), 1, format!("scene {scene}, entry {}", trial.key.entry));
        }
    }
    for target in results.targets.iter().filter(|target| target.status == TargetStatus::NonFinite) {
        let at = (target.key.preset.as_str(), target.key.method.as_str(), Lack::NonFinite);
        let reason = target.detail.as_deref().unwrap_or("no reason recorded");
        add(at, 1, format!("scene {}, frame {}: {reason}", target.key.scene, target.frame));
    }
    counts
}

impl Lack {
    /// The count, and what is counted.
    fn text(self, count: u64, method: &str) -> String {
        let one = count == 1;
        let [scenes, entries, trials, targets] =
            if one { ["scene", "entry", "trial", "target"] } else { ["scenes", "entries", "trials", "targets"] };
        let [are, have] = if one { ["is", "has"] } else { ["are", "have"] };
        match self {
            Self::MissingScenes => format!("{count} {scenes} of the index {are} not in the data"),
            Self::NotSampled(kind) => format!("{count} {kind}"),
            Self::Unfinished => format!("the run of {method} has not ended"),
            Self::DroppedBySplit => {
                format!("{count} {entries} of the published index {have} no place in the split derived from it")
            }
            Self::Skipped => {
                let of = if method.is_empty() { String::new() } else { format!(" for {method}") };
                format!("{count} index {entries} {} skipped{of}", if one { "was" } else { "were" })
            }
            Self::Incomplete => format!("{count} {trials} of {method} {are} incomplete"),
            Self::NonFinite => format!("{count} {targets} of {method} {have} samples that are no numbers"),
            Self::Undrawn => format!("{count} {trials} of {method} {have} no Gaussian in any target"),
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
    fn entries_that_a_derived_split_drops_are_lacking() {
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
        let lines = of(&Source { label: "run", results: &results });
        assert_eq!(
            lines,
            ["run: p: 2 entries of the published index have no place in the split derived from it: short"]
        );
    }

    #[test]
    fn what_is_not_sampled_is_lacking() {
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
        assert_eq!(of(&Source { label: "run", results: &results }), expected);
    }

    /// Killed after two of three entries under the second method; the third was never requested under this protocol.
    #[test]
    fn a_killed_run_is_lacking() {
        let method = |name: &str| MethodRecord { name: name.to_owned(), ..MethodRecord::default() };
        let mut results = Results::default();
        results.provenance.presets = vec![PresetRecord { name: "p".to_owned(), entries: 3, ..PresetRecord::default() }];
        results.provenance.methods = ["first", "second", "third"].map(method).to_vec();
        let rows = [("first", "a"), ("first", "b"), ("first", "c"), ("second", "a"), ("second", "b")];
        results.trials = rows.map(|(method, scene)| trial(method, scene)).to_vec();
        let lines = |results: &Results| of(&Source { label: "run", results });
        assert_eq!(lines(&results), ["run: p: the run of second has not ended: 2 of 3 index entries"]);
        results.trials.push(trial("second", "c"));
        assert_eq!(lines(&results), [""; 0]);
    }
}
