//! Paired differences to a chosen method, and undecided leads.

use atsplat_files::csv;
use atsplat_numeric::Tolerance;
use atsplat_protocol::Aggregation;
use atsplat_results::statistics::{Identical, Leaked, MetricQuery, paired_between};
use atsplat_results::{MethodRecord, Results, TargetStatus};

use crate::definition::{Choice, Quantity, TableDefinition};
use crate::emit::TableFormat;
use crate::sample::{SCENES, nearest_view, preset, results_over};
use crate::table::test_tables::{notes, row_of, trained};
use crate::table::{Cell, Group, Mark, Mixing, NoteKind, Source, Table, Value, tables};

const PRESET: &str = "rooms-2v-128";

/// A method without a published row, of this name and title.
fn method(name: &str) -> MethodRecord {
    MethodRecord { name: name.to_owned(), title: format!("the {name}"), ..nearest_view() }
}

/// A method's results, of which the PSNR is higher in each scene by these decibels than 27, 25, 23 dB and so on.
fn store(name: &str, gains: &[f64]) -> Results {
    store_under(PRESET, name, gains)
}

/// As [`store`], under another protocol.
fn store_under(protocol: &str, name: &str, gains: &[f64]) -> Results {
    let mut results = results_over(vec![preset(protocol)], vec![method(name)], gains.len());
    for row in &mut results.targets {
        let at = SCENES.iter().position(|scene| *scene == row.key.scene);
        let at = at.unwrap_or_else(|| row.key.scene.trim_start_matches("scene ").parse().unwrap());
        row.scores.entry("psnr".to_owned()).and_modify(|psnr| *psnr += gains[at]);
    }
    results
}

fn compared(stores: &[(&str, &Results)], choice: &Choice, mixing: Mixing) -> Table {
    compared_in("re10k", stores, choice, mixing)
}

/// As [`compared`], in another table.
fn compared_in(table: &str, stores: &[(&str, &Results)], choice: &Choice, mixing: Mixing) -> Table {
    let sources: Vec<Source<'_>> = stores.iter().map(|(label, results)| Source { label, results }).collect();
    tables(&TableDefinition::named(table).unwrap().with_choice(choice), &sources, mixing).unwrap().swap_remove(0)
}

fn against(name: &str) -> Choice {
    Choice { against: Some(name.to_owned()), ..Choice::default() }
}

/// The difference in a method's row, the last cell.
fn last<'a>(table: &'a Table, method: &str) -> &'a Cell {
    row_of(table, method).cells.last().unwrap().last().unwrap()
}

