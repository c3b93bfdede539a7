//! What results are missing: everything that makes a run incomplete, and `--strict` fail.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use atsplat_numeric::counted;
use atsplat_protocol::ForeignEntries;

use crate::times::TimingRow;
use crate::{MethodRecord, Results, RunWarning, TargetStatus, TrialKey, TrialRow, TrialStatus};

/// Something that results are missing, with all its cases under one protocol and method.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Gap {
    /// The protocol.
    pub preset: String,
    /// The method; `None` if all methods of the protocol miss it.
    pub method: Option<String>,
    /// What is missing.
    pub kind: GapKind,
    /// Number of cases.
    pub count: u64,
    /// The first case.
    pub first: String,
}

/// A kind of gap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum GapKind {
    /// Shards of the run.
    MissingShards,
    /// Scenes of the index that the data lack.
    MissingScenes,
    /// Scenes or frames of the data that a sampled index leaves out, of this kind.
    NotSampled(RunWarning),
    /// Entries of a published index that the split derived from it drops.
    DroppedBySplit,
    /// Entries of an index that is none of the protocol's own, of this kind, which the protocol does not have.
    ForeignEntries(ForeignEntries),
    /// Index entries that an interrupted run has not reached, or without a metric that others have.
    Unfinished,
    /// Index entries without a trial.
    Skipped,
    /// Trials that failed or have failed targets, or failed when they were evaluated again.
    Incomplete,
    /// Targets with samples that are NaN or infinite.
    NonFinite,
    /// Trials of whose Gaussians none contributes to any target's render.
    EmptyRender,
    /// Trials that were evaluated and failed in the timing pass, of a method without any time under the protocol.
    Untimed,
}

impl Results {
    /// What is missing, by protocol, method and kind, including the other shards of a run. Without a gap, every entry of every index
    /// was evaluated without failures and shows something; sampled indices have all scenes and frames of the data. Trials that their
    /// method does not support are not gaps.
    pub fn gaps(&self) -> Vec<Gap> {
        let mut gaps = BTreeMap::new();
        let mut add = |preset: &str, method: Option<&str>, kind, count, first| {
            let key = (preset.to_owned(), method.map(str::to_owned), kind);
            gaps.entry(key).or_insert((0, first)).0 += count;
        };
        if let Some((part, shard)) = self.provenance.part().zip(self.provenance.shard) {
            let missing = u64::from(shard.count).saturating_sub(self.provenance.shards().len() as u64);
            // None is missing where all were merged, but one was not done.
            for preset in self.provenance.presets.iter().filter(|_| missing > 0) {
                add(&preset.name, None, GapKind::MissingShards, missing, part.clone());
            }
        }
        for warning in &self.provenance.warnings {
            if let Some((kind, method)) = gap_of_warning(&warning.kind) {
                add(&warning.preset, method, kind, warning.count, warning.example.clone());
            }
        }
        for run in self.cut_off() {
            let lacking = run.lacking.as_ref().map_or_else(String::new, |metric| format!(" with {metric}"));
            let first = format!("{} of {} index entries{lacking}", run.entries, run.total);
            add(&run.preset, Some(&run.method), GapKind::Unfinished, run.total - run.entries, first);
        }
        // Methods with other poses may give other reasons for one entry.
        let mut seen = BTreeSet::new();
        for entry in &self.provenance.skipped {
            if seen.insert((&entry.preset, &entry.scene, entry.entry)) {
                let first = format!("scene {}, entry {}: {}: {}", entry.scene, entry.entry, entry.reason, entry.detail);
                // Methods with the same poses skip the same entries: the first is named.
                add(&entry.preset, entry.methods.first().map(String::as_str), GapKind::Skipped, 1, first);
            }
        }
        for trial in &self.trials {
            let key = &trial.key;
            if trial.status.is_incomplete() {
                let first = format!("{} {}: {}", key.scene, trial.status.name(), reason(trial.detail.as_deref()));
                add(&key.preset, Some(&key.method), GapKind::Incomplete, 1, first);
            }
            if trial.renders_nothing() {
                let first = format!("scene {}, entry {}", key.scene, key.entry);
                add(&key.preset, Some(&key.method), GapKind::EmptyRender, 1, first);
            }
        }
        for target in self.targets.iter().filter(|target| target.status == TargetStatus::NonFinite) {
            let key = &target.key;
            let first = format!("scene {}, frame {}: {}", key.scene, target.frame, reason(target.detail.as_deref()));
            add(&key.preset, Some(&key.method), GapKind::NonFinite, 1, first);
        }
        for row in self.timings.iter().filter(|row| self.has_failed_to_be_timed(row)) {
            let first = format!("scene {}, entry {}: {}", row.key.scene, row.key.entry, reason(row.detail.as_deref()));
            add(&row.key.preset, Some(&row.key.method), GapKind::Untimed, 1, first);
        }
        let gap = |((preset, method, kind), (count, first))| Gap { preset, method, kind, count, first };
        gaps.into_iter().map(gap).collect()
    }
}

