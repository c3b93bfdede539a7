//! What a results store lacks.

use std::collections::{BTreeMap, BTreeSet};

use atsplat_eval::runner::MISSING_SCENES;
use atsplat_eval::{Results, TargetStatus};
use atsplat_report::table::Source;

/// Something that a store lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Lack {
    MissingScenes,
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
    counts(results).into_iter().map(line).collect()
}

fn counts(results: &Results) -> Counts<'_> {
    let mut counts = Counts::new();
    let mut add = |at, count: u64, first: String| counts.entry(at).or_insert((0, first)).0 += count;
    let provenance = &results.provenance;
    for warning in provenance.warnings.iter().filter(|warning| warning.kind == MISSING_SCENES) {
        add((warning.preset.as_str(), "", Lack::MissingScenes), warning.count, warning.example.clone());
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
