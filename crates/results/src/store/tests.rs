mod damaged;
mod impossible;
mod merge;
mod replace;
mod unfinished;

use std::collections::BTreeMap;

use super::schema::{self, Column, Kind, Schema};
use super::table::PolarsOutcome;
use super::*;
use crate::times::{Load, TimingRow};
use crate::{
    MethodRecord, PresetRecord, Shard, SkippedEntry, TargetStatus, TrialKey, TrialStatus, WarningCount, sample_rows,
};

fn key(scene: &str) -> TrialKey {
    TrialKey { preset: "p".to_owned(), method: "m".to_owned(), scene: scene.to_owned(), entry: 0 }
}

/// A row whose fields differ from the sample's where the columns' types do.
fn trial(scene: &str) -> TrialRow {
    TrialRow {
        key: key(scene),
        status: TrialStatus::Partial,
        detail: Some("1 of 2 failed".to_owned()),
        final_tokens: None,
        gaussians: Some(1 << 40),
        gaussians_drawn: Some(0.1),
        context_psnr: Some(31.0 + 1.0 / 3.0),
        peak_bytes: None,
        network_adapter: Some("one card".to_owned()),
        renderer_adapter: Some("another card".to_owned()),
        effects: vec!["background".to_owned()],
        height: 128,
        ..sample_rows::trial("m", scene, 0, 2)
    }
}

fn targets(scene: &str) -> Vec<TargetRow> {
    let row = |target, status, scores: &[(&str, f64)]| TargetRow {
        key: key(scene),
        signed_distance: -3,
        leaked: target == 1,
        overlap: Some(0.25),
        height: 128,
        render_hash: None,
        status,
        scores: scores.iter().map(|(id, score)| ((*id).to_owned(), *score)).collect(),
        not_computed: BTreeMap::from([("lpips".to_owned(), "weights absent".to_owned())]),
        ..sample_rows::target("m", scene, 0, target, "psnr", 0.0)
    };
    let scored = row(0, TargetStatus::Scored, &[("psnr", 0.1 + 0.2), ("ssim", 5e-324)]);
    vec![scored, row(1, TargetStatus::Failed, &[])]
}

fn timing(scene: &str, machine: u32) -> TimingRow {
    let mut row = sample_rows::timing("m", scene, &[0.1, 1.0 / 3.0], &[5e-324, 0.2, 0.3, 0.4]);
    row.machine.processor = format!("processor {machine}");
    TimingRow {
        key: key(scene),
        renderer_adapter: Some("a card".to_owned()),
        started: 1_700_000_000,
        stages: BTreeMap::from([("coarse".to_owned(), vec![0.2, 0.3]), ("head".to_owned(), vec![0.1, 0.4])]),
        held_bytes: Some(7),
        peak_bytes: None,
        load: Load { average_before: Some(0.5), mhz_after: Some(2600.0), others: Some(0.02), ..Load::default() },
        ..row
    }
}

fn filled(folder: &Path, scenes: &[&str]) -> Store {
    let store = Store::create(folder, Provenance::default()).unwrap();
    for scene in scenes {
        store.append(&trial(scene), &targets(scene)).unwrap();
    }
    store
}

/// Takes the hash of a table out of the records, as of a store of an older version, or of a run that is just replacing the table.
fn forget_hash(folder: &Path, table: &str) {
    let path = folder.join(PROVENANCE);
    let mut records: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    let stated = records[hashes::FIELD].as_object_mut().unwrap();
    stated.remove(table).unwrap();
    if stated.is_empty() {
        records.as_object_mut().unwrap().remove(hashes::FIELD);
    }
    fs::write(&path, records.to_string()).unwrap();
}

/// Replaces a table whose hash the records do not state.
fn put_table(folder: &Path, table: &str, frame: PolarsOutcome) {
    let path = folder.join(table);
    fs::write(&path, table::encoded(&path, frame).unwrap()).unwrap();
    forget_hash(folder, table);
}