/// The own renders are in one store, the baseline in another. One target of the third scene was lost.
#[test]
fn rows_are_compared_with_a_method_of_another_store() {
    let gains = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 9.0];
    let (mut mine, baseline) = (store("mine", &gains), store("warp", &[0.0; 7]));
    let lost = mine.targets.iter_mut().find(|row| row.key.scene == SCENES[2] && row.target == 1).unwrap();
    lost.status = TargetStatus::NonFinite;
    lost.scores.clear();
    let stores = [("scores", &mine), ("baselines", &baseline)];
    let table = compared(&stores, &against("the warp"), Mixing::Apart);
    let Group { title, columns, .. } = table.groups.last().unwrap();
    assert_eq!((title.as_str(), columns[0].head().as_str()), ("paired difference to the warp", "ΔPSNR"));
    let cell = last(&table, "mine");
    Tolerance::F64.assert([cell.value.number().unwrap()], [30.0 / 7.0], "mine minus the warp");
    let query = |method| {
        let (leaked, identical) = (Leaked::Included, Identical::Excluded);
        MetricQuery { preset: PRESET, method, metric: "psnr", leaked, identical }
    };
    let pair = paired_between((&mine, &query("mine")), (&baseline, &query("warp")), Aggregation::SceneMeans).unwrap();
    Tolerance::EXACT.assert(cell.interval.unwrap(), pair.interval.unwrap(), "interval");
    assert!(cell.print(&columns[0]).starts_with("+4.29 [+"), "{}", cell.print(&columns[0]));
    assert_eq!(last(&table, "warp"), &Cell::default(), "its own row");
    let said = notes(&table, NoteKind::Counts).join("\n");
    assert!(said.contains("the mine: 1 target that only it or the warp has, not in the difference"), "{said}");
    assert!(notes(&table, NoteKind::Paired).iter().any(|note| note.starts_with("Δ: the row minus the warp")));
    let records = csv::parse(&TableFormat::Csv.write(&table).unwrap()).unwrap();
    let ends = ["psnr_difference", "psnr_difference_low", "psnr_difference_high", "psnr_difference_scenes"];
    assert!(records[0].ends_with(&ends.map(str::to_owned)), "{:?}", records[0]);
    let record = records.iter().find(|record| record[0] == "the mine").unwrap();
    assert_eq!(record.last().map(String::as_str), Some("7"), "{record:?}");
    let latex = TableFormat::Latex.write(&table).unwrap();
    assert!(latex.contains("$\\Delta$PSNR") && latex.contains("+4.29 ["), "{latex}");
    // The other way round, with two metrics: SSIM is the same.
    let columns = vec![Quantity::Gaussians, "ssim".parse().unwrap(), "psnr".parse().unwrap()];
    let table = compared(&stores, &Choice { columns, ..against("mine") }, Mixing::Apart);
    let row = table.rows.iter().find(|row| row.method.as_deref() == Some("warp")).unwrap();
    let differences: Vec<f64> = row.cells.last().unwrap().iter().map(|cell| cell.value.number().unwrap()).collect();
    Tolerance::F64.assert(differences, [0.0, -30.0 / 7.0], "the warp minus mine");
    let latex = TableFormat::Latex.write(&table).unwrap();
    assert!(latex.contains("& 0.000 [0.000, 0.000] & $-$4.29 [$-$"), "{latex}");
    let columns = serde_json::to_value(&table.groups.last().unwrap().columns).unwrap();
    assert_eq!([0, 1].map(|at| columns[at]["quantity"].as_str().unwrap()), ["ssim-difference", "psnr-difference"]);
}

#[test]
fn a_difference_that_means_nothing_has_a_reason() {
    let why = |stores: &[(&str, &Results)], mixing| {
        let table = compared(stores, &against("warp"), mixing);
        assert_eq!(last(&table, "mine").value, Value::Absent);
        last(&table, "mine").not_computed.clone().unwrap()
    };
    let few = [store("mine", &[1.0; 5]), store("warp", &[0.0; 5])];
    let stores = [("scores", &few[0]), ("baselines", &few[1])];
    assert_eq!(why(&stores, Mixing::Apart), "5 scenes in common with warp, fewer than 6");
    let [mine, mut other] = [store("mine", &[1.0; 7]), store("warp", &[0.0; 7])];
    other.trials[0].data_hash = Some("other images".to_owned());
    let stores = [("scores", &mine), ("baselines", &other)];
    assert_eq!(why(&stores, Mixing::Apart), "warp has no results on these data under rooms-2v-128");
    let forced = why(&stores, Mixing::Forced);
    assert_eq!(forced, "the results of warp are of another protocol, index or data");
    let table = compared(&stores, &against("warp"), Mixing::Forced);
    let said = notes(&table, NoteKind::NotComputed).join("\n");
    assert!(said.contains(&format!("n/c ΔPSNR: not computed: {forced}")), "{said}");
}

/// The mean is 4/7 dB higher, in scenes that differ by 2 to 3 dB; or in scenes that hardly differ.
#[test]
fn an_undecided_lead_is_named_below_the_table() {
    let undecided = |gains: [f64; 7]| {
        let [better, worse] = [store("mine", &gains), store("warp", &[0.0; 7])];
        let table = compared(&[("scores", &better), ("baselines", &worse)], &Choice::default(), Mixing::Apart);
        let best = table.rows.iter().find(|row| row.method.as_deref() == Some("mine")).unwrap();
        assert_eq!(best.cells[0][0].mark, Mark::Best);
        notes(&table, NoteKind::Paired).concat()
    };
    let said = undecided([3.0, -2.0, 3.0, -2.0, 3.0, -2.0, 1.0]);
    assert!(said.contains("is undecided") && said.ends_with(": PSNR"), "{said}");
    assert_eq!(undecided([0.5, 0.6, 0.5, 0.6, 0.5, 0.6, 0.7]), "");
}

