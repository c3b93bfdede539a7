//! What networks were trained on, and rows over several trainings.

use atsplat_numeric::{Tolerance, distinct};
use atsplat_results::{MethodRecord, TrainingRecord, TrialKey};

use super::statement_tests::{built, measured, notes, protocols, trained};
use super::*;
use crate::definition::TableDefinition;
use crate::sample::{atsplat, floor, preset, random, results, results_over, store};

#[test]
fn a_network_outside_its_training_data_says_so() {
    let rooms = || vec![trained("atsplat", "1", "simulated rooms, train split"), floor()];
    let yards = built("cross_dataset", &results(vec![preset("rooms-to-yards-128")], rooms()));
    let all = measured(&yards).filter(|row| !row.without_leaked);
    let labels: Vec<String> = all.map(|row| row.printed_labels().concat()).collect();
    assert_eq!(labels, ["ATSplat, zero-shot: not trained on yards", "Nearest view"]);
    let inside = built("re10k", &results(vec![preset("rooms-2v-128")], rooms()));
    assert_eq!(measured(&inside).next().unwrap().printed_labels(), ["ATSplat"]);
    assert!(notes(&inside, NoteKind::Convention).contains("ATSplat: trained on simulated rooms, train split"));
}

#[test]
fn unified_columns_are_filled_by_unified_weights_alone() {
    let presets = || vec![preset("rooms-2v-128"), preset("yards-2v-128x224")];
    let filled = |methods: Vec<MethodRecord>| {
        let table = built("unified", &results(presets(), methods));
        let row = measured(&table).next().unwrap().clone();
        [0, 1].map(|group| row.cells[group][0].value.number().is_some())
    };
    let separate = || trained("atsplat", "1", "simulated rooms");
    let unified = || trained("joint", "1", "rooms train 0 to 9, yards train 0 to 9");
    assert_eq!(filled(vec![separate()]), [true, false]);
    assert_eq!(filled(vec![unified()]), [false, true]);
    assert_eq!(filled(vec![separate(), unified()]), [true, true]);
}

/// Each was evaluated under one of the protocols.
#[test]
fn a_network_for_each_setting_fills_its_own_row() {
    let methods = vec![trained("for rooms", "1", "simulated rooms"), trained("for yards", "1", "simulated yards")];
    let mut results = results(vec![preset("rooms-2v-128"), preset("yards-2v-128x224")], methods);
    let was_run = |key: &TrialKey| key.preset.starts_with(key.method.trim_start_matches("for "));
    results.trials.retain(|row| was_run(&row.key));
    results.targets.retain(|row| was_run(&row.key));
    let table = built("unified", &results);
    let rows = measured(&table).filter(|row| !row.without_leaked);
    let protocols = rows.flat_map(|row| row.protocols.iter().flatten());
    let methods: Vec<&str> = protocols.map(|protocol| protocol.method.as_str()).collect();
    assert_eq!(methods, ["for rooms", "for yards"]);
}

/// Its rows have no method as a whole. The ablation is in none of them.
#[test]
fn the_unified_table_says_what_its_networks_were_trained_on() {
    let joint = trained("joint", "1", "rooms train 0 to 9, yards train 0 to 9");
    let training = Some(TrainingRecord { data: "simulated yards".to_owned(), seed: None });
    let methods = vec![trained("atsplat", "1", "simulated rooms"), joint, MethodRecord { training, ..random() }];
    let table = built("unified", &results(vec![preset("rooms-2v-128"), preset("yards-2v-128x224")], methods));
    let said = notes(&table, NoteKind::Convention);
    let lines: Vec<&str> = said.lines().filter(|line| line.contains("trained on")).collect();
    let expected = ["simulated rooms", "rooms train 0 to 9, yards train 0 to 9"];
    assert_eq!(lines, expected.map(|data| format!("ATSplat: trained on {data}")));
}

