//! Rows over several trainings, and networks outside their training data.

use atsplat_numeric::{Tolerance, distinct};
use atsplat_results::MethodRecord;

use crate::definition::TableDefinition;
use crate::sample::{atsplat, nearest_view, preset, random, results, results_over, store};
use crate::table::test_tables::{measured, notes_as_text, protocols, table_of, table_of_stores, trained};
use crate::table::{Counts, Mixing, NoteKind, Row, Source, Table, tables};

#[test]
fn a_network_outside_its_training_data_says_so() {
    let rooms = || vec![trained("atsplat", "1", "simulated rooms, train split"), nearest_view()];
    let yards = table_of("cross_dataset", &results(vec![preset("rooms-to-yards-128")], rooms()));
    let all = measured(&yards).filter(|row| !row.without_leaked);
    let labels: Vec<String> = all.map(|row| row.printed_labels().concat()).collect();
    assert_eq!(labels, ["ATSplat, zero-shot: not trained on yards", "Nearest view"]);
    let inside = table_of("re10k", &results(vec![preset("rooms-2v-128")], rooms()));
    assert_eq!(measured(&inside).next().unwrap().printed_labels(), ["ATSplat"]);
    assert!(notes_as_text(&inside, NoteKind::Convention).contains("ATSplat: trained on simulated rooms, train split"));
}

/// "All methods are trained on RealEstate10K and evaluated on DL3DV without fine-tuning": other networks are beside the paper's, not
/// compared with its row.
#[test]
fn a_network_that_was_trained_on_the_data_is_no_row_of_zero_shot_transfer() {
    let networks = ["simulated rooms", "simulated yards; before: simulated rooms"].map(|data| trained(data, "1", data));
    let table = table_of("cross_dataset", &results(vec![preset("rooms-to-yards-128")], networks.to_vec()));
    let all: Vec<&Row> = measured(&table).filter(|row| !row.without_leaked).collect();
    let reproduces: Vec<_> = all.iter().map(|row| (row.method.as_deref(), row.published_row.is_some())).collect();
    let expected = [("simulated rooms", true), ("simulated yards; before: simulated rooms", false)];
    assert_eq!(reproduces, expected.map(|(method, is_compared)| (Some(method), is_compared)));
}

