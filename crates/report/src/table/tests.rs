use atsplat_numeric::Tolerance;
use atsplat_results::warning_kinds::MISSING_SCENES;
use atsplat_results::{MethodRecord, Results, TargetRow, TargetStatus, TrialRow, TrialStatus, WarningCount};

use super::*;
use crate::csv_text;
use crate::definition::{Quantity, TableDefinition};
use crate::emit::TableFormat;
use crate::sample::{atsplat, floor, preset, random, results, store};

pub(super) fn built(name: &str, stores: &[(&str, &Results)], mixing: Mixing) -> Vec<Table> {
    let sources: Vec<Source<'_>> = stores.iter().map(|(label, results)| Source { label, results }).collect();
    tables(&TableDefinition::named(name).unwrap(), &sources, mixing).unwrap()
}

pub(super) fn notes(table: &Table, kind: NoteKind) -> Vec<&str> {
    table.footer.iter().filter(|note| note.kind == kind).map(|note| note.text.as_str()).collect()
}

fn row_of<'a>(table: &'a Table, method: &str) -> &'a Row {
    table.rows.iter().find(|row| row.method.as_deref() == Some(method) && !row.without_leaked).unwrap()
}

#[test]
fn measured_rows_follow_the_published_rows_they_reproduce() {
    let store = store();
    let table = built("re10k", &[("run", &store)], Mixing::Apart).swap_remove(0);
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

#[test]
fn values_that_were_not_computed_have_a_reason() {
    let store = store();
    let table = built("re10k", &[("run", &store)], Mixing::Apart).swap_remove(0);
    let cell = &row_of(&table, "atsplat").cells[0][2];
    assert_eq!((&cell.value, cell.print(&table.groups[0].columns[2]).as_str()), (&Value::Absent, "n/c"));
    let reasons = notes(&table, NoteKind::NotComputed);
    assert_eq!(reasons.len(), 2, "the nearest view has no encoding to time: {reasons:?}");
    assert!(reasons[0].contains("weights absent") && reasons[0].contains("--lpips-vgg"), "{reasons:?}");
}

#[test]
fn a_partial_run_is_not_the_published_setting_and_is_ranked_separately() {
    let store = store();
    let table = built("re10k", &[("run", &store)], Mixing::Apart).swap_remove(0);
    assert!(notes(&table, NoteKind::Setting).iter().any(|text| text.contains("4 of 7194")), "{:?}", table.footer);
    let best =
        |origin| table.rows.iter().filter(|row| row.origin == origin && row.cells[0][0].mark == Mark::Best).count();
    assert_eq!((best(Origin::Published), best(Origin::Measured)), (1, 1));
    assert!(notes(&table, NoteKind::Counts).iter().any(|text| text.contains("missing-frame 1")));
    let ablation = built("ablation_ate", &[("run", &store)], Mixing::Apart).swap_remove(0);
    let counts = notes(&ablation, NoteKind::Counts);
    assert!(counts.iter().any(|text| text.contains("failed") && text.contains('3')), "{counts:?}");
    assert!(table.rows.iter().all(|row| row.method.as_deref() != Some("atsplat-random")), "an ablation's row");
}

/// The third scene of the random selection fails: its row says so, counts the scenes that it has, and its mean over the easier
/// rest wins nothing.
#[test]
fn a_row_that_lacks_targets_says_so_and_is_not_ranked() {
    let mut store = store();
    let table = built("ablation_ate", &[("run", &store)], Mixing::Apart).swap_remove(0);
    let [whole, lacking] = ["atsplat", "atsplat-random"].map(|method| row_of(&table, method));
    assert!(whole.measured_on.as_ref().unwrap().text.contains("4 of 6474 scenes"), "{:?}", whole.measured_on);
    let text = &lacking.measured_on.as_ref().unwrap().text;
    assert!(text.contains("3 of 6474 scenes, 3 of 12 targets failed"), "{text}");
    let raised = |row: &TargetRow| row.key.method == "atsplat-random";
    for row in store.targets.iter_mut().filter(|row| raised(row)) {
        row.scores.values_mut().for_each(|score| *score += 10.0);
    }
    let table = built("ablation_ate", &[("run", &store)], Mixing::Apart).swap_remove(0);
    let marks = |method: &str| row_of(&table, method).cells[0][0].mark;
    assert_eq!((marks("atsplat"), marks("atsplat-random")), (Mark::Plain, Mark::Plain));
    store.trials.iter_mut().for_each(|trial| trial.status = TrialStatus::Done);
    for row in store.targets.iter_mut().filter(|row| row.status == TargetStatus::Failed) {
        (row.status, row.scores) = (TargetStatus::Scored, [("psnr".to_owned(), 30.0)].into());
    }
    let table = built("ablation_ate", &[("run", &store)], Mixing::Apart).swap_remove(0);
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
        let table = built("re10k", &[("run", store)], Mixing::Apart).swap_remove(0);
        let [a, b] = ["a", "b"].map(|method| row_of(&table, method).cells[0][3].clone());
        assert_eq!((a.value, b.value), (Value::Number(23_040.0), Value::Number(11_520.0)));
        [a.mark, b.mark]
    };
    assert_eq!(mark(&store), [Mark::Plain, Mark::Plain]);
    store.trials.iter_mut().for_each(|trial| trial.status = TrialStatus::Done);
    assert_eq!(mark(&store), [Mark::Plain, Mark::Best]);
}

