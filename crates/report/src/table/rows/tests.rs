//! Which rows a table has, and which results fill them.

use atsplat_files::csv;
use atsplat_numeric::Tolerance;
use atsplat_results::{MethodRecord, TrialKey};

use crate::definition::TableDefinition;
use crate::emit::TableFormat;
use crate::plot::Origin;
use crate::sample::{atsplat, preset, random, results, store};
use crate::table::test_tables::{measured, notes, row_of, table_of, tables_of, trained};
use crate::table::{Mixing, NoteKind, Row, Source, Value, agreement, protocol_tables};

#[test]
fn measured_rows_follow_the_published_rows_they_reproduce() {
    let store = store();
    let table = table_of("re10k", &store);
    let ours = table.rows.iter().position(|row| row.labels == ["ATSplat"]).unwrap();
    assert_eq!(table.rows[ours + 1].method.as_deref(), Some("atsplat"));
    assert!(table.rows[ours + 2].without_leaked, "followed by the same row without leaked targets");
    assert_eq!(row_of(&table, "nearest-view").published_row, None);
    // By hand: scenes at 27, 25, 23, 21 dB plus a mean of 0.25 over targets.
    let psnr = row_of(&table, "atsplat").cells[0][0].value.number().unwrap();
    Tolerance::F64.assert([psnr], [24.25], "mean over scenes");
    assert_eq!(row_of(&table, "atsplat").cells[0][3].value, Value::Number(23_040.0));
    assert_eq!(row_of(&table, "nearest-view").cells[0][3].value, Value::Absent);
    // Without the leaked target the first scene is 27.125.
    let without = table.rows[ours + 2].cells[0][0].value.number().unwrap();
    Tolerance::F64.assert([without], [(27.125 + 25.25 + 23.25 + 21.25) / 4.0], "without leaked");
}

/// Only the ablation is marked, and only while it shares its weights with the network that it was taken from.
#[test]
fn an_ablation_with_the_weights_of_the_full_network_is_marked() {
    let ablation = |weights: &str| {
        let mut method = random();
        method.weights_sha256 = Some(weights.to_owned());
        method
    };
    let full = atsplat("atsplat", |_| ());
    let shared = full.weights_sha256.clone().unwrap();
    for (weights, expected) in [(shared.as_str(), true), ("of another training", false)] {
        let results = results(vec![preset("re10k-2v-256")], vec![full.clone(), ablation(weights)]);
        let table = table_of("ablation_ate", &results);
        let random = row_of(&table, "atsplat-random");
        assert_eq!((random.inference_only, random.not_retrained), (expected, expected));
        assert!(!row_of(&table, "atsplat").inference_only);
        let said = |row: &Row| row.printed_labels()[0].ends_with("changed at inference only");
        assert_eq!(said(row_of(&table, "atsplat-random")), expected);
        assert!(!said(row_of(&table, "atsplat")));
        assert_eq!(notes(&table, NoteKind::Setting).iter().any(|note| note.starts_with("changed at")), expected);
    }
}

/// The paper chooses thresholds at inference too: files say that the row was changed, and nothing says that the paper trains it.
#[test]
fn files_mark_the_rows_whose_labels_say_that_they_were_changed_at_inference() {
    let thresholds = atsplat("thresholds", |config| *config = config.with_thresholds(&[0.1, 0.1, 0.4]).unwrap());
    let results = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ()), thresholds]);
    let source = Source { label: "run", results: &results };
    let mut tables = protocol_tables(&[source], Mixing::Apart).unwrap();
    tables.extend(tables_of("dynamic_budget", &[("run", &results)], Mixing::Apart));
    for table in &tables {
        let row = row_of(table, "thresholds");
        assert_eq!((row.inference_only, row.not_retrained), (true, false), "{}", table.name);
        assert!(
            !notes(table, NoteKind::Setting).iter().any(|note| note.starts_with("changed at")),
            "{:?}",
            table.footer
        );
        assert!(!agreement(table).inference_only, "{}", table.name);
        let records = csv::parse(&TableFormat::Csv.write(table).unwrap()).unwrap();
        let at = records[0].iter().position(|name| name == "inference_only").unwrap();
        let says = |record: &[String]| record.iter().any(|text| text.contains("changed at inference only"));
        let marked: Vec<bool> = records[1..].iter().map(|record| record[at] == "true").collect();
        assert_eq!(marked, records[1..].iter().map(|record| says(record)).collect::<Vec<_>>(), "{}", table.name);
        assert!(marked.contains(&true) && marked.contains(&false), "{}", table.name);
        let json = serde_json::to_value(row).unwrap();
        assert_eq!(json["inference-only"], true);
    }
}

