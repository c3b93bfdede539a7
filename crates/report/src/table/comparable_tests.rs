//! Which measured rows are ranked together, and what a table says of what its numbers lack.

use atsplat_eval::{Results, TargetRow, TargetStatus, TrialKey};

use super::*;
use crate::definition::TableDefinition;
use crate::sample::{SCENES, atsplat, floor, preset, random, results};

fn built(name: &str, stores: &[&Results]) -> Table {
    let labels = ["one", "two"];
    let sources: Vec<Source<'_>> =
        labels.iter().zip(stores).map(|(label, results)| Source { label, results }).collect();
    tables(&TableDefinition::named(name).unwrap(), &sources, Mixing::Apart).unwrap().swap_remove(0)
}

fn notes(table: &Table, kind: NoteKind) -> Vec<&str> {
    table.footer.iter().filter(|note| note.kind == kind).map(|note| note.text.as_str()).collect()
}

fn own<'a>(table: &'a Table, method: &str) -> &'a Row {
    table.rows.iter().find(|row| row.method.as_deref() == Some(method) && !row.without_leaked).unwrap()
}

/// The marks of the methods `a` and `b`.
fn marks(table: &Table, place: Place) -> [Mark; 2] {
    ["a", "b"].map(|method| own(table, method).cell(place).mark)
}

/// Stores of the methods `a` and `b` under one preset; `b` is 1 dB better, twice as fast, and has half the Gaussians.
fn two_stores(name: &str) -> [Results; 2] {
    let [first, mut second] = ["a", "b"].map(|method| results(vec![preset(name)], vec![atsplat(method, |_| ())]));
    for row in &mut second.targets {
        row.scores.values_mut().for_each(|score| *score += 1.0);
    }
    second.trials.iter_mut().for_each(|trial| trial.gaussians = Some(11_520));
    second.timings.iter_mut().flat_map(|row| &mut row.encode).for_each(|secs| *secs *= 0.5);
    [first, second]
}

/// As another `--limit`, or poses with which the second scene is skipped.
fn without_second_scene(results: &mut Results) {
    results.trials.retain(|row| row.key.scene != SCENES[1]);
    results.targets.retain(|row| row.key.scene != SCENES[1]);
    results.provenance.presets[0].entries = 3;
}

const SECOND_IS_BEST: [Mark; 2] = [Mark::Plain, Mark::Best];
const NONE: [Mark; 2] = [Mark::Plain; 2];
const PSNR: Place = (0, 0);
const SSIM: Place = (0, 1);
const GAUSSIANS: Place = (0, 3);
const SECONDS: Place = (0, 4);

#[test]
fn times_are_ranked_on_one_machine_and_device_only() {
    let [first, second] = two_stores("re10k-2v-256");
    let table = built("re10k", &[&first, &second]);
    assert_eq!(marks(&table, SECONDS), SECOND_IS_BEST);
    assert_eq!(notes(&table, NoteKind::Unranked), [""; 0]);
    let (mut elsewhere, mut on_a_card) = (second.clone(), second);
    elsewhere.timings.iter_mut().for_each(|row| row.machine.threads = 64);
    on_a_card.timings.iter_mut().for_each(|row| row.network_adapter = Some("a card".to_owned()));
    for other in [elsewhere, on_a_card] {
        let table = built("re10k", &[&first, &other]);
        assert_eq!((marks(&table, SECONDS), marks(&table, PSNR)), (NONE, SECOND_IS_BEST));
        let said = "no measured number is marked as best, because times are of different machines or devices: Time (s)";
        assert_eq!(notes(&table, NoteKind::Unranked), [said]);
        let fastest = table.rows.iter().find(|row| row.cell(SECONDS).mark == Mark::Best).unwrap();
        assert_eq!((fastest.origin, fastest.labels[0].as_str()), (Origin::Published, "ATSplat"));
    }
}

/// The whole published protocol, faster than every published time.
#[test]
fn measured_times_do_not_beat_published_ones() {
    let mut stores = two_stores("re10k-2v-256");
    for store in &mut stores {
        let whole = &mut store.provenance.presets[0];
        whole.entries_of_index = whole.entries;
        store.provenance.skipped.clear();
    }
    stores[1].timings.iter_mut().flat_map(|row| &mut row.encode).for_each(|secs| *secs *= 0.01);
    let table = built("re10k", &[&stores[0], &stores[1]]);
    assert_eq!((marks(&table, SECONDS), marks(&table, PSNR)), (SECOND_IS_BEST, NONE), "other columns have one ranking");
    let published = table.rows.iter().filter(|row| row.origin == Origin::Published);
    let best: Vec<&str> =
        published.filter(|row| row.cell(SECONDS).mark == Mark::Best).map(|row| &*row.labels[0]).collect();
    assert_eq!(best, ["ATSplat"]);
}

#[test]
fn rows_over_different_scenes_are_not_ranked() {
    let [first, mut second] = two_stores("re10k-2v-256");
    let table = built("re10k", &[&first, &second]);
    assert_eq!([PSNR, SSIM, GAUSSIANS].map(|place| marks(&table, place)), [SECOND_IS_BEST; 3]);
    // A target that is identical to the truth is left out of a mean and was asked for all the same.
    let mut identical = second.clone();
    (identical.targets[0].status, identical.targets[0].scores) = (TargetStatus::Identical, [].into());
    assert_eq!(marks(&built("re10k", &[&first, &identical]), PSNR), SECOND_IS_BEST);
    without_second_scene(&mut second);
    let table = built("re10k", &[&first, &second]);
    assert_eq!([PSNR, SSIM, GAUSSIANS].map(|place| marks(&table, place)), [NONE; 3]);
    assert_eq!(marks(&table, SECONDS), SECOND_IS_BEST);
    let said =
        "no measured number is marked as best, because rows are over different scenes or targets: PSNR, SSIM, #Gauss.";
    assert_eq!(notes(&table, NoteKind::Unranked), [said]);
    assert!(table.rows.iter().any(|row| row.origin == Origin::Published && row.cell(PSNR).mark == Mark::Best));
}