/// Three trainings that differ by 3 dB: their mean with both spreads, and a row for each.
#[test]
fn several_trainings_share_a_row() {
    let seeds = ["1", "2", "3"].map(|seed| trained(&format!("seed {seed}"), seed, "simulated rooms"));
    let all = seeds.iter().cloned().chain([floor()]).collect();
    let table = built("re10k", &results_over(vec![preset("rooms-2v-128")], all, 7));
    let mean = measured(&table).find(|row| row.remarks.iter().any(|remark| remark == "mean of 3 trainings")).unwrap();
    let single: Vec<&Row> =
        measured(&table).filter(|row| row.method.as_deref().is_some_and(|method| method.starts_with("seed"))).collect();
    assert_eq!(single.iter().filter(|row| !row.without_leaked).count(), 3);
    let trainings = mean.cells[0][0].trainings.unwrap();
    let counts = Counts { scenes: 6, targets: 54, failed: 3, ..Counts::default() };
    assert_eq!(mean.cells[0][0].counts, Some(counts), "of all trainings: the first has no failure");
    assert!(mean.measured_on.as_ref().unwrap().text.contains("3 of 21 targets failed"), "{:?}", mean.measured_on);
    let said = notes(&table, NoteKind::Counts);
    let expected = "mean of 3 trainings: 6 scenes, 54 targets of 3 trainings, 3 failed and not in the mean";
    assert!(said.contains(expected), "{said}");
    // The second method of the sample fails in the third scene: six are common. 27.25 − 2 · at, without at = 2.
    let scenes = [27.25, 25.25, 21.25, 19.25, 17.25, 15.25].map(|psnr| psnr - 3.0);
    let expected = scenes.iter().sum::<f64>() / 6.0;
    Tolerance::relative(1e-9).assert([mean.cells[0][0].value.number().unwrap()], [expected], "mean");
    Tolerance::relative(1e-9).assert([trainings.training_deviation], [3.0], "trainings 3 dB apart");
    let variance = scenes.iter().map(|psnr| (psnr - expected).powi(2)).sum::<f64>() / 5.0;
    Tolerance::relative(1e-9).assert([trainings.scene_deviation], [variance.sqrt()], "scenes");
    let said = notes(&table, NoteKind::Trainings);
    assert!(said.contains("PSNR has the standard deviation 3.00 over 3 trainings and"), "{said}");
    // Another seed of other data is another network.
    let mixed = vec![trained("a", "1", "simulated rooms"), trained("b", "2", "simulated yards")];
    let table = built("re10k", &results_over(vec![preset("rooms-2v-128")], mixed, 7));
    assert!(measured(&table).all(|row| row.cells[0][0].trainings.is_none()));
}

#[test]
fn an_order_over_several_trainings_includes_their_spread() {
    let seeded = |seed: &str| trained(&format!("seed {seed}"), seed, "simulated rooms");
    let other = MethodRecord { weights_sha256: Some("of its own".to_owned()), ..random() };
    let order = |methods: Vec<MethodRecord>| {
        let table = built("ablation_ate", &results_over(vec![preset("rooms-2v-128")], methods, 7));
        let order = table.orders[0].clone();
        (order.measured, order.interval.unwrap(), order.outcome)
    };
    let (_, [low, high], outcome) = order(vec![seeded("1"), other.clone()]);
    assert!(outcome == Outcome::Kept && high - low < 1e-9, "one training: 3 dB in every scene");
    // Trainings at 0 and −6 dB, the other at −3: nothing is known about the next training.
    let (measured, [low, high], outcome) = order(vec![seeded("1"), other, seeded("2")]);
    Tolerance::absolute(1e-9).assert([measured], [0.0], "the mean of +3 and −3");
    assert!(outcome == Outcome::Undecided && low < -3.0 && high > 3.0, "{low} to {high}");
}

/// Two stores, as of two devices, with one network trained from seeds 1 and 2: no mean has a training twice.
#[test]
fn a_training_of_two_stores_is_in_a_mean_once() {
    let seeded = |seed: &str| trained(&format!("seed {seed}"), seed, "simulated rooms");
    let other = MethodRecord { weights_sha256: Some("of its own".to_owned()), ..random() };
    let results = results_over(vec![preset("rooms-2v-128")], vec![seeded("1"), other, seeded("2")], 7);
    let stores = ["run-cpu", "run-gpu"].map(|label| Source { label, results: &results });
    let first_table =
        |name: &str| tables(&TableDefinition::named(name).unwrap(), &stores, Mixing::Apart).unwrap().swap_remove(0);
    let table = first_table("re10k");
    let means = measured(&table).filter_map(|row| Some((row.store.as_deref()?, row.cells[0][0].trainings?.count)));
    assert_eq!(means.collect::<Vec<_>>(), [("run-cpu", 2), ("run-gpu", 2)]);
    let orders: Vec<[usize; 2]> = first_table("ablation_ate").orders.iter().map(|order| order.trainings).collect();
    assert_eq!(orders, [[1, 2]], "random selection has one");
    let of_store = |store: &str| format!("mean of 2 trainings ({store}: seed 1, {store}: seed 2)");
    let means = measured(&table).filter(|row| row.method.is_none());
    let remarks: Vec<&String> = means.map(|row| &row.remarks[0]).collect();
    assert_eq!(remarks, [&of_store("run-cpu"), &of_store("run-gpu")]);
    for name in ["re10k", "ablation_ate"] {
        let table = first_table(name);
        let labels: Vec<Vec<String>> = measured(&table).map(Row::printed_labels).collect();
        assert_eq!(distinct(labels.iter()).len(), labels.len(), "{labels:?}");
    }
}