impl Results {
    /// Whether a row says why a method that evaluates and can be timed has no times.
    fn has_failed_to_be_timed(&self, row: &TimingRow) -> bool {
        let is_same_run = |key: &TrialKey| (&key.preset, &key.method) == (&row.key.preset, &row.key.method);
        let is_evaluated =
            |trial: &TrialRow| trial.key == row.key && matches!(trial.status, TrialStatus::Done | TrialStatus::Partial);
        !row.is_timed()
            && !self.provenance.method(&row.key.method).is_some_and(MethodRecord::has_finished_images)
            && !self.timings.iter().any(|other| other.is_timed() && is_same_run(&other.key))
            && self.trials.iter().any(is_evaluated)
    }
}

/// The gap that a warning of a run is about, if it is about one, and the method if it is about a method.
fn gap_of_warning(kind: &str) -> Option<(GapKind, Option<&str>)> {
    if let Some(foreign) = ForeignEntries::of(kind) {
        return Some((GapKind::ForeignEntries(foreign), None));
    }
    let (known, subject) = RunWarning::of(kind)?;
    match known {
        RunWarning::MissingScenes => Some((GapKind::MissingScenes, None)),
        RunWarning::DroppedBySplit => Some((GapKind::DroppedBySplit, None)),
        RunWarning::FailedAgain => Some((GapKind::Incomplete, subject)),
        RunWarning::WithoutImage | RunWarning::UnreadableImage | RunWarning::NotRead | RunWarning::WithoutEntry => {
            Some((GapKind::NotSampled(known), None))
        }
        RunWarning::UnlistedSettings
        | RunWarning::SettingsNotChosen
        | RunWarning::UnpublishedWeights
        | RunWarning::SharedFiles
        | RunWarning::OtherData
        | RunWarning::OtherFolder => None,
    }
}

fn reason(detail: Option<&str>) -> &str {
    detail.unwrap_or("no reason recorded")
}

impl fmt::Display for Gap {
    /// The protocol, the count, what is counted, and the first case.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { preset, method, kind, count, first } = self;
        let [shards, scenes, entries, trials, targets] =
            ["shard", "scene", "entry", "trial", "target"].map(|what| counted(*count, what));
        let [are, were, have, render] =
            if *count == 1 { ["is", "was", "has", "renders"] } else { ["are", "were", "have", "render"] };
        let of_method = method.as_ref().map_or_else(String::new, |method| format!(" of {method}"));
        write!(f, "{preset}: ")?;
        match kind {
            GapKind::MissingShards => return write!(f, "{shards} of the run {are} missing: this is {first}"),
            GapKind::MissingScenes => write!(f, "{scenes} of the index {are} not in the data"),
            GapKind::NotSampled(kind) => write!(f, "{count} {kind}"),
            GapKind::ForeignEntries(kind) => write!(f, "{count} {kind}"),
            GapKind::DroppedBySplit => {
                write!(f, "{entries} of the published index {are} dropped by the split derived from it")
            }
            GapKind::Unfinished => write!(f, "the run{of_method} is unfinished"),
            GapKind::Skipped => {
                let methods = method.as_ref().map_or_else(String::new, |method| format!(" for {method}"));
                write!(f, "{} {were} skipped{methods}", counted(*count, "index entry"))
            }
            GapKind::Incomplete => write!(f, "{trials}{of_method} {are} incomplete"),
            GapKind::NonFinite => write!(f, "{targets}{of_method} {have} NaN or infinite samples"),
            GapKind::EmptyRender => write!(f, "{trials}{of_method} {render} no Gaussian in any target"),
            GapKind::Untimed => {
                write!(f, "{trials}{of_method} {have} no times, because they failed in the timing pass")
            }
        }?;
        write!(f, ": {first}")
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::sample_rows::timing;
    use crate::{PresetRecord, SkippedEntry, WarningCount};