#[test]
fn one_of_several_missing_scenes_is_an_example() {
    for (count, expected) in [(3, "not in the data, such as gone"), (1, "not in the data: gone")] {
        let (preset, kind, example) = ("re10k-2v-256", MISSING_SCENES, "gone");
        let (preset, kind, example) = (preset.to_owned(), kind.to_owned(), example.to_owned());
        let mut store = store();
        store.provenance.warnings.push(WarningCount { preset, kind, count, example });
        let table = built("re10k", &[("run", &store)], Mixing::Apart).swap_remove(0);
        let said = notes(&table, NoteKind::Counts);
        assert!(said.iter().any(|text| text.ends_with(expected)), "{said:?}");
    }
}

/// Two of the network's four trials show nothing, one had broken Gaussians, and one was rendered in the classic mode because none was
/// chosen; a trial of the other protocol does not count.
#[test]
fn trials_without_a_rendered_gaussian_or_with_broken_ones_have_a_line() {
    let lines = |store: &Results| -> Vec<String> {
        let table = built("re10k", &[("run", store)], Mixing::Apart).swap_remove(0);
        let suspicious = |text: &&str| ["rendered", "drawn", "broken"].into_iter().any(|word| text.contains(word));
        notes(&table, NoteKind::Counts).into_iter().filter(suspicious).map(str::to_owned).collect()
    };
    let mut store = store();
    assert_eq!(lines(&store), [""; 0]);
    for (preset, rendered) in [("re10k-2v-256", [0.0, 7.5, 0.0, 0.25]), ("re10k-overlap", [0.0; 4])] {
        let trials = store.trials.iter_mut().filter(|trial| trial.key.is_of(preset, "atsplat"));
        for (trial, rendered) in trials.zip(rendered) {
            trial.gaussians_drawn = Some(rendered);
        }
    }
    let undrawn = "ATSplat: no Gaussian is rendered in 2 of 4 trials, whose images show the background";
    assert_eq!(lines(&store), [format!("{undrawn}; not left out of the mean")]);
    let is_of_network = |trial: &&mut TrialRow| trial.key.is_of("re10k-2v-256", "atsplat");
    let trial = store.trials.iter_mut().find(is_of_network).unwrap();
    trial.notes.push("broken Gaussians: 3 of 9 (2 with NaN not drawn, 1 repaired)".to_owned());
    let broken = "broken Gaussians were repaired or not drawn in 1 of 4 trials";
    assert_eq!(lines(&store), [format!("{undrawn}; {broken}; not left out of the mean")]);
    let trial = store.trials.iter_mut().rfind(is_of_network).unwrap();
    trial.notes.push("drawn in the classic mode: the Gaussians have 3D filters".to_owned());
    let classic =
        "Gaussians of antialiased training or with 3D filters were drawn in the classic mode in 1 of 4 trials";
    assert_eq!(lines(&store), [format!("{undrawn}; {broken}; {classic}; not left out of the mean")]);
}