#[test]
fn the_schema_is_the_committed_one() {
    let written = Schema {
        targets: targets::columns(&[]).described(),
        trials: trials::columns(&[]).described(),
        timings: timings::columns(&[]).described(),
    };
    let text = schema::text(SCHEMA_VERSION).unwrap();
    assert_eq!(written.to_text(), text, "the rows changed: add a version to crates/results/schema, never change one");
    assert_eq!(Schema::of_version(SCHEMA_VERSION), Some(written));
    let sums = include_str!("../../schema/SHA256SUMS");
    let committed: Vec<String> =
        (1..=SCHEMA_VERSION).map(|version| format!("{}  v{version}.txt\n", schema::hash(version).unwrap())).collect();
    assert_eq!(committed.concat(), sums);
    let page = include_str!("../../schema/README.md");
    let has_row = |version: u32| page.contains(&format!("\n| {version} | "));
    assert!((1..=SCHEMA_VERSION).all(has_row) && !has_row(SCHEMA_VERSION + 1), "the README says what each changes");
    assert_eq!(schema::text(0), None);
    assert_eq!(schema::text(SCHEMA_VERSION + 1), None);
}

/// Those of the first store stay in front, and what is wrong with one is not said of another.
#[test]
fn several_stores_are_read_in_their_order_with_an_error_for_each() {
    let folder = tempfile::tempdir().unwrap();
    let stores = ["b", "missing", "a", "damaged"].map(|name| folder.path().join(name));
    let [b, _, a, damaged] = &stores;
    filled(b, &["b1", "b2"]).finish().unwrap();
    filled(a, &["a1"]).finish().unwrap();
    filled(damaged, &["d"]).finish().unwrap();
    fs::write(damaged.join(TRIALS), "no table").unwrap();
    let read = Results::read_each(&stores);
    let found = read.iter().map(|read| match read {
        Ok(results) => results.trials.iter().map(|trial| trial.key.scene.as_str()).collect::<Vec<_>>().join(" "),
        Err(ResultsError::NoStore { folder }) => format!("no store: {}", folder.file_name().unwrap().display()),
        Err(error) => error.to_string(),
    });
    let found: Vec<String> = found.collect();
    assert_eq!(found[..3], ["b1 b2", "no store: missing", "a1"]);
    assert!(found[3].contains("damaged"), "{}", found[3]);
    assert_eq!(Results::read_each::<PathBuf>(&[]).len(), 0);
}

#[test]
fn rows_are_bit_identical_from_parts_and_tables() {
    let folder = tempfile::tempdir().unwrap();
    let store = filled(folder.path(), &["b", "a", "ü/x"]);
    let expected: Vec<TrialRow> = ["a", "b", "ü/x"].map(trial).to_vec();
    let all_targets: Vec<TargetRow> = ["a", "b", "ü/x"].iter().flat_map(|scene| targets(scene)).collect();
    let parts = Results::read(folder.path()).unwrap();
    assert_eq!((&parts.trials, &parts.targets), (&expected, &all_targets));
    let finished = store.finish().unwrap();
    assert_eq!(Results::read(folder.path()).unwrap(), finished);
    assert_eq!((finished.trials, finished.targets), (expected, all_targets));
    assert!(!parts::folder(folder.path()).exists());
    assert_eq!(parts.provenance.schema_hash, schema_hash());
}

/// Version 3 had no PSNR on the context, version 2 no adapters either.
#[test]
fn stores_of_older_versions_are_read_with_nulls_and_not_resumed() {
    for (version, added) in [(3, &["context-psnr"][..]), (2, &["context-psnr", "network-adapter", "renderer-adapter"])]
    {
        of_version(version, added);
    }
}