    fn trial(method: &str, scene: &str) -> TrialRow {
        serde_json::from_value(json!({
            "preset": "p", "method": method, "scene": scene, "entry": 0, "trial_hash": "", "pose_hash": "",
            "status": "done", "context": [0, 2], "targets": 1, "width": 8, "height": 8, "effects": [], "notes": [],
        }))
        .unwrap()
    }

    fn warning(kind: &str, count: u64, example: &str) -> WarningCount {
        WarningCount { preset: "p".to_owned(), kind: kind.to_owned(), count, example: example.to_owned() }
    }

    fn lines(results: &Results) -> Vec<String> {
        results.gaps().iter().map(Gap::to_string).collect()
    }

    #[test]
    fn entries_that_a_derived_split_drops_are_gaps() {
        let mut results = Results::default();
        results.provenance.warnings = vec![
            warning(&RunWarning::DroppedBySplit.about("scene too short"), 2, "short"),
            warning("entries with a target twice", 5, "a"),
        ];
        assert_eq!(
            lines(&results),
            ["p: 2 entries of the published index are dropped by the split derived from it: short"]
        );
    }

    #[test]
    fn what_is_not_sampled_is_a_gap() {
        let mut results = Results::default();
        results.provenance.warnings = vec![
            warning("frames without an image, which are not sampled", 15, "rule"),
            warning("sampled entries rejected for their overlap", 3, "rule"),
            warning("scenes that are not read, and not sampled: ignored-scene", 1, "b: holds images"),
            warning("scenes that are not read, and not sampled: unreadable-scene", 2, "c: cut off"),
            warning("scenes without an entry in the sampled index", 1, "d, …: 1 unreadable"),
        ];
        let expected = [
            "p: 15 frames without an image, which are not sampled: rule",
            "p: 3 scenes that are not read, and not sampled: b: holds images",
            "p: 1 scenes without an entry in the sampled index: d, …: 1 unreadable",
        ];
        assert_eq!(lines(&results), expected);
    }

    /// An index of other targets than the protocol's. Another number of them is a warning, and so are other context views.
    #[test]
    fn targets_on_the_wrong_side_of_the_window_are_a_gap() {
        let mut results = Results::default();
        let misplaced = [
            "entries whose targets are all context frames",
            "entries with every target outside the window, under a protocol of targets inside it",
            "entries with targets inside the window, under a protocol of targets outside it",
        ];
        results.provenance.warnings = misplaced.map(|kind| warning(kind, 2, "scene a, entry 1")).to_vec();
        results.provenance.warnings.push(warning("entries without the preset's 3 targets", 4, "scene b, entry 0"));
        assert_eq!(lines(&results), misplaced.map(|kind| format!("p: 2 {kind}: scene a, entry 1")));
    }

    #[test]
    fn overlaps_of_unknown_origin_in_bins_are_a_gap() {
        let mut results = Results::default();
        let kind = "entries whose overlap does not say how it was measured, under bins of one estimator";
        results.provenance.warnings = vec![warning(kind, 3, "scene a, entry 1")];
        assert_eq!(lines(&results), [format!("p: 3 {kind}: scene a, entry 1")]);
    }

    /// Its rows are whole, but lack what it should have been evaluated again for.
    #[test]
    fn what_failed_when_it_was_evaluated_again_is_a_gap() {
        let mut results = Results::default();
        results.provenance.warnings = vec![warning(&RunWarning::FailedAgain.about("mine"), 2, "a: out of memory")];
        assert_eq!(lines(&results), ["p: 2 trials of mine are incomplete: a: out of memory"]);
        let mut counts = crate::RunCounts::default();
        counts.add_totals(&results);
        assert_eq!(counts.incomplete, 2);
    }

    fn preset(name: &str) -> PresetRecord {
        PresetRecord { name: name.to_owned(), entries: 3, ..PresetRecord::default() }
    }

    fn method(name: &str) -> MethodRecord {
        MethodRecord { name: name.to_owned(), ..MethodRecord::default() }
    }