#[test]
fn ablation_rows_select_their_methods() {
    let store = store();
    let table = table_of("ablation_ate", &store);
    let measured: Vec<_> =
        table.rows.iter().filter(|row| row.origin == Origin::Measured && !row.without_leaked).collect();
    assert_eq!(measured.iter().map(|row| row.labels[0].as_str()).collect::<Vec<_>>(), ["Random", "Uncertainty"]);
    assert_eq!(measured[0].method.as_deref(), Some("atsplat-random"));
    let found = agreement(&table);
    assert_eq!((found.compared, found.undecided), (4, 1), "four scenes have no interval");
    let said = found.to_string();
    let lacking = "not comparable: measured on RE10K, 16×16, 3 of 6474 scenes, 3 of 12 targets failed; RE10K";
    assert!(said.starts_with(lacking) && said.contains("4 of 6474 scenes; orders: 0 kept"), "{said}");
    assert!(said.contains("fewer than 6 scenes"), "{said}");
}

#[test]
fn bins_are_taken_from_the_protocol() {
    let store = store();
    let table = table_of("re10k_overlap", &store);
    let row = row_of(&table, "atsplat");
    // Overlaps 0.1, 0.3, 0.5, 0.7: two small, one medium, one large.
    let scenes: Vec<u64> = row.cells[1..].iter().map(|cells| cells[0].counts.unwrap().scenes).collect();
    assert_eq!(scenes, [2, 1, 1, 4]);
}

/// The same overlap values as above, by a different estimator.
#[test]
fn overlaps_of_another_estimator_are_not_binned_unless_forced() {
    let mut store = store();
    for preset in &mut store.provenance.presets {
        preset.overlap_estimators = vec!["epipolar-ray".to_owned()];
    }
    let table = table_of("re10k_overlap", &store);
    let row = row_of(&table, "atsplat");
    assert!(row.cells[1..].iter().flatten().all(|cell| cell.value == Value::Absent && cell.not_computed.is_some()));
    let why = notes(&table, NoteKind::NotComputed).concat();
    assert!(why.contains("measured by epipolar-ray, the bins were published for roma"), "{why}");
    assert!(why.contains("n/c PSNR by overlap: not computed: ") && !why.contains("n/c PSNR:"), "{why}");
    assert!(why.contains("n/c LPIPS by overlap: not computed: "), "{why}");

    let forced = tables_of("re10k_overlap", &[("run", &store)], Mixing::Forced).swap_remove(0);
    let cells = &row_of(&forced, "atsplat").cells[1..];
    let scenes: Vec<u64> = cells.iter().map(|cells| cells[0].counts.unwrap().scenes).collect();
    assert_eq!(scenes, [2, 1, 1, 4]);
    let footer = notes(&forced, NoteKind::Forced).concat();
    assert!(footer.contains("epipolar-ray") && footer.contains("because of --force"), "{footer}");
}

#[test]
fn rows_may_be_settings() {
    let store = store();
    let table = table_of("budget", &store);
    let row = row_of(&table, "atsplat");
    assert_eq!(row.labels, ["RE10K", "16×16", "2"], "the size of the measured images");
    let counts: Vec<_> = row.cells[0].iter().map(|cell| cell.value.number().unwrap()).collect();
    Tolerance::EXACT.assert(counts, [512.0, 1440.0, 23_040.0], "counts");
    let found = agreement(&table);
    assert_eq!((found.compared, found.equal_as_printed), (3, 3));
    assert_eq!(found.headline.unwrap().to_string(), "RE10K 256×256 2, #Gauss.: measured 23040; published 23040");
}

#[test]
fn without_measurements_only_the_published_rows_remain() {
    for name in TableDefinition::names() {
        let table = tables_of(name, &[], Mixing::Apart).swap_remove(0);
        assert!(!table.is_measured() && agreement(&table).compared == 0, "{name}");
    }
    let mut nothing = results(vec![preset("re10k-2v-256")], vec![random()]);
    nothing.trials.clear();
    nothing.targets.clear();
    assert!(!tables_of("re10k", &[("run", &nothing)], Mixing::Apart)[0].is_measured());
}

#[test]
fn unified_columns_are_filled_by_unified_weights_alone() {
    let presets = || vec![preset("rooms-2v-128"), preset("yards-2v-128x224")];
    let filled = |methods: Vec<MethodRecord>| {
        let table = table_of("unified", &results(presets(), methods));
        let row = measured(&table).next().unwrap().clone();
        [0, 1].map(|group| row.cells[group][0].value.number().is_some())
    };
    let separate = || trained("atsplat", "1", "simulated rooms");
    let unified = || trained("joint", "1", "rooms train 0 to 9 + yards train 0 to 9");
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
    let table = table_of("unified", &results);
    let rows = measured(&table).filter(|row| !row.without_leaked);
    let protocols = rows.flat_map(|row| row.protocols.iter().flatten());
    let methods: Vec<&str> = protocols.map(|protocol| protocol.method.as_str()).collect();
    assert_eq!(methods, ["for rooms", "for yards"]);
}