fn of_version(version: u32, added: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let store = filled(folder.path(), &["a"]);
    store.add_timings(vec![timing("a", 1)]).unwrap();
    let newest = store.finish().unwrap();
    let (trial, timing) = (&newest.trials[0], &newest.timings[0]);
    assert!(trial.network_adapter.is_some() && timing.renderer_adapter.is_some() && trial.context_psnr.is_some());
    let older = |frame: PolarsOutcome| frame.map(|frame| frame.drop_many(added.iter().copied()));
    put_table(folder.path(), TRIALS, older(trials::columns(&newest.trials).frame()));
    put_table(folder.path(), timings::TIMINGS, older(timings::columns(&newest.timings).frame()));
    let path = folder.path().join(PROVENANCE);
    let mut value: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    value["schema-version"] = version.into();
    value["schema-hash"] = schema::hash(version).unwrap().into();
    fs::write(&path, value.to_string()).unwrap();
    let read = Results::read(folder.path()).unwrap();
    let kept = |adapter: &Option<String>| adapter.clone().filter(|_| !added.contains(&"network-adapter"));
    let without = |row: &TrialRow| TrialRow {
        context_psnr: None,
        network_adapter: kept(&row.network_adapter),
        renderer_adapter: kept(&row.renderer_adapter),
        ..row.clone()
    };
    assert_eq!(read.trials, newest.trials.iter().map(without).collect::<Vec<_>>());
    assert_eq!(read.timings, [TimingRow { renderer_adapter: kept(&timing.renderer_adapter), ..timing.clone() }]);
    let refused = Store::resume(folder.path(), Provenance::default()).unwrap_err().to_string();
    let versions = format!("schema versions of the two runs differ: {version} and {SCHEMA_VERSION}");
    assert!(refused.contains(&versions), "{refused}");
}

#[test]
fn resuming_a_finished_store_gives_identical_bytes() {
    let [once, twice] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    filled(once.path(), &["a", "b", "c"]).finish().unwrap();
    filled(twice.path(), &["c", "a"]).finish().unwrap();
    let store = Store::resume(twice.path(), Provenance::default()).unwrap();
    let is_known = |key: &TrialKey, data: &str| store.known().contains(key, "trial c 0", data, None);
    assert!(is_known(&key("c"), "data c 0") && !is_known(&key("c"), "data d 0") && !is_known(&key("b"), "data c 0"));
    store.append(&trial("b"), &targets("b")).unwrap();
    let unfinished = parts::folder(twice.path()).join(format!("x.json.1-0.{}", atsplat_files::PARTIAL));
    fs::write(unfinished, b"half a tri").unwrap();
    store.finish().unwrap();
    for file in [TRIALS, TARGETS, PROVENANCE] {
        let bytes = |folder: &tempfile::TempDir| fs::read(folder.path().join(file)).unwrap();
        assert_eq!(bytes(&once), bytes(&twice), "{file}");
    }
    assert!(!parts::folder(twice.path()).exists(), "unfinished files of a crash are removed");
}

/// Interrupted after the first table, or while the parts are removed.
#[test]
fn compaction_can_be_interrupted() {
    let [whole, torn] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let expected = filled(whole.path(), &["a", "b"]).finish().unwrap();
    filled(torn.path(), &["a"]).finish().unwrap();
    let store = Store::open(torn.path()).unwrap();
    store.append(&trial("b"), &targets("b")).unwrap();
    for table in [TARGETS, TRIALS] {
        forget_hash(torn.path(), table);
    }
    fs::copy(whole.path().join(TARGETS), torn.path().join(TARGETS)).unwrap();
    assert_eq!(Results::read(torn.path()).unwrap(), expected, "targets are there, their trial is a part");
    fs::copy(whole.path().join(TRIALS), torn.path().join(TRIALS)).unwrap();
    assert_eq!(Results::read(torn.path()).unwrap(), expected, "a part that is in the tables");
    assert_eq!(store.finish().unwrap(), expected);
}

#[test]
fn rejects_non_finite_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let store = filled(folder.path(), &[]);
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut wrong = targets("a");
        wrong[0].scores.insert("psnr".to_owned(), value);
        let error = store.append(&trial("a"), &wrong).unwrap_err().to_string();
        assert!(error.contains("psnr") && error.contains("a finite number"), "{error}");
        let mut row = trial("a");
        row.gaussians_drawn = Some(value);
        assert!(store.append(&row, &targets("a")).is_err());
        let row = TrialRow { context_psnr: Some(value), ..trial("a") };
        let error = store.append(&row, &targets("a")).unwrap_err().to_string();
        assert!(error.contains("context-psnr"), "{error}");
    }
    assert_eq!(Results::read(folder.path()).unwrap().trials, []);
}