#[test]
fn a_complete_run_is_ranked_with_the_paper_unless_untrained() {
    let mut full = preset("re10k-2v-256");
    full.entries_of_index = full.entries;
    let one_best = |untrained| {
        let method = MethodRecord { untrained, ..atsplat("atsplat", |_| ()) };
        let mut results = results(vec![full.clone()], vec![method, floor()]);
        results.provenance.skipped.clear();
        let table = built("re10k", &[("run", &results)], Mixing::Apart).swap_remove(0);
        assert_eq!(notes(&table, NoteKind::Setting), [""; 0]);
        assert_eq!(notes(&table, NoteKind::Untrained).len(), usize::from(untrained));
        let fastest = table.rows.iter().find(|row| row.cells[0][4].mark == Mark::Best).unwrap().labels.clone();
        let marks = row_of(&table, "atsplat").cells[0].iter().filter(|cell| cell.mark != Mark::Plain).count();
        (fastest, marks)
    };
    assert_eq!(one_best(false), (vec!["ATSplat".to_owned()], 1), "as few Gaussians as in the paper");
    assert_eq!(one_best(true).1, 0);
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
        let table = built("ablation_ate", &[("run", &results)], Mixing::Apart).swap_remove(0);
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
    tables.extend(built("dynamic_budget", &[("run", &results)], Mixing::Apart));
    for table in &tables {
        let row = row_of(table, "thresholds");
        assert_eq!((row.inference_only, row.not_retrained), (true, false), "{}", table.name);
        assert!(
            !notes(table, NoteKind::Setting).iter().any(|note| note.starts_with("changed at")),
            "{:?}",
            table.footer
        );
        assert!(!agreement(table).inference_only, "{}", table.name);
        let records = csv_text::parse(&TableFormat::Csv.write(table).unwrap()).unwrap();
        let at = records[0].iter().position(|name| name == "inference_only").unwrap();
        let says = |record: &[String]| record.iter().any(|text| text.contains("changed at inference only"));
        let marked: Vec<bool> = records[1..].iter().map(|record| record[at] == "true").collect();
        assert_eq!(marked, records[1..].iter().map(|record| says(record)).collect::<Vec<_>>(), "{}", table.name);
        assert!(marked.contains(&true) && marked.contains(&false), "{}", table.name);
        let json = serde_json::to_value(row).unwrap();
        assert_eq!(json["inference-only"], true);
    }
}

/// A file of the published name may contain other weights.
#[test]
fn weights_of_a_metric_that_are_not_the_published_ones_are_named() {
    let with = |hash: &str| {
        let mut results = store();
        let lpips = results.provenance.metrics.iter_mut().find(|metric| metric.id == "lpips").unwrap();
        (lpips.weights_sha256, lpips.absent) = (Some(hash.to_owned()), None);
        results
    };
    let [published, other] = ["397923af8e79cdbb", "0123456789abcdef"].map(with);
    let settings = |stores: &[(&str, &Results)]| {
        let table = built("re10k", stores, Mixing::Apart).swap_remove(0);
        let conventions = notes(&table, NoteKind::Convention).join("\n");
        let all = notes(&table, NoteKind::Setting).into_iter().filter(|text| text.contains("weights"));
        (conventions, all.collect::<Vec<_>>().join("\n"))
    };
    let (conventions, said) = settings(&[("a", &published), ("b", &published)]);
    assert!(conventions.contains("; weights 397923af8e79") && said.is_empty(), "{conventions}\n{said}");
    let (conventions, said) = settings(&[("a", &published), ("b", &other)]);
    assert!(conventions.contains("; weights 0123456789ab, 397923af8e79"), "{conventions}");
    assert!(said.contains("the weights 0123456789ab are not those of the published vgg16-397923af.pth"), "{said}");
    assert!(said.contains("differ between stores") && said.contains("0123456789ab in b; 397923af8e79 in a"), "{said}");
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

#[test]
fn ablation_rows_select_their_methods() {
    let store = store();
    let table = built("ablation_ate", &[("run", &store)], Mixing::Apart).swap_remove(0);
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
    let table = built("re10k_overlap", &[("run", &store)], Mixing::Apart).swap_remove(0);
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
    let table = built("re10k_overlap", &[("run", &store)], Mixing::Apart).swap_remove(0);
    let row = row_of(&table, "atsplat");
    assert!(row.cells[1..].iter().flatten().all(|cell| cell.value == Value::Absent && cell.not_computed.is_some()));
    let why = notes(&table, NoteKind::NotComputed).concat();
    assert!(why.contains("measured by epipolar-ray, the bins were published for roma"), "{why}");
    assert!(why.contains("n/c PSNR by overlap: not computed: ") && !why.contains("n/c PSNR:"), "{why}");
    assert!(why.contains("n/c LPIPS by overlap: not computed: "), "{why}");

    let forced = built("re10k_overlap", &[("run", &store)], Mixing::Forced).swap_remove(0);
    let cells = &row_of(&forced, "atsplat").cells[1..];
    let scenes: Vec<u64> = cells.iter().map(|cells| cells[0].counts.unwrap().scenes).collect();
    assert_eq!(scenes, [2, 1, 1, 4]);
    let footer = notes(&forced, NoteKind::Forced).concat();
    assert!(footer.contains("epipolar-ray") && footer.contains("because of --force"), "{footer}");
}

#[test]
fn rows_may_be_settings() {
    let store = store();
    let table = built("budget", &[("run", &store)], Mixing::Apart).swap_remove(0);
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
        let table = built(name, &[], Mixing::Apart).swap_remove(0);
        assert!(!table.is_measured() && agreement(&table).compared == 0, "{name}");
    }
    let mut nothing = results(vec![preset("re10k-2v-256")], vec![random()]);
    nothing.trials.clear();
    nothing.targets.clear();
    assert!(!built("re10k", &[("run", &nothing)], Mixing::Apart)[0].is_measured());
}

