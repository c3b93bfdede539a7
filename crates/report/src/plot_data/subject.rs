//! What a plot is about, in words for its heading, and what a reader must know of the means in it.

use std::collections::{BTreeMap, BTreeSet};

use atsplat_results::statistics::Leaked;
use atsplat_results::store::Unfinished;
use atsplat_results::{MethodRecord, PresetRecord, Results, TrialKey};

use crate::counted;
use crate::table::other_data;

/// A method's title, with its name if other methods of the results have the same title, as trainings of one network do; random
/// weights are named.
pub(crate) fn title_of(results: &Results, method: &MethodRecord) -> String {
    let twins = results.provenance.methods.iter().filter(|other| other.title == method.title).count();
    let name = if twins > 1 { format!(" ({})", method.name) } else { String::new() };
    let untrained = if method.untrained && !method.title.contains("untrained") { ", untrained" } else { "" };
    format!("{}{name}{untrained}", method.title)
}

/// Protocol, data and scenes: `RealEstate10K, 2 views (re10k-2v-256); 8 scenes, 8 of 7194 trials of the index`; data that are not
/// known to be those of the protocol's title are named after it.
pub(super) fn subject(results: &Results, preset: &PresetRecord) -> String {
    subject_over(results, preset, None)
}

/// The same for a plot of so many of the scenes: `6 of 8 scenes`.
pub(super) fn subject_over(results: &Results, preset: &PresetRecord, shown: Option<u64>) -> String {
    let all = scenes_of_trials(results, &preset.name).len() as u64;
    let scenes = match shown {
        Some(shown) if shown < all => format!("{shown} of {}", counted(all, "scene")),
        _ => counted(all, "scene"),
    };
    let part = if preset.entries < preset.entries_of_index {
        format!(", {} of {} trials of the index", preset.entries, preset.entries_of_index)
    } else {
        String::new()
    };
    let data = other_data(results, preset).map_or_else(String::new, |data| format!(" on {data}"));
    format!("{} ({}){data}; {scenes}{part}", preset.title, preset.name)
}

/// The scenes with a trial under a preset, whatever became of it.
pub(super) fn scenes_of_trials<'a>(results: &'a Results, preset: &str) -> BTreeSet<&'a str> {
    let trials = results.trials.iter().filter(|trial| trial.key.preset == preset);
    trials.map(|trial| trial.key.scene.as_str()).collect()
}

/// `; 2 of 48 targets are context frames`, of the targets under these presets of results, whatever the number of methods; empty
/// if none is. Where they are excluded: `; without 2 of 48 targets, which are context frames`.
pub(super) fn leaked_targets<'a>(
    protocols: impl IntoIterator<Item = (&'a Results, &'a str)>,
    leaked_are: Leaked,
) -> String {
    let mut targets: BTreeMap<(&str, &str, u32, u32), bool> = BTreeMap::new();
    for (results, preset) in protocols {
        for row in results.targets.iter().filter(|row| row.key.preset == preset) {
            let TrialKey { scene, entry, .. } = &row.key;
            *targets.entry((preset, scene.as_str(), *entry, row.target)).or_default() |= row.leaked;
        }
    }
    let leaked = targets.values().filter(|leaked| **leaked).count();
    let are = if leaked == 1 { "is a context frame" } else { "are context frames" };
    let of_all = format!("{leaked} of {}", counted(targets.len() as u64, "target"));
    match leaked_are {
        _ if leaked == 0 => String::new(),
        Leaked::Included => format!("; {of_all} {are}"),
        Leaked::Excluded => format!("; without {of_all}, which {are}"),
    }
}

/// What results lack of their run, where a preset and method are shown: other shards, and entries that were not reached.
pub(super) fn unfinished(results: &Results, is_shown: impl Fn(&str, &str) -> bool) -> Vec<String> {
    let title = |name: &str| {
        let method = results.provenance.method(name);
        method.map_or_else(|| name.to_owned(), |method| title_of(results, method))
    };
    let part = results.provenance.part().map(|part| format!("{part} of the run"));
    let interrupted = results.interrupted().into_iter().filter(|run| is_shown(&run.preset, &run.method));
    let run = |Unfinished { preset, method, entries, total, .. }: Unfinished| {
        format!("the run of {} under {preset} is unfinished, {entries} of {total} entries", title(&method))
    };
    part.into_iter().chain(interrupted.map(run)).collect()
}