fn provenance_with(folder: &Path, change: impl FnOnce(&mut serde_json::Value)) -> ResultsError {
    let path = folder.join(PROVENANCE);
    let mut value: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    change(&mut value);
    fs::write(&path, value.to_string()).unwrap();
    Results::read(folder).unwrap_err()
}

#[test]
fn rejects_other_schemas_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(Results::read(folder.path()), Err(ResultsError::NoStore { .. })));
    filled(folder.path(), &["a"]).finish().unwrap();
    let newer = provenance_with(folder.path(), |value| {
        value["schema-version"] = (SCHEMA_VERSION + 1).into();
        value["a-field-of-tomorrow"] = true.into();
    });
    assert!(newer.to_string().contains("a newer atsplat is needed"), "{newer}");
    let older = provenance_with(folder.path(), |value| value["schema-version"] = 0.into());
    assert!(older.to_string().contains("a version from 1"), "{older}");
    let other = provenance_with(folder.path(), |value| {
        value["schema-version"] = SCHEMA_VERSION.into();
        value["schema-hash"] = "00".into();
    });
    assert!(matches!(other, ResultsError::SchemaHash { .. }), "{other}");
    fs::write(folder.path().join(PROVENANCE), "{").unwrap();
    assert!(matches!(Results::read(folder.path()), Err(ResultsError::Malformed(_))));
}

/// A version without the columns `gaussians`, `effects` and `psnr`.
#[test]
fn later_columns_are_null_in_older_tables() {
    let folder = tempfile::tempdir().unwrap();
    filled(folder.path(), &["a"]).finish().unwrap();
    let mut older = Schema::of_version(SCHEMA_VERSION).unwrap();
    older.trials.retain(|column| !["gaussians", "effects"].contains(&column.name.as_str()));
    older.targets.retain(|column| column.name != "psnr");
    let rows = read::tables(folder.path(), &older, &TableHashes::default(), &BTreeSet::new()).unwrap();
    let (trial, targets) = &rows[&key("a")];
    assert_eq!((trial.gaussians, trial.effects.len()), (None, 0));
    assert_eq!(trial.initial_tokens, Some(512));
    assert_eq!(targets[0].scores.keys().collect::<Vec<_>>(), ["ssim"]);
}

#[test]
fn creating_a_store_checks_that_the_folder_is_writable() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), b"").unwrap();
    let error = Store::create(&folder.path().join("file/store"), Provenance::default()).unwrap_err();
    assert!(matches!(error, ResultsError::Io(_)), "{error}");
    filled(&folder.path().join("store"), &[]);
    assert!(Store::create(&folder.path().join("store"), Provenance::default()).is_err());
}

#[test]
fn rows_that_lost_their_provenance_do_not_join_another_run() {
    for is_finished in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let store = filled(folder.path(), &["a"]);
        if is_finished {
            store.finish().unwrap();
        } else {
            drop(store);
        }
        fs::remove_file(folder.path().join(PROVENANCE)).unwrap();
        let error = Store::resume(folder.path(), Provenance::default()).unwrap_err().to_string();
        let rows = if is_finished { TRIALS } else { ".json without provenance.json" };
        assert!(error.contains("found ") && error.contains(rows), "{error}");
    }
}

/// The row of the same trial under another method and data.
fn by(method: &str, data: &str) -> (TrialRow, Vec<TargetRow>) {
    let mut row = trial("a");
    row.data_hash = Some(data.to_owned());
    row.key.method = method.to_owned();
    let targets = targets("a").into_iter().map(|target| TargetRow { key: row.key.clone(), ..target }).collect();
    (row, targets)
}