/// The second scene has a small overlap, and counts in no other bin.
#[test]
fn only_columns_with_the_missing_scene_are_not_ranked() {
    let [first, mut second] = two_stores("re10k-overlap");
    without_second_scene(&mut second);
    let table = built("re10k_overlap", &[&first, &second]);
    let [small, medium, large, average] = [1, 2, 3, 4].map(|group| marks(&table, (group, 0)));
    assert_eq!([small, medium, large, average], [NONE, SECOND_IS_BEST, SECOND_IS_BEST, NONE]);
    let said = notes(&table, NoteKind::Unranked).concat();
    assert!(said.ends_with(": #Gauss., Small PSNR, Small SSIM, Average PSNR, Average SSIM"), "{said}");
}

/// The overlaps of the third scene are too large, and one of the fourth is unknown, in the rows of one method.
#[test]
fn targets_outside_all_bins_are_counted() {
    let mut results = results(vec![preset("re10k-overlap")], vec![atsplat("a", |_| ()), floor()]);
    let mut rows = results.targets.iter_mut().filter(|row| row.key.method == "a").collect::<Vec<&mut TargetRow>>();
    rows[6..9].iter_mut().for_each(|row| row.overlap = Some(0.9));
    rows[11].overlap = None;
    let table = built("re10k_overlap", &[&results]);
    let said = notes(&table, NoteKind::Counts);
    let outside: Vec<&&str> = said.iter().filter(|text| text.contains("outside all bins")).collect();
    assert_eq!(outside.len(), 2, "with and without context frames: {said:?}");
    let expected = "ATSplat: Small: 2 scenes, 6 targets; Medium: 0 scenes, 0 targets; Large: 1 scene, 2 targets; \
                    Average: 3 scenes, 8 targets; 4 targets outside all bins of overlap";
    assert_eq!(*outside[0], expected);
    assert_eq!(own(&table, "a").cell((3, 0)).counts.unwrap().outside_bins, 4);
}

/// SSIM lacks the worst scene of the better method.
#[test]
fn a_mean_over_targets_with_a_score_alone_says_so_and_is_not_ranked() {
    let [first, mut second] = two_stores("re10k-2v-256");
    for row in second.targets.iter_mut().filter(|row| row.key.scene == SCENES[3]) {
        row.scores.remove("ssim");
        row.not_computed.insert("ssim".to_owned(), "too small".to_owned());
    }
    let table = built("re10k", &[&first, &second]);
    assert_eq!((marks(&table, PSNR), marks(&table, SSIM)), (SECOND_IS_BEST, NONE));
    let counts = own(&table, "b").cell(SSIM).counts.unwrap();
    assert_eq!((counts.targets, counts.uncomputed), (9, 3));
    let said = notes(&table, NoteKind::NotComputed);
    let expected = "SSIM of ATSplat (b): not computed for 3 of 12 targets, and not ranked: too small";
    assert!(said.contains(&expected), "{said:?}");
    assert!(said.iter().any(|text| text.starts_with("n/c LPIPS: not computed: weights absent")), "{said:?}");
}

/// The run of `a` was killed before the second scene; the third method was never requested under this protocol.
#[test]
fn a_run_that_has_not_ended_is_not_the_published_setting() {
    let whole = |name: &str| {
        let mut whole = preset(name);
        whole.entries_of_index = whole.entries;
        let mut results = results(vec![whole], vec![atsplat("a", |_| ()), floor(), random()]);
        results.provenance.skipped.clear();
        results.trials.retain(|row| row.key.method != random().name);
        results.targets.retain(|row| row.key.method != random().name);
        results
    };
    let kill = |results: &mut Results| {
        let is_missing = |key: &TrialKey| key.method == "a" && key.scene == SCENES[1];
        results.trials.retain(|row| !is_missing(&row.key));
        results.targets.retain(|row| !is_missing(&row.key));
    };
    let is_published = |table: &Table| own(table, "a").measured_on.as_ref().unwrap().published_setting;
    let mut results = whole("re10k-2v-256");
    let table = built("re10k", &[&results]);
    assert!(is_published(&table) && notes(&table, NoteKind::Setting).is_empty(), "{:?}", table.footer);
    kill(&mut results);
    let table = built("re10k", &[&results]);
    let said = "not the published setting: re10k-2v-256: the run is unfinished: 3 of 4 entries under a";
    assert_eq!(notes(&table, NoteKind::Setting), [said]);
    assert!(!is_published(&table) && table.caption.ends_with("not comparable with the paper's numbers."));
    // Of a stand-in, both are said.
    let mut results = whole("rooms-2v-128");
    kill(&mut results);
    let said = notes(&built("re10k", &[&results]), NoteKind::Setting).join("\n");
    assert!(said.contains("stands in for re10k-2v-256") && said.contains("3 of 4 entries under a"), "{said}");
}