    /// Under the first protocol no trial could be timed, under the second one could. The other methods cannot be timed: the first
    /// imports images, the second does not support the trial, whose evaluation says so.
    #[test]
    fn a_method_that_fails_in_the_timing_pass_is_a_gap() {
        let mut results = Results::default();
        let imported = MethodRecord { kind: "renders".to_owned(), ..method("imported") };
        results.provenance.methods = vec![method("mine"), imported, method("another")];
        results.trials = ["mine", "imported", "another"].map(|name| trial(name, "a")).to_vec();
        results.trials[2].status = TrialStatus::NotApplicable;
        let of_second = TrialRow {
            key: TrialKey { preset: "q".to_owned(), ..results.trials[0].key.clone() },
            ..trial("mine", "a")
        };
        results.trials.push(of_second);
        let failed = |row: &TrialRow| TimingRow {
            key: row.key.clone(),
            detail: Some("it ended with exit status: 9".to_owned()),
            ..timing("", "", &[], &[])
        };
        results.timings = results.trials.iter().map(failed).collect();
        let of_another_scene = TrialKey { scene: "b".to_owned(), ..results.trials[3].key.clone() };
        results.timings.push(TimingRow { key: of_another_scene, ..timing("", "", &[], &[1.0]) });
        let expected = "p: 1 trial of mine has no times, because they failed in the timing pass: scene a, entry 0: it ended with \
                        exit status: 9";
        assert_eq!(lines(&results), [expected]);
    }

    /// Killed after two of three entries under the second method, so that the third has no row anywhere.
    #[test]
    fn a_killed_run_is_a_gap() {
        let mut results = Results::default();
        results.provenance.presets = vec![preset("p")];
        results.provenance.methods = ["first", "second", "third"].map(method).to_vec();
        let rows = [("first", "a"), ("first", "b"), ("first", "c"), ("second", "a"), ("second", "b")];
        results.trials = rows.map(|(method, scene)| trial(method, scene)).to_vec();
        let of_third = "p: the run of third is unfinished: 0 of 3 index entries";
        assert_eq!(lines(&results), ["p: the run of second is unfinished: 2 of 3 index entries", of_third]);
        results.trials.push(trial("second", "c"));
        assert_eq!(lines(&results), [of_third]);
        results.trials.extend(["a", "b", "c"].map(|scene| trial("third", scene)));
        assert_eq!(lines(&results), [""; 0]);
    }

    /// Killed between two protocols: the second has no row of any method.
    #[test]
    fn a_protocol_that_a_killed_run_has_not_reached_is_a_gap() {
        let mut results = Results::default();
        results.provenance.presets = ["p", "q"].map(preset).to_vec();
        results.provenance.methods = vec![method("m")];
        results.trials = ["a", "b", "c"].map(|scene| trial("m", scene)).to_vec();
        assert_eq!(lines(&results), ["q: the run of m is unfinished: 0 of 3 index entries"]);
        // A reason for each of its entries ends it.
        let skipped = ["a", "b", "c"].map(|scene| SkippedEntry {
            preset: "q".to_owned(),
            scene: scene.to_owned(),
            ..SkippedEntry::default()
        });
        results.provenance.skipped = skipped[..2].to_vec();
        assert!(lines(&results).contains(&"q: the run of m is unfinished: 2 of 3 index entries".to_owned()));
        results.provenance.skipped = skipped.to_vec();
        assert!(results.gaps().iter().all(|gap| gap.kind == GapKind::Skipped), "{:?}", lines(&results));
    }

    /// Of three methods, one was run under the first protocol and one under the second; the third has no entry that it could use.
    #[test]
    fn methods_that_were_not_requested_under_a_protocol_are_not_gaps() {
        let mut results = Results::default();
        results.provenance.presets = ["p", "q"].map(preset).to_vec();
        results.provenance.methods = ["m", "n", "o"].map(method).to_vec();
        results.trials = ["a", "b", "c"].map(|scene| trial("m", scene)).to_vec();
        let of_n = ["a", "b", "c"].map(|scene| {
            let row = trial("n", scene);
            TrialRow { key: TrialKey { preset: "q".to_owned(), ..row.key.clone() }, ..row }
        });
        results.trials.extend(of_n);
        let skipped = ["a", "b", "c"].map(|scene| SkippedEntry {
            preset: "q".to_owned(),
            scene: scene.to_owned(),
            methods: ["o".to_owned()].into(),
            ..SkippedEntry::default()
        });
        results.provenance.skipped = skipped.to_vec();
        assert!(results.gaps().iter().all(|gap| gap.kind == GapKind::Skipped), "{:?}", lines(&results));
        // Without these reasons, the third was killed before its first row.
        results.provenance.skipped.clear();
        let expected = ["p", "q"].map(|preset| format!("{preset}: the run of o is unfinished: 0 of 3 index entries"));
        assert_eq!(lines(&results), expected);
    }
}