/// Three trainings that differ by 3 dB: their mean with both spreads, and a row for each.
#[test]
fn several_trainings_share_a_row() {
    let seeds = ["1", "2", "3"].map(|seed| trained(&format!("seed {seed}"), seed, "simulated rooms"));
    let all = seeds.iter().cloned().chain([nearest_view()]).collect();
    let table = table_of("re10k", &results_over(vec![preset("rooms-2v-128")], all, 7));
    let mean = measured(&table).find(|row| row.remarks.iter().any(|remark| remark == "mean of 3 trainings")).unwrap();
    let single: Vec<&Row> =
        measured(&table).filter(|row| row.method.as_deref().is_some_and(|method| method.starts_with("seed"))).collect();
    assert_eq!(single.iter().filter(|row| !row.without_leaked).count(), 3);
    let trainings = mean.cells[0][0].trainings.unwrap();
    let counts = Counts { scenes: 6, targets: 54, failed: 3, ..Counts::default() };
    assert_eq!(mean.cells[0][0].counts, Some(counts), "of all trainings: the first has no failure");
    assert!(mean.measured_on.as_ref().unwrap().text.contains("3 of 21 targets failed"), "{:?}", mean.measured_on);
    let said = notes_as_text(&table, NoteKind::Counts);
    let expected = "mean of 3 trainings: 6 scenes, 54 targets of 3 trainings, 3 failed and not in the mean";
    assert!(said.contains(expected), "{said}");
    // The second method of the sample fails in the third scene: six are common. 27.25 − 2 · at, without at = 2.
    let scenes = [27.25, 25.25, 21.25, 19.25, 17.25, 15.25].map(|psnr| psnr - 3.0);
    let expected = scenes.iter().sum::<f64>() / 6.0;
    Tolerance::relative(1e-9).assert([mean.cells[0][0].value.number().unwrap()], [expected], "mean");
    Tolerance::relative(1e-9).assert([trainings.training_deviation], [3.0], "trainings 3 dB apart");
    let variance = scenes.iter().map(|psnr| (psnr - expected).powi(2)).sum::<f64>() / 5.0;
    Tolerance::relative(1e-9).assert([trainings.scene_deviation], [variance.sqrt()], "scenes");
    let said = notes_as_text(&table, NoteKind::Trainings);
    assert!(said.contains("PSNR has the standard deviation 3.00 over 3 trainings and"), "{said}");
    // Another seed of other data is another network.
    let mixed = vec![trained("a", "1", "simulated rooms"), trained("b", "2", "simulated yards")];
    let table = table_of("re10k", &results_over(vec![preset("rooms-2v-128")], mixed, 7));
    assert!(measured(&table).all(|row| row.cells[0][0].trainings.is_none()));
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
    assert_eq!(means(&table_of("re10k", &results)), expected);
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
    let mut results = results_over(vec![preset("rooms-2v-128")], vec![first, nearest_view(), second], 7);
    let worst = results.targets.iter().filter(|row| row.key.scene == "scene 6").cloned();
    let mut more: Vec<_> = worst.collect();
    for row in &mut more {
        row.key.entry = 1;
    }
    results.targets.extend(more);
    let table = table_of("re10k", &results);
    let of_network = measured(&table).filter(|row| !row.without_leaked && row.labels[0].starts_with("ATSplat"));
    let (means, single): (Vec<&Row>, Vec<&Row>) = of_network.partition(|row| row.method.is_none());
    assert_eq!((means.len(), single.len()), (1, 2));
    let psnr = |row: &Row| row.cells[0][0].value.number().unwrap();
    Tolerance::F64.assert([psnr(means[0])], [f64::midpoint(psnr(single[0]), psnr(single[1]))], "entries");
}

#[test]
fn stores_without_a_training_record_claim_nothing() {
    let table =
        table_of("cross_dataset", &results(vec![preset("rooms-to-yards-128")], vec![atsplat("atsplat", |_| ())]));
    assert_eq!(measured(&table).next().unwrap().printed_labels(), ["ATSplat"]);
    assert!(protocols(&store()).iter().all(Table::is_measured));
}

/// LPIPS under other weights is another metric; unknown weights may be the same.
#[test]
fn trainings_with_other_weights_of_a_metric_have_no_mean_of_it() {
    let mean = |weights: [Option<&str>; 2]| {
        let of_seed = |(seed, weights): (&str, Option<&str>)| {
            let method = trained(&format!("seed {seed}"), seed, "simulated rooms");
            let mut results = results_over(vec![preset("rooms-2v-128")], vec![method], 7);
            for record in results.provenance.metrics.iter_mut().filter(|record| record.id == "lpips") {
                (record.weights_sha256, record.absent) = (weights.map(str::to_owned), None);
            }
            for row in &mut results.targets {
                row.not_computed.clear();
                row.scores.insert("lpips".to_owned(), 0.25);
            }
            results
        };
        let [first, second] = [("1", weights[0]), ("2", weights[1])].map(of_seed);
        let table = table_of_stores("re10k", &[&first, &second]);
        let row = measured(&table).find(|row| row.method.is_none()).unwrap();
        let numbers = [0, 2].map(|column| row.cells[0][column].value.number().is_some());
        (numbers, row.cells[0][2].not_computed.clone(), notes_as_text(&table, NoteKind::NotComputed))
    };
    let (one, other) = (Some("397923af8e79cdbb"), Some("0123"));
    for weights in [[one, one], [one, None], [None, other]] {
        assert_eq!(mean(weights).0, [true, true], "{weights:?}");
    }
    let (numbers, why, said) = mean([one, other]);
    assert_eq!((numbers, why.as_deref()), ([true, false], Some("the weights of LPIPS differ between the trainings")));
    assert!(said.contains("n/c LPIPS: not computed: the weights of LPIPS differ between the trainings"), "{said}");
}