/// A mean over fewer scenes or targets than another in the plot.
pub(super) struct FewerTargets {
    /// What was measured.
    pub(super) title: String,
    /// Scenes in the mean, and of how many.
    pub(super) scenes: [u64; 2],
    /// Targets in the mean, and of how many.
    pub(super) targets: [u64; 2],
}

/// `Means over fewer targets: ATSplat: 7 of 8 scenes, 20 of 24 targets.`; `None` without any.
pub(super) fn fewer_targets(all: &[FewerTargets]) -> Option<String> {
    let text = |FewerTargets { title, scenes, targets }: &FewerTargets| {
        format!("{title}: {} of {} scenes, {} of {} targets", scenes[0], scenes[1], targets[0], targets[1])
    };
    let all: Vec<String> = all.iter().map(text).collect();
    (!all.is_empty()).then(|| format!("Means over fewer targets: {}.", all.join("; ")))
}

#[cfg(test)]
mod tests {
    use atsplat_results::Shard;

    use super::*;
    use crate::sample::{UNKNOWN_HASH, atsplat, nearest_view, preset, results};

    #[test]
    fn a_title_tells_trainings_apart_and_names_random_weights() {
        let random = MethodRecord { untrained: true, ..atsplat("b", |_| ()) };
        let named = MethodRecord { title: "untrained network".to_owned(), untrained: true, ..nearest_view() };
        let results = results(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), random, named]);
        let titles: Vec<String> = results.provenance.methods.iter().map(|method| title_of(&results, method)).collect();
        assert_eq!(titles, ["ATSplat (a)", "ATSplat (b), untrained", "untrained network"]);
    }

    #[test]
    fn data_that_the_protocols_title_does_not_name_are_named() {
        let said = |record: PresetRecord| subject(&results(vec![record.clone()], vec![nearest_view()]), &record);
        let named = preset("re10k-2v-256");
        let part = "4 scenes, 4 of 7194 trials of the index";
        assert_eq!(said(named.clone()), format!("{} (re10k-2v-256); {part}", named.title));
        let other = PresetRecord {
            dataset: "captures/desk".to_owned(),
            index_sha256: UNKNOWN_HASH.to_owned(),
            index_name: None,
            ..named.clone()
        };
        let expected = format!("{} (re10k-2v-256) on unidentified data (desk); {part}", named.title);
        assert_eq!(said(other), expected);
        let capture = PresetRecord { dataset: "fox".to_owned(), ..preset("photos-3v-256") };
        assert!(!said(capture).contains("fox"), "its protocol is for any capture");
    }

    /// Two methods with the same twelve targets, of which one is leaked.
    #[test]
    fn targets_that_are_context_frames_are_counted_once() {
        let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), nearest_view()]);
        let said = |results: &Results| leaked_targets([(results, "re10k-2v-256")], Leaked::Included);
        let left_out = leaked_targets([(&results, "re10k-2v-256")], Leaked::Excluded);
        assert_eq!(left_out, "; without 1 of 12 targets, which is a context frame");
        assert_eq!(said(&results), "; 1 of 12 targets is a context frame");
        results.targets.iter_mut().filter(|row| row.target == 1).for_each(|row| row.leaked = true);
        assert_eq!(said(&results), "; 5 of 12 targets are context frames");
        results.targets.iter_mut().for_each(|row| row.leaked = false);
        assert_eq!(said(&results), "");
    }

    #[test]
    fn a_part_of_a_run_is_named_and_so_is_one_that_was_interrupted() {
        let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), nearest_view()]);
        let said = |results: &Results| unfinished(results, |preset, method| (preset, method) == ("re10k-2v-256", "a"));
        results.provenance.skipped.clear();
        assert_eq!(said(&results), [""; 0]);
        results.provenance.shard = Some(Shard { number: 2, count: 3 });
        results.trials.retain(|row| row.key.scene != "bb22");
        let expected =
            ["shard 2 of 3 of the run", "the run of ATSplat under re10k-2v-256 is unfinished, 3 of 4 entries"];
        assert_eq!(said(&results), expected);
    }
}
