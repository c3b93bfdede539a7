//! Which results share a table.

use atsplat_numeric::Tolerance;
use atsplat_results::{PresetRecord, Results, TrialKey};

use crate::definition::TableDefinition;
use crate::plot::Origin;
use crate::plot_data::table_plots;
use crate::sample::{SCENES, atsplat, nearest_view, preset, random, results, store};
use crate::table::test_tables::{notes, tables_of, two_stores};
use crate::table::{Mixing, NoteKind, Row, Source, Table, protocol_tables, tables};

#[test]
fn different_protocols_get_separate_tables_unless_forced() {
    let first = store();
    let mut second = store();
    second.provenance.presets[0].hash = "another".to_owned();
    let stores = [("first", &first), ("second", &second)];
    let apart = tables_of("re10k", &stores, Mixing::Apart);
    assert_eq!(apart.iter().map(|table| table.name.as_str()).collect::<Vec<_>>(), ["re10k-1", "re10k-2"]);
    for table in &apart {
        let stores: Vec<_> = table.rows.iter().filter_map(|row| row.store.as_deref()).collect();
        assert!(stores.windows(2).all(|pair| pair[0] == pair[1]), "{stores:?}");
        assert!(!table.forced && notes(table, NoteKind::Forced).is_empty());
    }
    let mixed = tables_of("re10k", &stores, Mixing::Forced);
    assert_eq!(mixed.len(), 1);
    assert!(mixed[0].forced && notes(&mixed[0], NoteKind::Forced).len() == 1, "the footer says so");
    assert!(
        ["first", "second"].iter().all(|store| mixed[0].rows.iter().any(|row| row.store.as_deref() == Some(store)))
    );
    let same = store();
    let together = tables_of("re10k", &[("first", &first), ("third", &same)], Mixing::Apart);
    assert_eq!(together.len(), 1, "equal protocols share a table");
    assert!(!together[0].forced);
}

#[test]
fn a_different_index_is_a_different_protocol() {
    let first = store();
    let mut second = store();
    second.provenance.presets[0].index_sha256 = "another".to_owned();
    assert_eq!(tables_of("re10k", &[("first", &first), ("second", &second)], Mixing::Apart).len(), 2);
}

/// Two presets that stand in for one published protocol, each with a number for the same method.
fn two_stand_ins() -> Results {
    let presets = vec![preset("rooms-2v-128"), preset("rooms-2v-64")];
    let mut results = results(presets, vec![atsplat("atsplat", |_| ()), nearest_view()]);
    for row in results.targets.iter_mut().filter(|row| row.key.preset == "rooms-2v-64") {
        row.scores.values_mut().for_each(|score| *score -= 5.0);
    }
    results
}

#[test]
fn two_protocols_of_one_store_get_separate_tables() {
    let results = two_stand_ins();
    let psnrs = |table: &Table| {
        let is_of_network = |row: &&Row| row.method.as_deref() == Some("atsplat") && !row.without_leaked;
        table.rows.iter().filter(is_of_network).map(|row| row.cells[0][0].value.number().unwrap()).collect::<Vec<_>>()
    };
    let apart = tables_of("re10k", &[("run", &results)], Mixing::Apart);
    assert_eq!(apart.iter().map(|table| table.name.as_str()).collect::<Vec<_>>(), ["re10k-1", "re10k-2"]);
    Tolerance::F64.assert(apart.iter().flat_map(psnrs), [24.25, 19.25], "a table for each");
    assert!(apart.iter().all(|table| !table.forced));
    let source = [Source { label: "run", results: &results }];
    let protocols = protocol_tables(&source, Mixing::Apart).unwrap();
    let names: Vec<&str> = protocols.iter().map(|table| table.name.as_str()).collect();
    assert_eq!(names, ["protocol-rooms-2v-128", "protocol-rooms-2v-64"]);
    Tolerance::F64.assert(protocols.iter().flat_map(psnrs), [24.25, 19.25], "a table for each");
    let mixed = tables_of("re10k", &[("run", &results)], Mixing::Forced);
    assert_eq!((mixed.len(), mixed[0].forced), (1, true));
    Tolerance::F64.assert(psnrs(&mixed[0]), [24.25, 19.25], "a row for each");
    let labels: Vec<String> = mixed[0].rows.iter().filter_map(|row| row.printed_labels().pop()).collect();
    for preset in ["rooms-2v-128", "rooms-2v-64"] {
        assert!(labels.contains(&format!("ATSplat, under {preset}")), "{labels:?}");
    }
}