#[test]
fn rejects_rows_of_different_data() {
    let folder = tempfile::tempdir().unwrap();
    let store = filled(folder.path(), &[]);
    for (method, data) in [("m", "old"), ("n", "new")] {
        let (row, targets) = by(method, data);
        store.append(&row, &targets).unwrap();
    }
    let error = Results::read(folder.path()).unwrap_err();
    assert!(matches!(error, ResultsError::MixedData { .. }), "{error}");
    let message = error.to_string();
    assert!(message.contains("m on p, scene \"a\"") && message.contains("n on p, scene \"a\""), "{message}");
    drop(store);
    // The interrupted run is resumed and replaces the outdated rows.
    let store = Store::open(folder.path()).unwrap();
    let (row, targets) = by("m", "new");
    store.append(&row, &targets).unwrap();
    assert_eq!(store.finish().unwrap().trials.len(), 2);
    // Rows of older versions only record the ground-truth images.
    let store = Store::open(folder.path()).unwrap();
    let (mut row, mut targets) = by("m", "new");
    row.data_hash = None;
    targets[0].truth_hash = Some("another truth".to_owned());
    store.append(&row, &targets).unwrap();
    let tables = || [TRIALS, TARGETS].map(|name| fs::read(folder.path().join(name)).unwrap());
    let before = tables();
    assert!(store.finish().unwrap_err().to_string().contains("different ground-truth images"));
    assert!(tables() == before, "a table is never built from them");
}

#[test]
fn a_second_writer_is_rejected_with_the_first_ones_identity() {
    let folder = tempfile::tempdir().unwrap();
    let store = filled(folder.path(), &["a"]);
    let opened = [
        Store::open(folder.path()).map(drop),
        Store::create(folder.path(), Provenance::default()).map(drop),
        Store::resume(folder.path(), Provenance::default()).map(drop),
    ];
    for error in opened.map(Result::unwrap_err) {
        assert!(matches!(error, ResultsError::InUse { .. }), "{error}");
        let message = error.to_string();
        let since = atsplat_files::date(std::time::SystemTime::UNIX_EPOCH.elapsed().unwrap().as_secs());
        for part in [&format!("process {} on ", std::process::id()), &since, "--shard 1/2", "atsplat merge"] {
            assert!(message.contains(part), "{part}: {message}");
        }
    }
    assert_eq!(Results::read(folder.path()).unwrap().trials.len(), 1, "reading needs no lock");
    store.append(&trial("b"), &targets("b")).unwrap();
    assert_eq!(Results::read(folder.path()).unwrap().trials.len(), 2);
    let last = store.finish_and(|results| -> Result<(), ResultsError> {
        assert_eq!(results.trials.len(), 2);
        assert!(
            matches!(Store::open(folder.path()).unwrap_err(), ResultsError::InUse { .. }),
            "until the last work is done"
        );
        Ok(())
    });
    last.unwrap();
    // Files left behind by a killed process lock nothing.
    fs::write(folder.path().join("run.json"), r#"{"pid":1,"host":"elsewhere","since":0}"#).unwrap();
    drop(Store::open(folder.path()).unwrap());
    assert!(!folder.path().join("run.json").exists());
}

/// A trial is computed again with another number of targets, and the run is killed after the first table.
#[test]
fn a_run_killed_between_the_tables_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    filled(folder.path(), &["a", "b"]).finish().unwrap();
    let store = Store::open(folder.path()).unwrap();
    let more = TargetRow { target: 2, ..targets("a").remove(1) };
    let longer = [targets("a"), vec![more]].concat();
    store.append(&TrialRow { targets: 3, ..trial("a") }, &longer).unwrap();
    let all = [longer.clone(), targets("b")].concat();
    put_table(folder.path(), TARGETS, targets::columns(&all).frame());
    drop(store);
    let read = Results::read(folder.path()).unwrap();
    assert_eq!((read.trials.len(), read.targets.len(), read.trials[0].targets), (2, 5, 3));
    assert_eq!(Store::open(folder.path()).unwrap().finish().unwrap().targets, all);
}

