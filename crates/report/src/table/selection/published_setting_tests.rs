//! Runs of a whole index that are not the published setting all the same: on an alternative index, or without some of the trials.

use atsplat_protocol::Preset;
use atsplat_results::{MethodRecord, PresetRecord, Results, SkippedEntry, TrialKey};

use crate::plot::Origin;
use crate::sample::{SCENES, atsplat, nearest_view, preset, random, results, results_over};
use crate::table::test_tables::{notes, row_of, table_of};
use crate::table::{CellIndex, Mark, MeasuredOn, Mixing, NoteKind, Source, Table, protocol_tables};

/// The table of the paper that a protocol fills.
const TABLE_OF: [(&str, &str); 5] = [
    ("re10k-2v-256", "re10k"),
    ("re10k-to-dl3dv-256", "cross_dataset"),
    ("dl3dv-6v-256x448", "dl3dv"),
    ("dl3dv-6v-224", "dl3dv_224"),
    ("dl3dv-12v-512x960", "dl3dv_hr"),
];

fn built(results: &Results) -> Table {
    let name = &results.provenance.presets[0].name;
    let (_, table) = TABLE_OF.into_iter().find(|(preset, _)| preset == name).unwrap();
    table_of(table, results)
}

fn settings(table: &Table) -> Vec<&str> {
    notes(table, NoteKind::Setting)
}

fn measured_on<'a>(table: &'a Table, method: &str) -> &'a MeasuredOn {
    row_of(table, method).measured_on.as_ref().unwrap()
}

/// Whether a measured or a published row has the best PSNR under a protocol.
fn best(table: &Table, preset: &str) -> Vec<Origin> {
    let group = table.groups.iter().position(|group| group.preset.as_deref() == Some(preset)).unwrap();
    table
        .rows
        .iter()
        .filter(|row| row.cell(CellIndex { group, column: 0 }).mark == Mark::Best)
        .map(|row| row.origin)
        .collect()
}

/// The whole default index of a protocol, with a PSNR above all published ones.
fn whole(name: &str, methods: Vec<MethodRecord>) -> Results {
    let mut whole = preset(name);
    whole.entries_of_index = whole.entries;
    whole.index_name = Preset::named(name).unwrap().index.accepted.first().map(|index| index.name.clone());
    let mut results = results(vec![whole], methods);
    results.provenance.skipped.clear();
    for row in results.targets.iter_mut().filter(|row| !row.scores.is_empty()) {
        row.scores.insert("psnr".to_owned(), 60.0);
    }
    results
}

/// Removes the trials of an entry under these methods, or under all, for a reason.
fn skip(results: &mut Results, scene: &str, reason: &str, methods: &[&str]) {
    let preset = results.provenance.presets[0].name.clone();
    let methods = methods.iter().copied().map(str::to_owned).collect();
    let skipped =
        SkippedEntry { preset, scene: scene.to_owned(), reason: reason.to_owned(), methods, ..SkippedEntry::default() };
    let is_kept = |key: &TrialKey| key.scene != scene || !skipped.concerns(&key.method);
    results.trials.retain(|row| is_kept(&row.key));
    results.targets.retain(|row| is_kept(&row.key));
    results.provenance.skipped.push(skipped);
}

/// Both protocols accept a second file: 10 frames in place of 50, 8 targets in place of all.
#[test]
fn an_alternative_index_is_not_the_published_setting() {
    let cases = [
        ("re10k-to-dl3dv-256", "depthsplat-dl3dv-2v-10", "numbers on it are several dB higher"),
        ("dl3dv-12v-512x960", "yonosplat-dl3dv-12v", "8 random targets a scene"),
    ];
    for (name, alternative, note) in cases {
        let mut results = whole(name, vec![atsplat("a", |_| ())]);
        let table = built(&results);
        assert!(measured_on(&table, "a").published_setting && settings(&table).is_empty(), "{:?}", table.footer);
        assert!(!table.caption.contains("index") && !table.caption.contains("not comparable"), "{}", table.caption);
        assert_eq!((best(&table, name), table.groups[0].measured_on.as_ref()), (vec![Origin::Measured], None));

        results.provenance.presets[0].index_name = Some(alternative.to_owned());
        let table = built(&results);
        let on = measured_on(&table, "a");
        assert!(!on.published_setting, "{name}");
        assert!(on.text.ends_with(&format!("4 of 140 scenes, alternative index {alternative}")), "{}", on.text);
        let said = format!(", alternative index {alternative}: not comparable with the paper's numbers.");
        assert!(table.caption.ends_with(&said), "{}", table.caption);
        let said = settings(&table);
        let expected = format!("not the published setting: {name}: the index {alternative}: ");
        assert!(said.len() == 1 && said[0].starts_with(&expected) && said[0].contains(note), "{said:?}");
        assert_eq!(best(&table, name), [Origin::Published], "a single measured value is not ranked");
        let heading = format!("{name} with the index {alternative}");
        assert_eq!(table.groups[0].measured_on, Some(heading));
    }
}