/// The first store is older than the hashes of data.
#[test]
fn other_ground_truths_are_other_data() {
    let mut both = [store("mine", &[1.0; 7]), store("warp", &[0.0; 7])];
    for row in both.iter_mut().flat_map(|results| &mut results.targets) {
        row.truth_hash = Some(format!("{} {}", row.key.scene, row.target));
    }
    for trial in &mut both[0].trials {
        trial.data_hash = None;
    }
    let found = |both: &[Results; 2]| {
        let stores = [("scores", &both[0]), ("baselines", &both[1])];
        last(&compared(&stores, &against("warp"), Mixing::Apart), "mine").clone()
    };
    Tolerance::F64.assert(found(&both).value.number(), [1.0], "the same ground truths");
    both[1].targets[4].truth_hash = Some("another photo".to_owned());
    let other = found(&both);
    assert_eq!(other.value, Value::Absent);
    assert_eq!(other.not_computed.as_deref(), Some("warp has no results on these data under rooms-2v-128"));
}

/// Gains that cancel in most scenes: hardly a lead.
const UNDECIDED: [f64; 7] = [0.5, -0.5, 0.5, -0.5, 0.5, -0.5, 0.01];

/// A third row is worse than both, so that both are marked as best; a row of the paper is better than both.
#[test]
fn a_lead_is_undecided_whether_or_not_its_row_alone_is_marked() {
    let said = |protocol: &str, stores: &[Results], best: &[&str]| {
        let stores: Vec<(&str, &Results)> = ["one", "two", "three"].into_iter().zip(stores).collect();
        let table = compared(&stores, &Choice::default(), Mixing::Apart);
        let marked = table.rows.iter().filter(|row| row.cells[0][0].mark == Mark::Best);
        let measured: Vec<&str> = marked.filter_map(|row| row.method.as_deref()).collect();
        assert_eq!(measured, best, "{protocol}");
        notes(&table, NoteKind::Paired).concat()
    };
    let named = |said: &str| said.contains("is undecided") && said.ends_with(": PSNR");
    let three = [store("mine", &UNDECIDED), store("warp", &[0.0; 7]), store("poor", &[-5.0; 7])];
    assert!(named(&said(PRESET, &three, &["mine", "warp"])));
    let whole = |name: &str, gains: &[f64]| {
        let mut results = store_under("re10k-2v-256", name, gains);
        let record = &mut results.provenance.presets[0];
        (record.entries, record.entries_of_index) = (7, 7);
        results.provenance.skipped.clear();
        results
    };
    assert!(named(&said("whole", &[whole("mine", &UNDECIDED), whole("warp", &[0.0; 7])], &[])));
    assert_eq!(said("whole", &[whole("mine", &[1.0; 7]), whole("warp", &[0.0; 7])], &[]), "");
    assert_eq!(said("whole", &[whole("mine", &[0.0; 7]), whole("warp", &[0.0; 7])], &[]), "", "no lead at all");
}

/// The average over bins lacks targets outside all of them, and all whose overlaps are of another estimator.
#[test]
fn an_average_over_bins_has_no_difference_over_other_targets() {
    let found = |change: fn(&mut Results)| {
        let mut both =
            [store_under("re10k-overlap", "mine", &UNDECIDED), store_under("re10k-overlap", "warp", &[0.0; 7])];
        for results in &mut both {
            change(results);
        }
        let stores = [("scores", &both[0]), ("baselines", &both[1])];
        let table = compared_in("re10k_overlap", &stores, &against("warp"), Mixing::Apart);
        let is_named = notes(&table, NoteKind::Paired).concat().contains("scenes): Average PSNR");
        let cell = last(&table, "mine").clone();
        (cell.value.number().is_some(), is_named, cell.not_computed.unwrap_or_default())
    };
    assert_eq!(found(|_| ()), (true, true, String::new()));
    let outside = found(|results| {
        for row in results.targets.iter_mut().filter(|row| row.key.scene == SCENES[1]) {
            row.overlap = Some(0.9);
        }
    });
    assert_eq!(outside, (false, false, "some targets are outside all bins of overlap".to_owned()));
    let (is_number, is_named, why) = found(|results| {
        results.provenance.presets[0].overlap_estimators = vec!["epipolar-ray".to_owned()];
    });
    assert!(!is_number && !is_named && why.contains("overlaps are measured by epipolar-ray"), "{why}");
}