#[test]
fn means_over_trainings_of_different_networks_have_different_labels() {
    let network = |(name, data): (&str, &str)| ["1", "2"].map(|seed| trained(&format!("{name} {seed}"), seed, data));
    let networks = [("few", "rooms train 0 to 9"), ("many", "rooms train 0 to 99")];
    let all = networks.into_iter().flat_map(network).collect();
    let results = results_over(vec![preset("rooms-2v-128")], all, 7);
    let means = |table: &Table| -> Vec<String> {
        measured(table).filter(|row| row.method.is_none()).map(|row| row.printed_labels().remove(0)).collect()
    };
    let expected = ["few", "many"].map(|name| format!("ATSplat, mean of 2 trainings ({name} 1, {name} 2)"));
    assert_eq!(means(&built("re10k", &results)), expected);
    // Different titles, and trainings in different stores.
    let [mut first, mut second] = ["1", "2"].map(|seed| trained(&format!("seed {seed}"), seed, "simulated rooms"));
    first.title = "ATSplat (a)".to_owned();
    second.title = "ATSplat (b)".to_owned();
    let stores = [first, second].map(|method| results_over(vec![preset("rooms-2v-128")], vec![method], 7));
    let sources = [Source { label: "one", results: &stores[0] }, Source { label: "two", results: &stores[1] }];
    let definition = TableDefinition::named("re10k").unwrap();
    let table = tables(&definition, &sources, Mixing::Apart).unwrap().swap_remove(0);
    assert_eq!(means(&table), ["ATSplat (a) and ATSplat (b), mean of 2 trainings"]);
    let mean = measured(&table).find(|row| row.method.is_none()).unwrap();
    assert_eq!(mean.store.as_deref(), Some("one, two"));
}

/// A scene with two index entries has two votes, in the mean over trainings too.
#[test]
fn a_mean_over_trainings_averages_as_its_rows_do() {
    let [first, second] = ["1", "2"].map(|seed| trained(&format!("seed {seed}"), seed, "simulated rooms"));
    let mut results = results_over(vec![preset("rooms-2v-128")], vec![first, floor(), second], 7);
    let worst = results.targets.iter().filter(|row| row.key.scene == "scene 6").cloned();
    let mut more: Vec<_> = worst.collect();
    for row in &mut more {
        row.key.entry = 1;
    }
    results.targets.extend(more);
    let table = built("re10k", &results);
    let of_network = measured(&table).filter(|row| !row.without_leaked && row.labels[0].starts_with("ATSplat"));
    let (means, single): (Vec<&Row>, Vec<&Row>) = of_network.partition(|row| row.method.is_none());
    assert_eq!((means.len(), single.len()), (1, 2));
    let psnr = |row: &Row| row.cells[0][0].value.number().unwrap();
    Tolerance::F64.assert([psnr(means[0])], [f64::midpoint(psnr(single[0]), psnr(single[1]))], "entries");
}

#[test]
fn stores_without_a_training_record_claim_nothing() {
    let table = built("cross_dataset", &results(vec![preset("rooms-to-yards-128")], vec![atsplat("atsplat", |_| ())]));
    assert_eq!(measured(&table).next().unwrap().printed_labels(), ["ATSplat"]);
    assert!(protocols(&store()).iter().all(Table::is_measured));
}

/// Seed 1 names its protocol by a path: nobody knows that it is the protocol of the others.
#[test]
fn trainings_whose_data_is_stated_differently_are_named() {
    let lines = |data: [&str; 3], seeds: [&str; 3]| {
        let name = |at: usize| format!("training {at}");
        let methods = (0..3).map(|at| trained(&name(at), seeds[at], data[at])).chain([floor()]).collect();
        let table = built("re10k", &results_over(vec![preset("rooms-2v-128")], methods, 7));
        let said = notes(&table, NoteKind::Trainings);
        said.lines().filter(|line| line.contains("same words")).map(str::to_owned).collect::<Vec<_>>()
    };
    let paths = ["rooms under presets/rooms.toml", "rooms under rooms", "rooms under rooms"];
    let expected = "ATSplat: trainings are only averaged if their data is stated in the same words: training 0 on rooms under \
                    presets/rooms.toml; training 1, training 2 on rooms under rooms";
    assert_eq!(lines(paths, ["1", "2", "3"]), [expected]);
    assert!(lines(["rooms under rooms"; 3], ["1", "2", "3"]).is_empty());
    assert!(lines(paths, ["1"; 3]).is_empty(), "one seed is no further training");
}
