//! Which measured rows are ranked together, and what a table says of what its numbers lack.

use atsplat_results::{MethodRecord, Results, TargetRow, TargetStatus, TrainingRecord, TrialKey, TrialStatus};

use super::*;
use crate::definition::TableDefinition;
use crate::sample::{SCENES, atsplat, floor, preset, random, results};

fn built(name: &str, stores: &[&Results]) -> Table {
    let labels = ["one", "two", "three"];
    let sources: Vec<Source<'_>> =
        labels.iter().zip(stores).map(|(label, results)| Source { label, results }).collect();
    tables(&TableDefinition::named(name).unwrap(), &sources, Mixing::Apart).unwrap().swap_remove(0)
}

fn notes(table: &Table, kind: NoteKind) -> Vec<&str> {
    table.footer.iter().filter(|note| note.kind == kind).map(|note| note.text.as_str()).collect()
}

fn row_of<'a>(table: &'a Table, method: &str) -> &'a Row {
    table.rows.iter().find(|row| row.method.as_deref() == Some(method) && !row.without_leaked).unwrap()
}

/// The marks of the methods `a` and `b`.
fn marks(table: &Table, index: CellIndex) -> [Mark; 2] {
    ["a", "b"].map(|method| row_of(table, method).cell(index).mark)
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

/// A target without scores.
fn set_status(row: &mut TargetRow, status: TargetStatus) {
    row.status = status;
    row.scores.clear();
}

/// As another `--limit`, or poses with which the second scene is skipped.
fn without_second_scene(results: &mut Results) {
    results.trials.retain(|row| row.key.scene != SCENES[1]);
    results.targets.retain(|row| row.key.scene != SCENES[1]);
    results.provenance.presets[0].entries = 3;
}

const SECOND_IS_BEST: [Mark; 2] = [Mark::Plain, Mark::Best];
const NONE: [Mark; 2] = [Mark::Plain; 2];
const PSNR: CellIndex = CellIndex { group: 0, column: 0 };
const SSIM: CellIndex = CellIndex { column: 1, ..PSNR };
const LPIPS: CellIndex = CellIndex { column: 2, ..PSNR };
const GAUSSIANS: CellIndex = CellIndex { column: 3, ..PSNR };
const SECONDS: CellIndex = CellIndex { column: 4, ..PSNR };

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

/// One column that compares under `--force` does not make the protocols one.
#[test]
fn rows_of_different_protocols_are_not_ranked() {
    let [first, mut second] = two_stores("re10k-2v-256");
    second.provenance.presets[0].hash = "another".to_owned();
    let sources = [Source { label: "one", results: &first }, Source { label: "two", results: &second }];
    let table = tables(&TableDefinition::named("re10k").unwrap(), &sources, Mixing::Forced).unwrap().swap_remove(0);
    assert_eq!([PSNR, GAUSSIANS, SECONDS].map(|index| marks(&table, index)), [NONE; 3]);
    let said = "no measured number is marked as best, because rows are of different protocols: \
                PSNR, SSIM, #Gauss., Time (s)";
    assert_eq!(notes(&table, NoteKind::Unranked), [said]);
    assert_eq!(table.why_unranked(&[PSNR, SECONDS]), ["rows are of different protocols"]);
}

/// Budgets are not marked, but their plots draw an order.
#[test]
fn a_table_without_marks_knows_what_does_not_compare() {
    let [first, mut second] = two_stores("re10k-2v-256");
    let reasons = |stores: &[&Results]| {
        let table = built("k_scaling", stores);
        assert_eq!(notes(&table, NoteKind::Unranked), [""; 0]);
        (table.why_unranked(&[PSNR]), table.rows.iter().all(|row| row.cell(PSNR).mark == Mark::Plain))
    };
    assert_eq!(reasons(&[&first, &second]), (Vec::new(), true));
    without_second_scene(&mut second);
    assert_eq!(reasons(&[&first, &second]), (vec!["rows are over different scenes or targets"], true));
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
    assert_eq!([PSNR, SSIM, GAUSSIANS].map(|index| marks(&table, index)), [SECOND_IS_BEST; 3]);
    without_second_scene(&mut second);
    let table = built("re10k", &[&first, &second]);
    assert_eq!([PSNR, SSIM, GAUSSIANS].map(|index| marks(&table, index)), [NONE; 3]);
    assert_eq!(marks(&table, SECONDS), SECOND_IS_BEST);
    let said =
        "no measured number is marked as best, because rows are over different scenes or targets: PSNR, SSIM, #Gauss.";
    assert_eq!(notes(&table, NoteKind::Unranked), [said]);
    assert!(table.rows.iter().any(|row| row.origin == Origin::Published && row.cell(PSNR).mark == Mark::Best));
}

/// A method that is better everywhere loses its best scene: its renders are identical to the truth.
#[test]
fn an_order_that_identical_renders_would_change_is_not_marked() {
    let [first, mut second] = two_stores("re10k-2v-256");
    // Quality falls by 2 dB with the position of the scene: without the first, the mean is 1 dB lower.
    for row in &mut second.targets {
        if row.key.scene == SCENES[0] {
            (row.status, row.scores) = (TargetStatus::Identical, [("ssim".to_owned(), 1.0)].into());
        } else if let Some(score) = row.scores.get_mut("psnr") {
            *score -= 0.5;
        }
    }
    let table = built("re10k", &[&first, &second]);
    assert_eq!([PSNR, GAUSSIANS].map(|index| marks(&table, index)), [NONE, SECOND_IS_BEST]);
    let said = notes(&table, NoteKind::Unranked).join(" ");
    assert!(said.contains("identical to the truth, which means leave out, would change the order: PSNR"), "{said}");
    let said = row_of(&table, "b").measured_on.as_ref().unwrap().text.as_str();
    assert!(said.contains(", 3 of ") && said.ends_with(" scenes, 3 of 12 targets identical to the truth"), "{said}");
    // A single target that changes no order.
    let [first, mut second] = two_stores("re10k-2v-256");
    (second.targets[0].status, second.targets[0].scores) = (TargetStatus::Identical, [("ssim".to_owned(), 1.0)].into());
    let table = built("re10k", &[&first, &second]);
    assert_eq!(marks(&table, PSNR), SECOND_IS_BEST);
    assert!(!row_of(&table, "b").measured_on.as_ref().unwrap().text.contains("identical"));
}

/// The third method renders the truth of every target: it has no number, and would be first.
#[test]
fn a_method_all_of_whose_renders_are_identical_leaves_no_best_one() {
    let [first, second] = two_stores("re10k-2v-256");
    let mut third = results(vec![preset("re10k-2v-256")], vec![atsplat("c", |_| ())]);
    for row in &mut third.targets {
        (row.status, row.leaked) = (TargetStatus::Identical, false);
        row.scores = [("ssim".to_owned(), 1.0)].into();
    }
    let table = built("re10k", &[&first, &second, &third]);
    assert_eq!(row_of(&table, "c").cell(PSNR).value, Value::Absent);
    let expected = [NONE, NONE, [Mark::Second, Mark::Best]];
    assert_eq!([PSNR, SSIM, GAUSSIANS].map(|index| marks(&table, index)), expected);
    let said = notes(&table, NoteKind::Unranked);
    let why = "renders that are identical to the truth, which means leave out, would change the order";
    assert_eq!(said, [format!("no measured number is marked as best, because {why}: PSNR, SSIM")]);
    // Without renders for some targets, it would not be ranked either.
    set_status(&mut third.targets[4], TargetStatus::Failed);
    let table = built("re10k", &[&first, &second, &third]);
    assert_eq!(marks(&table, PSNR), SECOND_IS_BEST);
}

/// The better method fails on its worst target, or on a whole trial.
#[test]
fn a_row_that_lacks_targets_says_why_it_is_not_ranked() {
    let said = |change: fn(&mut Results)| {
        let [first, mut second] = two_stores("re10k-2v-256");
        change(&mut second);
        let table = built("re10k", &[&first, &second]);
        assert_eq!(marks(&table, PSNR)[1] == Mark::Best, notes(&table, NoteKind::Unranked).is_empty());
        notes(&table, NoteKind::Unranked).join("\n")
    };
    assert_eq!(said(|_| ()), "");
    let failed = said(|results| set_status(&mut results.targets[11], TargetStatus::Failed));
    assert_eq!(failed, "not ranked, because targets failed: ATSplat (b) (PSNR, SSIM)");
    let not_finite = said(|results| set_status(&mut results.targets[11], TargetStatus::NonFinite));
    assert_eq!(not_finite, "not ranked, because renders are not finite: ATSplat (b) (PSNR, SSIM)");
    let whole_trial = said(|results| {
        results.timings.clear();
        results.trials[3].status = TrialStatus::Failed;
        results.targets[9..].iter_mut().for_each(|row| set_status(row, TargetStatus::Failed));
    });
    assert_eq!(whole_trial, "not ranked, because targets failed: ATSplat (b)");
    // A single measured row is compared with none.
    let [mut first, _] = two_stores("re10k-2v-256");
    set_status(&mut first.targets[0], TargetStatus::Failed);
    assert_eq!(notes(&built("re10k", &[&first]), NoteKind::Unranked), [""; 0]);
}

/// A method that copies context frames almost to the bit wins by leaked targets, and by them alone.
#[test]
fn an_order_that_leaked_targets_decide_is_not_marked() {
    for (copy, expected) in [(95.0, NONE), (20.0, SECOND_IS_BEST)] {
        let [mut first, mut second] = two_stores("re10k-2v-256");
        for row in first.targets.iter_mut().chain(&mut second.targets) {
            row.leaked = row.key.scene == SCENES[0];
        }
        let copied = first.targets.iter_mut().filter(|row| row.leaked);
        copied.filter_map(|row| row.scores.get_mut("psnr")).for_each(|score| *score = copy);
        let table = built("re10k", &[&first, &second]);
        let marks_of_others = [SSIM, GAUSSIANS].map(|index| marks(&table, index));
        assert_eq!((marks(&table, PSNR), marks_of_others), (expected, [SECOND_IS_BEST; 2]), "{copy} dB");
        let said = notes(&table, NoteKind::Unranked).join(" ");
        let why = "because the order differs without targets that are context frames: PSNR";
        assert_eq!(said.contains(why), expected == NONE, "{said}");
    }
}

/// The mean of two trainings of one network, which is between them, has no row without leaked targets.
#[test]
fn a_mean_over_trainings_changes_no_order() {
    let trained = |seed: &str| MethodRecord {
        weights_sha256: Some(seed.repeat(16)),
        training: Some(TrainingRecord { data: "simulated rooms".to_owned(), seed: Some(seed.to_owned()) }),
        ..atsplat(seed, |_| ())
    };
    let mut results = results(vec![preset("re10k-2v-256")], vec![trained("1"), trained("2"), floor()]);
    // The second training is level with the first, but for a tenth of a decibel.
    for row in &mut results.targets {
        let copied = row.key.method != "nearest-view" && row.key.scene == SCENES[0];
        row.leaked = row.key.scene == SCENES[0];
        (row.status, row.not_computed) = (TargetStatus::Scored, [].into());
        let psnr = 20.0 + f64::from(row.key.method == "1") * 0.1 + f64::from(row.key.method != "nearest-view");
        row.scores = [("psnr".to_owned(), psnr + 10.0 * f64::from(copied)), ("ssim".to_owned(), psnr / 32.0)].into();
    }
    results.trials.iter_mut().for_each(|trial| (trial.status, trial.detail) = (TrialStatus::Done, None));
    let table = built("re10k", &[&results]);
    assert!(table.rows.iter().any(Row::is_over_trainings));
    let said = notes(&table, NoteKind::Unranked).join(" ");
    assert!(!said.contains("context frames"), "{said}");
    assert_eq!(row_of(&table, "1").cell(PSNR).mark, Mark::Best);
}

#[test]
fn metrics_of_other_weights_are_not_ranked() {
    let [mut first, mut second] = two_stores("re10k-2v-256");
    let set = |results: &mut Results, hash: &str| {
        let record = results.provenance.metrics.iter_mut().find(|metric| metric.id == "lpips").unwrap();
        (record.weights_sha256, record.absent) = (Some(hash.to_owned()), None);
        for row in &mut results.targets {
            row.not_computed.clear();
            row.scores.insert("lpips".to_owned(), 0.2);
        }
    };
    set(&mut first, "397923af");
    set(&mut second, "397923af");
    second.targets.iter_mut().for_each(|row| *row.scores.get_mut("lpips").unwrap() = 0.1);
    let best_of_all = |table: &Table| table.rows.iter().filter(|row| row.cell(LPIPS).mark == Mark::Best).count();
    let table = built("re10k", &[&first, &second]);
    assert_eq!(
        (marks(&table, LPIPS), best_of_all(&table)),
        (SECOND_IS_BEST, 2),
        "measured and published are ranked separately"
    );
    set(&mut first, "0123");
    let table = built("re10k", &[&first, &second]);
    assert_eq!((marks(&table, LPIPS), marks(&table, PSNR)), (NONE, SECOND_IS_BEST));
    let said = "no measured number is marked as best, because metrics have different weights: LPIPS";
    assert_eq!(notes(&table, NoteKind::Unranked), [said]);
}

/// One table would be misleading, and two tables of one title too.
#[test]
fn a_table_says_why_results_are_not_in_the_one_before() {
    let said = |change: fn(&mut Results)| {
        let [first, mut second] = two_stores("re10k-2v-256");
        change(&mut second);
        let sources = [Source { label: "one", results: &first }, Source { label: "two", results: &second }];
        let made = tables(&TableDefinition::named("re10k").unwrap(), &sources, Mixing::Apart).unwrap();
        let separated_because = |table: &Table| {
            let mut notes = notes(table, NoteKind::Setting).into_iter();
            notes.find_map(|note| {
                note.split_once("not in one table with the results of ").map(|(_, why)| why.to_owned())
            })
        };
        made.iter().map(separated_because).collect::<Vec<_>>()
    };
    assert_eq!(said(|_| ()), [None]);
    assert_eq!(
        said(|results| results.provenance.presets[0].hash = "b".to_owned()),
        [None, Some("one: the protocols differ".to_owned())]
    );
    assert_eq!(
        said(|results| results.provenance.presets[0].index_sha256 = "c".to_owned()),
        [None, Some("one: the indices differ".to_owned())]
    );
    let data = |results: &mut Results| {
        for row in results.trials.iter_mut().filter(|row| row.key.scene == SCENES[1]) {
            row.data_hash = Some("d".to_owned());
        }
    };
    let expected =
        format!("one: 1 trial that both have read different images or cameras, first scene {}, entry 0", SCENES[1]);
    assert_eq!(said(data), [None, Some(expected)]);
}

#[test]
fn rows_of_a_shard_say_so() {
    let [first, mut second] = two_stores("re10k-2v-256");
    second.provenance.shard = Some(atsplat_results::Shard { number: 2, count: 3 });
    let table = built("re10k", &[&first, &second]);
    assert!(row_of(&table, "b").measured_on.as_ref().unwrap().text.ends_with(", shard 2 of 3 of the run"));
    assert!(!row_of(&table, "a").measured_on.as_ref().unwrap().text.contains("shard"));
}

/// The second scene has a small overlap, and counts in no other bin.
#[test]
fn only_columns_with_the_missing_scene_are_not_ranked() {
    let [first, mut second] = two_stores("re10k-overlap");
    without_second_scene(&mut second);
    let table = built("re10k_overlap", &[&first, &second]);
    let [small, medium, large, average] = [1, 2, 3, 4].map(|group| marks(&table, CellIndex { group, column: 0 }));
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
    assert_eq!(outside.len(), 2, "with and without leaked targets: {said:?}");
    let expected = "ATSplat: Small: 2 scenes, 6 targets; Medium: 0 scenes, 0 targets; Large: 1 scene, 2 targets; \
                    Average: 3 scenes, 8 targets; 4 targets outside all bins of overlap: in the mean over all \
                    targets, not in Average";
    assert_eq!(*outside[0], expected);
    assert_eq!(row_of(&table, "a").cell(CellIndex { group: 3, column: 0 }).counts.unwrap().outside_bins, 4);
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
    let counts = row_of(&table, "b").cell(SSIM).counts.unwrap();
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
    let is_published = |table: &Table| row_of(table, "a").measured_on.as_ref().unwrap().published_setting;
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
