//! What a table says of conventions, weights, renderers and training data, and of what was not computed.

use atsplat_results::{MethodRecord, Results, RunWarning, SkippedEntry, TrainingRecord, WarningCount};

use crate::sample::{nearest_view, preset, random, results, results_over, store};
use crate::table::test_tables::{notes, notes_as_text, row_of, table_of, tables_of, trained};
use crate::table::{Mixing, NoteKind, Value};

#[test]
fn values_that_were_not_computed_have_a_reason() {
    let store = store();
    let table = table_of("re10k", &store);
    let cell = &row_of(&table, "atsplat").cells[0][2];
    assert_eq!((&cell.value, cell.print(&table.groups[0].columns[2]).as_str()), (&Value::Absent, "n/c"));
    let reasons = notes(&table, NoteKind::NotComputed);
    assert_eq!(reasons.len(), 2, "the nearest view has no encoding to time: {reasons:?}");
    assert!(reasons[0].contains("weights absent") && reasons[0].contains("--lpips-vgg"), "{reasons:?}");
}

#[test]
fn one_of_several_missing_scenes_is_an_example() {
    for (count, expected) in [(3, "not in the data, such as gone"), (1, "not in the data: gone")] {
        let (preset, example) = ("re10k-2v-256".to_owned(), "gone".to_owned());
        let kind = RunWarning::MissingScenes.to_string();
        let mut store = store();
        store.provenance.warnings.push(WarningCount { preset, kind, count, example });
        let table = table_of("re10k", &store);
        let said = notes(&table, NoteKind::Counts);
        assert!(said.iter().any(|text| text.ends_with(expected)), "{said:?}");
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
        let table = tables_of("re10k", stores, Mixing::Apart).swap_remove(0);
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
fn an_entry_that_is_skipped_for_two_reasons_counts_once() {
    let mut results = store();
    let other = results.provenance.skipped[0].clone();
    results.provenance.skipped.push(SkippedEntry { reason: "baseline".to_owned(), ..other });
    let said = notes_as_text(&table_of("re10k", &results), NoteKind::Counts);
    assert!(said.contains("1 index entry skipped (missing-frame 1, baseline 1)"), "{said}");
}

/// iLRM's entry in the protocol has a renderer, `DepthSplat`'s has none.
#[test]
fn the_renderer_of_a_setting_is_named() {
    let named = |setting: &str, constants: &str, background: Option<[f64; 3]>| {
        let mut results = store();
        let record = &mut results.provenance.methods[0];
        record.kind = "exec".to_owned();
        record.constants = Some(constants.to_owned());
        record.record_setting(Some(setting));
        record.record_background(background);
        let table = table_of("re10k", &results);
        let found = table.footer.into_iter().find(|note| note.text.contains(" is rendered as "));
        found.map(|note| note.text)
    };
    assert_eq!(
        named("iLRM", MethodRecord::OF_PRESET, None).as_deref(),
        Some("ATSplat is rendered as re10k-2v-256 lists for iLRM: gsplat, on [1.0, 1.0, 1.0]")
    );
    assert_eq!(
        named("iLRM", MethodRecord::OF_PRESET, Some([0.0; 3])).as_deref(),
        Some("ATSplat is rendered as re10k-2v-256 lists for iLRM: gsplat")
    );
    assert_eq!(named("DepthSplat", MethodRecord::OF_PRESET, None), None);
    assert_eq!(named("iLRM", "inria", None), None, "constants that were chosen");
}

/// Its rows have no method as a whole. The ablation is in none of them.
#[test]
fn the_unified_table_says_what_its_networks_were_trained_on() {
    let joint = trained("joint", "1", "rooms train 0 to 9, yards train 0 to 9");
    let training = Some(TrainingRecord { data: "simulated yards".to_owned(), seed: None });
    let methods = vec![trained("atsplat", "1", "simulated rooms"), joint, MethodRecord { training, ..random() }];
    let table = table_of("unified", &results(vec![preset("rooms-2v-128"), preset("yards-2v-128x224")], methods));
    let said = notes_as_text(&table, NoteKind::Convention);
    let lines: Vec<&str> = said.lines().filter(|line| line.contains("trained on")).collect();
    let expected = ["simulated rooms", "rooms train 0 to 9, yards train 0 to 9"];
    assert_eq!(lines, expected.map(|data| format!("ATSplat: trained on {data}")));
}

/// Seed 1 names its protocol by a path: nobody knows that it is the protocol of the others.
#[test]
fn trainings_whose_data_is_stated_differently_are_named() {
    let lines = |data: [&str; 3], seeds: [&str; 3]| {
        let name = |at: usize| format!("training {at}");
        let methods = (0..3).map(|at| trained(&name(at), seeds[at], data[at])).chain([nearest_view()]).collect();
        let table = table_of("re10k", &results_over(vec![preset("rooms-2v-128")], methods, 7));
        let said = notes_as_text(&table, NoteKind::Trainings);
        said.lines().filter(|line| line.contains("same words")).map(str::to_owned).collect::<Vec<_>>()
    };
    let paths = ["rooms under presets/rooms.toml", "rooms under rooms", "rooms under rooms"];
    let expected = "ATSplat: trainings are only averaged if their data is stated in the same words: training 0 on rooms under \
                    presets/rooms.toml; training 1, training 2 on rooms under rooms";
    assert_eq!(lines(paths, ["1", "2", "3"]), [expected]);
    assert!(lines(["rooms under rooms"; 3], ["1", "2", "3"]).is_empty());
    assert!(lines(paths, ["1"; 3]).is_empty(), "one seed is no further training");
}
