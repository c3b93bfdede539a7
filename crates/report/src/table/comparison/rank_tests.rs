//! Which measured rows are ranked together, and what a table says of those that are not.

use atsplat_results::{IDENTICAL, MethodRecord, Results, TargetRow, TargetStatus, TrialStatus};

use crate::definition::TableDefinition;
use crate::plot::Origin;
use crate::sample::{SCENES, atsplat, nearest_view, preset, results, store};
use crate::table::test_tables::{notes, row_of, table_of, table_of_stores, trained, two_stores};
use crate::table::{CellIndex, Mark, Mixing, NoteKind, Row, Source, Table, Value, tables};

/// The marks of the methods `a` and `b`.
fn marks(table: &Table, index: CellIndex) -> [Mark; 2] {
    ["a", "b"].map(|method| row_of(table, method).cell(index).mark)
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
    let table = table_of_stores("re10k", &[&first, &second]);
    assert_eq!(marks(&table, SECONDS), SECOND_IS_BEST);
    assert_eq!(notes(&table, NoteKind::Unranked), [""; 0]);
    let (mut elsewhere, mut on_a_card) = (second.clone(), second);
    elsewhere.timings.iter_mut().for_each(|row| row.machine.threads = 64);
    on_a_card.timings.iter_mut().for_each(|row| row.network_adapter = Some("a card".to_owned()));
    for other in [elsewhere, on_a_card] {
        let table = table_of_stores("re10k", &[&first, &other]);
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
        let table = table_of_stores("k_scaling", stores);
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
    let table = table_of_stores("re10k", &[&stores[0], &stores[1]]);
    assert_eq!((marks(&table, SECONDS), marks(&table, PSNR)), (SECOND_IS_BEST, NONE), "other columns have one ranking");
    let published = table.rows.iter().filter(|row| row.origin == Origin::Published);
    let best: Vec<&str> =
        published.filter(|row| row.cell(SECONDS).mark == Mark::Best).map(|row| &*row.labels[0]).collect();
    assert_eq!(best, ["ATSplat"]);
}

#[test]
fn rows_over_different_scenes_are_not_ranked() {
    let [first, mut second] = two_stores("re10k-2v-256");
    let table = table_of_stores("re10k", &[&first, &second]);
    assert_eq!([PSNR, SSIM, GAUSSIANS].map(|index| marks(&table, index)), [SECOND_IS_BEST; 3]);
    without_second_scene(&mut second);
    let table = table_of_stores("re10k", &[&first, &second]);
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
    let table = table_of_stores("re10k", &[&first, &second]);
    assert_eq!([PSNR, GAUSSIANS].map(|index| marks(&table, index)), [NONE, SECOND_IS_BEST]);
    let said = notes(&table, NoteKind::Unranked).join(" ");
    assert!(said.contains("identical to the truth, which means leave out, would change the order: PSNR"), "{said}");
    let said = row_of(&table, "b").measured_on.as_ref().unwrap().text.as_str();
    assert!(said.contains(", 3 of ") && said.ends_with(" scenes, 3 of 12 targets identical to the truth"), "{said}");
    // A single target that changes no order.
    let [first, mut second] = two_stores("re10k-2v-256");
    (second.targets[0].status, second.targets[0].scores) = (TargetStatus::Identical, [("ssim".to_owned(), 1.0)].into());
    let table = table_of_stores("re10k", &[&first, &second]);
    assert_eq!(marks(&table, PSNR), SECOND_IS_BEST);
    assert!(!row_of(&table, "b").measured_on.as_ref().unwrap().text.contains("identical"));
}

/// Its renders of its best scene are the truth only as rounded samples: they are scored, and their PSNR is infinite.
#[test]
fn an_order_that_renders_with_infinite_psnr_would_change_is_not_marked() {
    let [first, mut second] = two_stores("re10k-2v-256");
    for row in &mut second.targets {
        if row.key.scene == SCENES[0] {
            row.scores.remove("psnr");
            row.not_computed.insert("psnr".to_owned(), IDENTICAL.to_owned());
        } else if let Some(score) = row.scores.get_mut("psnr") {
            *score -= 0.5;
        }
    }
    let table = table_of_stores("re10k", &[&first, &second]);
    assert_eq!([PSNR, SSIM].map(|index| marks(&table, index)), [NONE, SECOND_IS_BEST]);
    assert_eq!(row_of(&table, "b").cell(PSNR).counts.unwrap().identical, 3);
    let said = notes(&table, NoteKind::Unranked).join(" ");
    assert!(said.contains("identical to the truth, which means leave out, would change the order: PSNR"), "{said}");
    // Copies of context views are no merit.
    second.targets.iter_mut().filter(|row| row.key.scene == SCENES[0]).for_each(|row| row.leaked = true);
    let table = table_of_stores("re10k", &[&first, &second]);
    let said = notes(&table, NoteKind::Unranked).join(" ");
    assert!(!said.contains("identical to the truth"), "{said}");
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
    let table = table_of_stores("re10k", &[&first, &second, &third]);
    assert_eq!(row_of(&table, "c").cell(PSNR).value, Value::Absent);
    let expected = [NONE, NONE, [Mark::Second, Mark::Best]];
    assert_eq!([PSNR, SSIM, GAUSSIANS].map(|index| marks(&table, index)), expected);
    let said = notes(&table, NoteKind::Unranked);
    let why = "renders that are identical to the truth, which means leave out, would change the order";
    assert_eq!(said, [format!("no measured number is marked as best, because {why}: PSNR, SSIM")]);
    // Without renders for some targets, it would not be ranked either.
    set_status(&mut third.targets[4], TargetStatus::Failed);
    let table = table_of_stores("re10k", &[&first, &second, &third]);
    assert_eq!(marks(&table, PSNR), SECOND_IS_BEST);
}

/// The better method fails on its worst target, or on a whole trial.
#[test]
fn a_row_that_lacks_targets_says_why_it_is_not_ranked() {
    let said = |change: fn(&mut Results)| {
        let [first, mut second] = two_stores("re10k-2v-256");
        change(&mut second);
        let table = table_of_stores("re10k", &[&first, &second]);
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
    assert_eq!(notes(&table_of_stores("re10k", &[&first]), NoteKind::Unranked), [""; 0]);
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
        let table = table_of_stores("re10k", &[&first, &second]);
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
    let [first, second] = ["1", "2"].map(|seed| trained(seed, seed, "simulated rooms"));
    let mut results = results(vec![preset("re10k-2v-256")], vec![first, second, nearest_view()]);
    // The second training is level with the first, except for a tenth of a decibel.
    for row in &mut results.targets {
        let copied = row.key.method != "nearest-view" && row.key.scene == SCENES[0];
        row.leaked = row.key.scene == SCENES[0];
        (row.status, row.not_computed) = (TargetStatus::Scored, [].into());
        let psnr = 20.0 + f64::from(row.key.method == "1") * 0.1 + f64::from(row.key.method != "nearest-view");
        row.scores = [("psnr".to_owned(), psnr + 10.0 * f64::from(copied)), ("ssim".to_owned(), psnr / 32.0)].into();
    }
    results.trials.iter_mut().for_each(|trial| (trial.status, trial.detail) = (TrialStatus::Done, None));
    let table = table_of_stores("re10k", &[&results]);
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
    let table = table_of_stores("re10k", &[&first, &second]);
    assert_eq!(
        (marks(&table, LPIPS), best_of_all(&table)),
        (SECOND_IS_BEST, 2),
        "measured and published are ranked separately"
    );
    set(&mut first, "0123");
    let table = table_of_stores("re10k", &[&first, &second]);
    assert_eq!((marks(&table, LPIPS), marks(&table, PSNR)), (NONE, SECOND_IS_BEST));
    let said = "no measured number is marked as best, because metrics have different weights: LPIPS";
    assert_eq!(notes(&table, NoteKind::Unranked), [said]);
}

/// The second scene has a small overlap, and counts in no other bin.
#[test]
fn only_columns_with_the_missing_scene_are_not_ranked() {
    let [first, mut second] = two_stores("re10k-overlap");
    without_second_scene(&mut second);
    let table = table_of_stores("re10k_overlap", &[&first, &second]);
    let [small, medium, large, average] = [1, 2, 3, 4].map(|group| marks(&table, CellIndex { group, column: 0 }));
    assert_eq!([small, medium, large, average], [NONE, SECOND_IS_BEST, SECOND_IS_BEST, NONE]);
    let said = notes(&table, NoteKind::Unranked).concat();
    assert!(said.ends_with(": #Gauss., Small PSNR, Small SSIM, Average PSNR, Average SSIM"), "{said}");
}

/// SSIM lacks the worst scene of the better method.
#[test]
fn a_mean_over_targets_with_a_score_alone_says_so_and_is_not_ranked() {
    let [first, mut second] = two_stores("re10k-2v-256");
    for row in second.targets.iter_mut().filter(|row| row.key.scene == SCENES[3]) {
        row.scores.remove("ssim");
        row.not_computed.insert("ssim".to_owned(), "too small".to_owned());
    }
    let table = table_of_stores("re10k", &[&first, &second]);
    assert_eq!((marks(&table, PSNR), marks(&table, SSIM)), (SECOND_IS_BEST, NONE));
    let counts = row_of(&table, "b").cell(SSIM).counts.unwrap();
    assert_eq!((counts.targets, counts.uncomputed), (9, 3));
    let said = notes(&table, NoteKind::NotComputed);
    let expected = "SSIM of ATSplat (b): not computed for 3 of 12 targets, and not ranked: too small";
    assert!(said.contains(&expected), "{said:?}");
    assert!(said.iter().any(|text| text.starts_with("n/c LPIPS: not computed: weights absent")), "{said:?}");
}

#[test]
fn a_partial_run_is_not_the_published_setting_and_is_ranked_separately() {
    let store = store();
    let table = table_of("re10k", &store);
    assert!(notes(&table, NoteKind::Setting).iter().any(|text| text.contains("4 of 7194")), "{:?}", table.footer);
    let best =
        |origin| table.rows.iter().filter(|row| row.origin == origin && row.cells[0][0].mark == Mark::Best).count();
    assert_eq!((best(Origin::Published), best(Origin::Measured)), (1, 1));
    assert!(notes(&table, NoteKind::Counts).iter().any(|text| text.contains("missing-frame 1")));
    let ablation = table_of("ablation_ate", &store);
    let counts = notes(&ablation, NoteKind::Counts);
    assert!(counts.iter().any(|text| text.contains("failed") && text.contains('3')), "{counts:?}");
    assert!(table.rows.iter().all(|row| row.method.as_deref() != Some("atsplat-random")), "an ablation's row");
}

/// The third scene of the random selection fails: its row says so, counts the scenes that it has, and its mean over the easier
/// rest wins nothing.
#[test]
fn a_row_that_lacks_targets_says_so_and_is_not_ranked() {
    let mut store = store();
    let table = table_of("ablation_ate", &store);
    let [whole, lacking] = ["atsplat", "atsplat-random"].map(|method| row_of(&table, method));
    assert!(whole.measured_on.as_ref().unwrap().text.contains("4 of 6474 scenes"), "{:?}", whole.measured_on);
    let text = &lacking.measured_on.as_ref().unwrap().text;
    assert!(text.contains("3 of 6474 scenes, 3 of 12 targets failed"), "{text}");
    let raised = |row: &TargetRow| row.key.method == "atsplat-random";
    for row in store.targets.iter_mut().filter(|row| raised(row)) {
        row.scores.values_mut().for_each(|score| *score += 10.0);
    }
    let table = table_of("ablation_ate", &store);
    let marks = |method: &str| row_of(&table, method).cells[0][0].mark;
    assert_eq!((marks("atsplat"), marks("atsplat-random")), (Mark::Plain, Mark::Plain));
    store.trials.iter_mut().for_each(|trial| trial.status = TrialStatus::Done);
    for row in store.targets.iter_mut().filter(|row| row.status == TargetStatus::Failed) {
        (row.status, row.scores) = (TargetStatus::Scored, [("psnr".to_owned(), 30.0)].into());
    }
    let table = table_of("ablation_ate", &store);
    assert_eq!(row_of(&table, "atsplat-random").cells[0][0].mark, Mark::Best);
}

/// The second network has half the Gaussians, in the scenes on which it did not fail.
#[test]
fn a_size_without_the_trials_that_failed_is_not_ranked() {
    let mut store = results(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), atsplat("b", |_| ())]);
    for trial in store.trials.iter_mut().filter(|trial| trial.key.method == "b") {
        trial.gaussians = Some(11_520);
    }
    let mark = |store: &Results| {
        let table = table_of("re10k", store);
        let [a, b] = ["a", "b"].map(|method| row_of(&table, method).cells[0][3].clone());
        assert_eq!((a.value, b.value), (Value::Number(23_040.0), Value::Number(11_520.0)));
        [a.mark, b.mark]
    };
    assert_eq!(mark(&store), [Mark::Plain, Mark::Plain]);
    store.trials.iter_mut().for_each(|trial| trial.status = TrialStatus::Done);
    assert_eq!(mark(&store), [Mark::Plain, Mark::Best]);
}

#[test]
fn a_complete_run_is_ranked_with_the_paper_unless_untrained() {
    let mut full = preset("re10k-2v-256");
    full.entries_of_index = full.entries;
    let one_best = |untrained| {
        let method = MethodRecord { untrained, ..atsplat("atsplat", |_| ()) };
        let mut results = results(vec![full.clone()], vec![method, nearest_view()]);
        results.provenance.skipped.clear();
        let table = table_of("re10k", &results);
        assert_eq!(notes(&table, NoteKind::Setting), [""; 0]);
        assert_eq!(notes(&table, NoteKind::Untrained).len(), usize::from(untrained));
        let fastest = table.rows.iter().find(|row| row.cells[0][4].mark == Mark::Best).unwrap().labels.clone();
        let marks = row_of(&table, "atsplat").cells[0].iter().filter(|cell| cell.mark != Mark::Plain).count();
        (fastest, marks)
    };
    assert_eq!(one_best(false), (vec!["ATSplat".to_owned()], 1), "as few Gaussians as in the paper");
    assert_eq!(one_best(true).1, 0);
}