#[test]
fn copied_and_shortened_parts_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    drop(filled(folder.path(), &["a"]));
    let [part] = disk::files(&parts::folder(folder.path())).unwrap().try_into().unwrap();
    let copy = part.with_file_name("copy.json");
    fs::copy(&part, &copy).unwrap();
    let error = Results::read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("file name") && error.ends_with("copy.json)"), "{error}");
    fs::remove_file(copy).unwrap();
    let mut value: serde_json::Value = serde_json::from_slice(&fs::read(&part).unwrap()).unwrap();
    value["targets"].as_array_mut().unwrap().pop();
    fs::write(&part, value.to_string()).unwrap();
    let error = Results::read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("expected 2 targets of") && error.contains("found 1"), "{error}");
}

/// Reads while parts move into the tables: every trial that was finished before must be included.
#[test]
fn concurrent_readers_miss_no_finished_trial() {
    let folder = tempfile::tempdir().unwrap();
    filled(folder.path(), &["s000"]).finish().unwrap();
    let done = std::sync::atomic::AtomicUsize::new(1);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for round in 1..40 {
                let store = Store::open(folder.path()).unwrap();
                for scene in [2 * round, 2 * round + 1].map(|number| format!("s{number:03}")) {
                    store.append(&trial(&scene), &targets(&scene)).unwrap();
                    done.fetch_add(1, std::sync::atomic::Ordering::SeqCst);
                }
                store.finish().unwrap();
            }
        });
        while done.load(std::sync::atomic::Ordering::SeqCst) < 79 {
            let before = done.load(std::sync::atomic::Ordering::SeqCst);
            let results = Results::read(folder.path()).unwrap();
            assert!(results.trials.len() >= before, "{} of {before}", results.trials.len());
            assert_eq!(results.targets.len(), 2 * results.trials.len());
        }
    });
}

#[test]
fn an_invalid_protocol_is_reported_with_its_field() {
    let folder = tempfile::tempdir().unwrap();
    let toml = atsplat_protocol::Preset::text_of("re10k-2v-256").unwrap().to_owned();
    let preset = PresetRecord { name: "walls".to_owned(), toml, ..PresetRecord::default() };
    let provenance = Provenance { presets: vec![preset], ..Provenance::default() };
    drop(Store::create(folder.path(), provenance).unwrap());
    assert_eq!(Results::read(folder.path()).unwrap().provenance.presets.len(), 1);
    let error = provenance_with(folder.path(), |value| {
        let text = value["presets"][0]["toml"].as_str().unwrap().replace("scene-means", "scene-medians");
        value["presets"][0]["toml"] = text.into();
    });
    let message = error.to_string();
    for part in ["results: presets: ", "walls, toml", "scene-medians", "provenance.json)"] {
        assert!(message.contains(part), "{part}: {message}");
    }
}

#[test]
fn timings_are_stored_and_replaced_per_machine() {
    let folder = tempfile::tempdir().unwrap();
    let store = filled(folder.path(), &["a", "b"]);
    let refused =
        TimingRow { detail: Some("too few views".to_owned()), encode: vec![], stages: [].into(), ..timing("b", 1) };
    store.add_timings(vec![refused.clone(), timing("a", 1)]).unwrap();
    assert_eq!(store.timings().unwrap(), [timing("a", 1), refused]);
    store.add_timings(vec![timing("b", 2)]).unwrap();
    store.add_timings(vec![TimingRow { started: 1_800_000_000, ..timing("a", 1) }]).unwrap();
    let kept = store.timings().unwrap();
    let rows: Vec<_> = kept.iter().map(|row| (row.key.scene.as_str(), row.started, row.is_timed())).collect();
    assert_eq!(rows, [("a", 1_800_000_000, true), ("b", 1_700_000_000, true)]);
    assert_eq!(store.finish().unwrap().timings, kept);
    let store = Store::open(folder.path()).unwrap();
    let error = store.add_timings(vec![TimingRow { render: vec![f64::NAN], ..timing("a", 3) }]).unwrap_err();
    assert!(error.to_string().contains("render-samples"), "{error}");
    assert_eq!(Results::read(folder.path()).unwrap().timings, kept, "and nothing is lost");
}