/// Two of four entries: by reason, and by what the protocol states.
#[test]
fn entries_without_a_trial_are_a_difference_unless_a_published_filter_drops_them() {
    let found = |name: &str, reason: &str| {
        let mut results = whole(name, vec![atsplat("a", |_| ())]);
        skip(&mut results, SCENES[1], reason, &[]);
        skip(&mut results, SCENES[3], reason, &[]);
        let table = built(&results);
        let said = settings(&table).join("\n");
        assert_eq!(measured_on(&table, "a").published_setting, said.is_empty(), "{said}");
        assert_eq!(best(&table, name), [if said.is_empty() { Origin::Measured } else { Origin::Published }], "{said}");
        said
    };
    let lost = [
        ("re10k-2v-256", "image-size"),
        ("re10k-2v-256", "image-missing"),
        ("re10k-2v-256", "pose-unusable"),
        ("re10k-2v-256", "image-unreadable"),
        ("re10k-2v-256", "image-misfit"),
        ("re10k-2v-256", "unreadable"),
        ("re10k-2v-256", "preprocessing"),
        ("re10k-2v-256", "pose-normalisation"),
        ("re10k-2v-256", "frame-out-of-range"),
        // Filters of other protocols.
        ("re10k-2v-256", "determinant"),
        ("re10k-2v-256", "translation"),
        ("dl3dv-6v-256x448", "baseline"),
    ];
    for (name, reason) in lost {
        let expected = format!("not the published setting: {name}: 2 of 4 index entries have no trial: {reason}");
        assert_eq!(found(name, reason), expected);
    }
    let published = [
        ("re10k-2v-256", "null-entry"),
        ("re10k-2v-256", "field-of-view"),
        ("dl3dv-6v-256x448", "determinant"),
        ("dl3dv-6v-256x448", "translation"),
        // By the filter, and by pixelSplat's pose normalisation alone.
        ("dl3dv-6v-224", "baseline"),
        ("re10k-2v-256", "baseline"),
    ];
    for (name, reason) in published {
        assert_eq!(found(name, reason), "", "{name}, {reason}");
    }
}

/// One entry that published loaders drop, one that is lost for two reasons, and one of another protocol.
#[test]
fn lost_entries_are_counted_once_and_apart_from_dropped_ones() {
    let mut results = whole("re10k-2v-256", vec![atsplat("a", |_| ())]);
    skip(&mut results, SCENES[0], "field-of-view", &[]);
    skip(&mut results, SCENES[2], "unreadable", &[]);
    skip(&mut results, SCENES[2], "image-size", &[]);
    let mut elsewhere = results.provenance.skipped[1].clone();
    (elsewhere.preset, elsewhere.scene) = ("re10k-overlap".to_owned(), SCENES[1].to_owned());
    results.provenance.skipped.push(elsewhere);
    let expected = "not the published setting: re10k-2v-256: 1 of 4 index entries has no trial: unreadable";
    assert_eq!(settings(&built(&results)), [expected]);
}

