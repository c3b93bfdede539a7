//! What an acceptance says: what is no longer guarded, what else has changed, and whether a number moved.

use atsplat_results::{MetricRecord, SkippedEntry};

use super::*;

/// What accepting results after others prints.
fn said(then: &Results, now: &Results) -> String {
    let before = baseline_of(then);
    let report = compare(now, &before);
    let baseline = before.accept(now, &[], acceptance("second"));
    let path = std::path::Path::new("b.json");
    AcceptanceReport::new(path, baseline, acceptance("second"), now, &[], Some(&report)).to_string()
}

/// Two of six scenes, as with a limit.
#[test]
fn targets_that_a_new_baseline_lacks_are_named_and_move_no_number() {
    let whole = store(true, 6, 0.0, 1);
    let mut part = whole.clone();
    part.trials.truncate(2);
    part.targets.truncate(6);
    let lost = format!(
        "warning: {PRESET}, m: 12 targets of the old baseline are no longer guarded, such as scene 002 0 frame 0\n"
    );
    let same = said(&whole, &part);
    assert!(same.contains(&lost) && same.contains("\nno number moved; acceptance 2 of this baseline\n"), "{same}");
    part.targets[4].scores.values_mut().for_each(|score| *score += 1.0);
    let moved = said(&whole, &part);
    assert!(moved.contains(&lost) && moved.contains("\nnumbers moved; acceptance 2 of this baseline\n"), "{moved}");
    let more = said(&part, &whole);
    assert!(!more.contains("warning") && more.contains("\nnumbers moved; "), "{more}");
    let mut other = whole.clone();
    keys(&mut other).for_each(|key| key.method = "n".to_owned());
    let other = said(&whole, &other);
    assert!(other.contains("m: 18 targets of the old baseline are no longer guarded"), "{other}");
    assert!(other.contains("\nthe old baseline contains none of these numbers; "), "{other}");
}

/// LPIPS's weights are missing now, and the protocol is another one; PSNR is the same.
#[test]
fn lost_scores_and_other_changes_are_named_and_move_no_number() {
    let mut then = store(true, 4, 0.0, 1);
    then.targets.iter_mut().for_each(|row| _ = row.scores.insert("lpips".to_owned(), 0.2));
    let mut now = store(true, 4, 0.0, 1);
    now.provenance.presets[0].hash = "b".to_owned();
    let absent = Some("no weights; looked in no folder".to_owned());
    now.provenance.metrics.push(MetricRecord { id: "lpips".to_owned(), absent, ..MetricRecord::default() });
    let text = said(&then, &now);
    for part in [
        "\nwarning: a metric is not guarded: lpips: no weights\n",
        "m: 12 targets of the old baseline are no longer guarded by all of their scores, such as scene 000 0 frame 0: lpips\n",
        "\nchanged: sampled: another protocol: 1, such as was a, is now b\n",
        "\nno number moved; acceptance 2 of this baseline\n",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn scenes_that_a_run_left_out_are_named() {
    let text = |change: fn(&mut Results)| {
        let mut results = store(true, 2, 0.0, 1);
        change(&mut results);
        summary(&results, &[])
    };
    let limited = text(|results| {
        results.provenance.limit = Some(2);
        (results.provenance.presets[0].entries, results.provenance.presets[0].entries_of_index) = (2, 6);
    });
    let left_out = "warning: sampled: 2 of 6 index entries, by a limit of 2 scenes: the others are not guarded\n";
    assert!(limited.contains(left_out), "{limited}");
    let whole = text(|results| {
        results.provenance.limit = Some(9);
        (results.provenance.presets[0].entries, results.provenance.presets[0].entries_of_index) = (2, 2);
    });
    assert!(!whole.contains("warning"), "a limit that leaves nothing out: {whole}");
    let skipped = text(|results| {
        results.provenance.presets[0].entries = 3;
        results.provenance.skipped = vec![SkippedEntry {
            preset: PRESET.to_owned(),
            scene: "scene 007".to_owned(),
            reason: "missing-frame".to_owned(),
            detail: "frame 7".to_owned(),
            ..SkippedEntry::default()
        }];
    });
    let entry = "warning: sampled: 1 index entry was skipped: scene scene 007, entry 0: missing-frame: frame 7\n";
    assert!(skipped.contains(entry), "{skipped}");
}

#[test]
fn a_run_that_was_killed_between_two_protocols_cannot_become_a_baseline() {
    let mut results = store(true, 4, 0.0, 1);
    results.provenance.presets[0].entries = 4;
    acceptable(&results).unwrap();
    results.provenance.presets.push(PresetRecord { name: "q".to_owned(), entries: 5, ..PresetRecord::default() });
    let error = acceptable(&results).unwrap_err().to_string();
    assert!(error.contains("a store is not done: 0 of 5 entries of q under m"), "{error}");
}

/// Two of four scenes have the metric.
#[test]
fn a_run_that_was_killed_while_it_added_a_metric_cannot_become_a_baseline() {
    let mut results = store(true, 4, 0.0, 1);
    results.provenance.presets[0].entries = 4;
    results.provenance.metrics.push(MetricRecord { id: "l1".to_owned(), ..MetricRecord::default() });
    acceptable(&results).unwrap();
    results.targets[..6].iter_mut().for_each(|row| _ = row.scores.insert("l1".to_owned(), 0.2));
    let error = acceptable(&results).unwrap_err().to_string();
    assert!(error.contains("a store is not done: 2 of 4 entries of sampled under m with l1"), "{error}");
}

/// The first baseline of a file has the smallest probe, whichever program accepts it; without one, later ones get it too.
#[test]
fn a_baseline_has_the_probe_of_the_old_one_or_the_smallest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("b.json");
    let results = store(true, 4, 0.0, 1);
    let accept = |probe: ProbeChoice| {
        let before = Baseline::read_if_exists(&path).unwrap();
        let new_baseline = NewBaseline { results: &results, repeats: &[], limits: &[], why: "right", probe };
        new_baseline.write(&path, before.as_ref()).unwrap();
        let written = Baseline::read(&path).unwrap();
        (written.history.len(), written.read_probe(&path).unwrap().map(|(recipe, _)| recipe))
    };
    let other = Recipe { background: [0.25, 0.5, 1.0], ..Recipe::default() };
    assert_eq!(accept(ProbeChoice::Kept), (1, Some(Recipe::default())));
    assert_eq!(accept(ProbeChoice::Recipe(other.clone())), (2, Some(other.clone())));
    assert_eq!(accept(ProbeChoice::Kept), (3, Some(other)));
    assert_eq!(accept(ProbeChoice::None), (4, None));
    assert_eq!(accept(ProbeChoice::Kept), (5, Some(Recipe::default())));
}

#[test]
fn what_cannot_be_accepted_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("b.json");
    let (calm, mut unfinished) = (store(true, 4, 0.0, 1), store(true, 4, 0.0, 1));
    unfinished.provenance.presets[0].entries = 5;
    let limits = [("psnr".to_owned(), 0.05)];
    let error = |results: &Results, limits: &[(String, f64)], why: &str| {
        let new_baseline = NewBaseline { results, repeats: &[], limits, why, probe: ProbeChoice::None };
        let error = new_baseline.write(&path, None).unwrap_err().to_string();
        assert!(Baseline::read_if_exists(&path).unwrap().is_none(), "{error}");
        error
    };
    assert_eq!(error(&calm, &[], " "), "why: expected a reason why these numbers are correct, found none");
    assert!(error(&unfinished, &[], "right").starts_with("expected a finished run, found "));
    assert!(error(&calm, &limits, "right").contains("expected a method that is not deterministic, found none"));
}