/// Each setting of a sweep over resolutions runs under a separate preset; one of them is the protocol's resolution.
#[test]
fn settings_of_a_sweep_share_a_table_only_under_one_protocol() {
    let at = |size: &str, hash: Option<&str>| {
        let protocol = preset("rooms-2v-128");
        let name = format!("rooms-2v-128-{size}");
        PresetRecord { preset: name.clone(), name, hash: hash.map_or(protocol.hash.clone(), str::to_owned), ..protocol }
    };
    let presets = vec![preset("rooms-2v-128"), at("128x128", None), at("64x64", Some("another"))];
    let methods = ["of the protocol", "128×128", "64×64"];
    let mut results = results(presets.clone(), methods.map(|name| atsplat(name, |_| ())).to_vec());
    let was_run = |key: &TrialKey| {
        presets.iter().zip(methods).any(|(preset, name)| preset.name == key.preset && key.method == name)
    };
    results.trials.retain(|row| was_run(&row.key));
    results.targets.retain(|row| was_run(&row.key));
    let rows = |table: &Table| {
        let measured = table.rows.iter().filter(|row| row.origin == Origin::Measured && !row.without_leaked);
        measured.filter_map(|row| row.method.clone()).collect::<Vec<_>>()
    };
    let apart = tables_of("re10k", &[("run", &results)], Mixing::Apart);
    assert_eq!(apart.iter().map(rows).collect::<Vec<_>>(), [vec![methods[0], methods[1]], vec![methods[2]]]);
}

/// The plots of the second protocol's table show the numbers of that protocol.
#[test]
fn plots_show_the_protocol_of_their_table() {
    let presets = vec![preset("rooms-2v-128"), preset("rooms-2v-64")];
    let mut results = results(presets, vec![atsplat("atsplat", |_| ()), random()]);
    // In the first protocol the second method is 3 dB worse; in the second, another 5 dB.
    for row in results.targets.iter_mut().filter(|row| row.key.preset == "rooms-2v-64") {
        if row.key.method == "atsplat-random" {
            row.scores.entry("psnr".to_owned()).and_modify(|psnr| *psnr -= 5.0);
        }
    }
    for (at, trial) in results.trials.iter_mut().enumerate() {
        let gaussians = if trial.key.preset == "rooms-2v-64" { 1_000_000 } else { 50_000 };
        trial.gaussians = Some(gaussians + at as u64);
    }
    let texts = |name: &str| -> Vec<String> {
        let definition = TableDefinition::named(name).unwrap();
        let source = [Source { label: "run", results: &results }];
        let tables = tables(&definition, &source, Mixing::Apart).unwrap();
        let plots = tables.iter().map(|table| table_plots(&definition, table, &source).swap_remove(0).1);
        plots.map(|plot| plot.texts().collect::<Vec<_>>().join("\n")).collect()
    };
    let ablations = texts("ablation_ate");
    assert!(ablations[0].contains("(−3.00)") && !ablations[0].contains("(−8.00)"), "{}", ablations[0]);
    assert!(ablations[1].contains("(−8.00)") && !ablations[1].contains("(−3.00)"), "{}", ablations[1]);
    let budgets = texts("dynamic_budget");
    assert!(budgets[0].contains("K of 4") && !budgets[0].contains("M of 4"), "{}", budgets[0]);
    assert!(budgets[1].contains("M of 4") && !budgets[1].contains("K of 4"), "{}", budgets[1]);
}

/// Rows of the same protocol do not share a table if the images have changed.
#[test]
fn different_images_under_one_name_get_separate_tables() {
    let first = store();
    let mut second = store();
    let scene = second.trials[0].key.scene.clone();
    for trial in second.trials.iter_mut().filter(|trial| trial.key.scene == scene) {
        trial.data_hash = Some("of other images".to_owned());
    }
    assert_eq!(tables_of("re10k", &[("first", &first), ("second", &second)], Mixing::Apart).len(), 2);
    // Rows written before data hashes existed are compatible with all.
    second.trials.iter_mut().for_each(|trial| trial.data_hash = None);
    assert_eq!(tables_of("re10k", &[("first", &first), ("second", &second)], Mixing::Apart).len(), 1);
}

#[test]
fn an_invalid_protocol_in_a_store_is_an_error() {
    let mut broken = store();
    broken.provenance.presets[0].toml = broken.provenance.presets[0].toml.replace("scene-means", "scene-medians");
    let definition = TableDefinition::named("re10k").unwrap();
    let source = Source { label: "run", results: &broken };
    let message = tables(&definition, &[source], Mixing::Apart).unwrap_err().to_string();
    assert!(message.contains("presets, re10k-2v-256, toml") && message.contains("scene-medians"), "{message}");
    assert!(crate::plot_data::store_plots(&source).is_err());
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