#[test]
fn times_come_from_the_timing_pass_or_are_absent_with_a_reason() {
    let time = |results: &Results, method: &str| {
        let definition = TableDefinition::named("re10k").unwrap();
        let table = tables(&definition, &[Source { label: "run", results }], Mixing::Apart).unwrap().swap_remove(0);
        let (index, column) = table.columns().find(|(_, column)| column.quantity == Quantity::Seconds).unwrap();
        let row = table.rows.iter().find(|row| row.method.as_deref() == Some(method) && !row.without_leaked).unwrap();
        let cell = row.cell(index).clone();
        let notes: Vec<String> = table.footer.iter().map(|note| note.text.clone()).collect();
        (cell.print(column), cell, notes.join("\n"))
    };
    let mut results = store();
    let (printed, cell, notes) = time(&results, "atsplat");
    let timing = cell.timing.unwrap();
    assert_eq!((printed.as_str(), timing.spread.samples, timing.trials, timing.repetitions), ("0.260", 15, 3, 5));
    assert!(notes.contains("MAD 0.00") && notes.contains("5 repetitions of 3 trials"), "{notes}");
    assert!(notes.contains("Time: a processor, 2 threads on 2 logical processors") && !notes.contains('§'), "{notes}");
    let (printed, _, notes) = time(&results, "nearest-view");
    assert_eq!(printed, "n/c");
    assert!(notes.contains("makes no Gaussians from images"), "{notes}");

    results.timings.iter_mut().for_each(|row| row.network_adapter = Some("a card (Vulkan), driver 1".to_owned()));
    let (_, _, on_card) = time(&results, "atsplat");
    assert!(on_card.contains("Time of ATSplat: network on a card (Vulkan), driver 1"), "{on_card}");
    assert!(!notes.contains("Time of"), "{notes}");
    results.timings.iter_mut().for_each(|row| row.network_adapter = None);

    results.timings.iter_mut().for_each(|row| row.load.others = Some(0.4));
    let (printed, cell, notes) = time(&results, "atsplat");
    assert_eq!((printed.as_str(), cell.mark), ("0.260 §", Mark::Plain));
    assert!(notes.contains("§ other work or a quota took 40 % of the processors"), "{notes}");
    assert_eq!(serde_json::to_value(&cell).unwrap()["timing"]["busy"], true);

    results.timings.clear();
    let (printed, cell, notes) = time(&results, "atsplat");
    assert_eq!((printed.as_str(), cell.value.number()), ("n/c", None));
    assert!(notes.contains("`atsplat run --timing` makes one"), "{notes}");
}