/// The weights of the first training's metric are unknown.
#[test]
fn a_difference_of_several_trainings_needs_one_metric_for_all() {
    let why = |second: &str| {
        let seeded = |seed: &str| {
            let method = trained(&format!("seed {seed}"), seed, "simulated rooms");
            results_over(vec![preset(PRESET)], vec![method], 7)
        };
        let mut all = [seeded("1"), seeded("2"), store("warp", &[0.0; 7])];
        for (results, weights) in all.iter_mut().zip([None, Some(second), Some("397923af8e79cdbb")]) {
            for record in &mut results.provenance.metrics {
                record.weights_sha256 = weights.map(str::to_owned);
            }
        }
        let stores = [("one", &all[0]), ("two", &all[1]), ("three", &all[2])];
        let table = compared(&stores, &against("warp"), Mixing::Apart);
        let mean = table.rows.iter().find(|row| row.is_over_trainings()).unwrap();
        mean.cells.last().unwrap().last().unwrap().not_computed.clone()
    };
    assert_eq!(why("397923af8e79cdbb"), None);
    assert_eq!(why("0123").as_deref(), Some("the weights of PSNR are not those of warp"));
}

/// Two trainings and the other method lost one target each.
#[test]
fn targets_that_not_all_trainings_have_are_named() {
    let seeded = |seed: &str| {
        let method = trained(&format!("seed {seed}"), seed, "simulated rooms");
        results_over(vec![preset(PRESET)], vec![method], 7)
    };
    let mut all = [seeded("1"), seeded("2"), store("warp", &[0.0; 7])];
    for (results, scene) in all.iter_mut().zip(SCENES) {
        let lost = results.targets.iter_mut().find(|row| row.key.scene == scene && row.target == 1).unwrap();
        lost.status = TargetStatus::NonFinite;
        lost.scores.clear();
    }
    let stores = [("one", &all[0]), ("two", &all[1]), ("three", &all[2])];
    let table = compared(&stores, &against("warp"), Mixing::Apart);
    let mean = table.rows.iter().find(|row| row.is_over_trainings()).unwrap();
    assert_eq!(mean.cells.last().unwrap()[0].counts.unwrap().targets, 18, "of 21");
    let said = notes(&table, NoteKind::Counts).join("\n");
    assert!(said.contains(": 3 targets that not all of its trainings and warp have, not in the difference"), "{said}");
    assert!(said.contains(": 2 targets that only it or warp has, not in the difference"), "{said}");
}

/// Under `all-images`; the first scene, in which mine is 9 dB better, has one target, the other six have three each.
#[test]
fn bins_and_differences_average_as_the_protocol_does() {
    let gains = [9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let mut both = [store_under("re10k-overlap", "mine", &gains), store_under("re10k-overlap", "warp", &[0.0; 7])];
    for results in &mut both {
        let record = &mut results.provenance.presets[0];
        let mut protocol = record.protocol().unwrap();
        protocol.aggregation = Aggregation::AllImages;
        (record.hash, record.toml) = (protocol.hash().unwrap().to_string(), protocol.to_toml().unwrap());
        results.targets.retain(|row| row.key.scene != SCENES[0] || row.target == 0);
    }
    let stores = [("scores", &both[0]), ("baselines", &both[1])];
    let table = compared_in("re10k_overlap", &stores, &against("warp"), Mixing::Apart);
    let row = |method: &str| {
        let row = row_of(&table, method);
        let psnr = |group: usize| &row.cells[group][0];
        let targets = |group: usize| psnr(group).counts.unwrap().targets;
        let sum = |group: usize| psnr(group).value.number().unwrap() * targets(group) as f64;
        let average = psnr(4).value.number().unwrap();
        assert_eq!([1, 2, 3].map(targets).iter().sum::<u64>(), 19, "small, medium and large");
        Tolerance::F64.assert([[1, 2, 3].map(sum).iter().sum::<f64>() / 19.0], [average], method);
        average
    };
    let difference = last(&table, "mine").value.number().unwrap();
    Tolerance::F64.assert([difference], [9.0 / 19.0], "not a seventh of 9");
    Tolerance::absolute(1e-9).assert([row("mine") - row("warp")], [difference], "of both rows");
}