/// The third entry has no poses under one of two methods: the other's row is of the published setting.
#[test]
fn an_entry_that_one_method_lacks_is_a_difference_of_its_rows_alone() {
    let mut results = whole("re10k-2v-256", vec![atsplat("a", |_| ()), nearest_view()]);
    skip(&mut results, SCENES[2], "pose-normalisation", &[&nearest_view().name]);
    let table = built(&results);
    let is_published =
        [measured_on(&table, "a"), measured_on(&table, &nearest_view().name)].map(|on| on.published_setting);
    assert_eq!(is_published, [true, false]);
    let said = "not the published setting: re10k-2v-256: 1 of 4 index entries has no trial under nearest-view: pose-normalisation";
    assert_eq!(settings(&table), [said]);
    assert_eq!(best(&table, "re10k-2v-256"), [Origin::Published], "measured rows are over different scenes");
    // In a table without that method, nothing differs.
    results.trials.retain(|row| row.key.method == "a");
    results.targets.retain(|row| row.key.method == "a");
    let table = built(&results);
    assert_eq!((settings(&table), best(&table, "re10k-2v-256")), (vec![], vec![Origin::Measured]));
    assert_eq!(table.groups[0].measured_on, None);
}

/// The protocol's number of scenes is that of its published index: 24 scenes of 30 are not all.
#[test]
fn the_scenes_of_an_unpublished_index_are_counted_in_that_index() {
    let said = |name: &str, run: usize, index: Option<u64>, entries: [u64; 2]| {
        let [entries, entries_of_index] = entries;
        let record =
            PresetRecord { index_name: None, scenes_of_index: index, entries, entries_of_index, ..preset(name) };
        let results = results_over(vec![record], vec![atsplat("atsplat", |_| ())], run);
        let found = protocol_tables(&[Source { label: "run", results: &results }], Mixing::Apart).unwrap();
        measured_on(&found[0], "atsplat").text.clone()
    };
    for (run, index, entries, expected) in [
        (24, Some(30), [24, 30], "24 of 30 scenes, unpublished index"),
        (12, Some(12), [12, 12], "all 12 scenes, unpublished index"),
        (4, Some(6), [8, 12], "4 of 6 scenes, unpublished index"),
        // Older stores have numbers of entries alone.
        (24, None, [24, 30], "24 scenes, 24 of 30 index entries, unpublished index"),
        (12, None, [12, 12], "all 12 scenes, unpublished index"),
    ] {
        let text = said("rooms-2v-128", run, index, entries);
        assert_eq!(text, format!("simulated rooms, 16×16, {expected}"), "{run} of {index:?}");
    }
    let of_capture = [Some(6), Some(4), None].map(|index| said("photos-3v-256", 4, index, [4, 4]));
    assert_eq!(of_capture, ["4 of 6", "all 4", "4"].map(|scenes| format!("capture re10k, 16×16, {scenes} scenes")));
    let mut named = preset("rooms-2v-128");
    named.scenes_of_index = Some(4);
    let named = results_over(vec![named], vec![atsplat("atsplat", |_| ())], 4);
    let found = protocol_tables(&[Source { label: "run", results: &named }], Mixing::Apart).unwrap();
    assert_eq!(
        measured_on(&found[0], "atsplat").text,
        "simulated rooms, 16×16, 4 of 24 scenes",
        "the protocol's index"
    );
}

/// The run of `a` was killed before the second scene; the third method was never requested under this protocol.
#[test]
fn a_run_that_has_not_ended_is_not_the_published_setting() {
    let whole = |name: &str| {
        let mut whole = preset(name);
        whole.entries_of_index = whole.entries;
        let mut results = results(vec![whole], vec![atsplat("a", |_| ()), nearest_view(), random()]);
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
    let table = table_of("re10k", &results);
    assert!(is_published(&table) && notes(&table, NoteKind::Setting).is_empty(), "{:?}", table.footer);
    kill(&mut results);
    let table = table_of("re10k", &results);
    let said = "not the published setting: re10k-2v-256: the run is unfinished: 3 of 4 entries under a";
    assert_eq!(notes(&table, NoteKind::Setting), [said]);
    assert!(!is_published(&table) && table.caption.ends_with("not comparable with the paper's numbers."));
    // Of a stand-in, both are said.
    let mut results = whole("rooms-2v-128");
    kill(&mut results);
    let said = notes(&table_of("re10k", &results), NoteKind::Setting).join("\n");
    assert!(said.contains("stands in for re10k-2v-256") && said.contains("3 of 4 entries under a"), "{said}");
}
