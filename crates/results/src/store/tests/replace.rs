//! Methods without a score, whose rows another method of their name does not take over.

use super::*;
use crate::MethodRecord;

/// Methods m, in this version, and n.
fn run_of(version: u32) -> Provenance {
    let method = |name: &str, version: u32| MethodRecord {
        name: name.to_owned(),
        parameters: [("version".to_owned(), version.into())].into(),
        ..MethodRecord::default()
    };
    Provenance { methods: vec![method("m", version), method("n", 1)], ..Provenance::default() }
}

fn scored(method: &str, scene: &str) -> (TrialRow, Vec<TargetRow>) {
    let key = key(scene).of_method(method);
    let of_method = |target: TargetRow| TargetRow { key: key.clone(), ..target };
    (TrialRow { key: key.clone(), ..trial(scene) }, targets(scene).into_iter().map(of_method).collect())
}

/// What m has in a scene.
fn failed(scene: &str) -> (TrialRow, Vec<TargetRow>) {
    let fail = |target: TargetRow| TargetRow { status: TargetStatus::Failed, scores: BTreeMap::new(), ..target };
    let (trial, targets) = scored("m", scene);
    (TrialRow { status: TrialStatus::Failed, ..trial }, targets.into_iter().map(fail).collect())
}

/// m failed in scenes a and b and was timed in a; `more` are rows of n, which was timed in a too.
fn with_failures(folder: &Path, more: Option<(TrialRow, Vec<TargetRow>)>) -> Store {
    let store = Store::create(folder, run_of(1)).unwrap();
    for (trial, targets) in [failed("b"), failed("a")].into_iter().chain(more) {
        store.append(&trial, &targets).unwrap();
    }
    let of_method = |name: &str| TimingRow { key: key("a").of_method(name), ..timing("a", 1) };
    store.add_timings(vec![of_method("m"), of_method("n")]).unwrap();
    store
}

fn is_known(store: &Store, method: &str, scene: &str) -> bool {
    let key = key(scene).of_method(method);
    store.known().contains(&key, &format!("trial {scene} 0"), &format!("data {scene} 0"), None)
}

/// Which rows a run of m in this version finds, of m in scenes a and b, and of n in a. It ends at once, as if it was killed.
fn found(folder: &Path, version: u32) -> [bool; 3] {
    let store = Store::resume(folder, run_of(version)).unwrap();
    [("m", "a"), ("m", "b"), ("n", "a")].map(|(method, scene)| is_known(&store, method, scene))
}

#[test]
fn failures_of_a_replaced_method_do_not_return_after_a_kill() {
    for is_finished in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let store = with_failures(folder.path(), Some(scored("n", "a")));
        if is_finished {
            store.finish().unwrap();
        } else {
            drop(store);
        }
        assert_eq!(found(folder.path(), 1), [true, true, true], "the same method keeps its failures");
        assert_eq!(found(folder.path(), 2), [false, false, true], "another one does not take them over");
        assert_eq!(found(folder.path(), 2), [false, false, true], "nor does it after a kill");
        let store = Store::resume(folder.path(), run_of(2)).unwrap();
        let (trial, targets) = scored("m", "b");
        store.append(&trial, &targets).unwrap();
        drop(store);
        assert_eq!(found(folder.path(), 2), [false, true, true], "one of two trials was run again");
        let results = Results::read(folder.path()).unwrap();
        assert_eq!(results.trials, [trial, scored("n", "a").0]);
        assert_eq!(results.targets.len(), 4);
        let timed: Vec<&str> = results.timings.iter().map(|row| row.key.method.as_str()).collect();
        assert_eq!((timed, results.provenance.methods), (vec!["n"], run_of(2).methods));
    }
}

/// Killed between the two tables, after them, and between the part files that override them meanwhile.
#[test]
fn a_replacement_can_be_interrupted() {
    let [torn, whole] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    for folder in [&torn, &whole] {
        with_failures(folder.path(), Some(scored("n", "a"))).finish().unwrap();
    }
    drop(Store::resume(whole.path(), run_of(2)).unwrap());
    let before = Results::read(torn.path()).unwrap();
    fs::create_dir(parts::folder(torn.path())).unwrap();
    for (trial, targets) in ["a", "b"].map(failed) {
        parts::write(torn.path(), &trial, &targets).unwrap();
    }
    for table in [TARGETS, TRIALS] {
        forget_hash(torn.path(), table);
    }
    for table in [TARGETS, TRIALS] {
        fs::copy(whole.path().join(table), torn.path().join(table)).unwrap();
        assert_eq!(Results::read(torn.path()).unwrap(), before, "{table}");
    }
    fs::remove_file(parts::path(torn.path(), &key("a"))).unwrap();
    assert_eq!(found(torn.path(), 1), [false, true, true], "still the first version's");
    assert_eq!(found(torn.path(), 2), [false, false, true]);
    assert_eq!(disk::files(&parts::folder(torn.path())).unwrap(), [] as [PathBuf; 0]);
}

/// Nothing has a score, and the next run has other scenes.
#[test]
fn a_restarted_store_keeps_neither_rows_nor_times() {
    for is_finished in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let store = with_failures(folder.path(), None);
        if is_finished {
            store.finish().unwrap();
        } else {
            drop(store);
        }
        drop(Store::resume(folder.path(), Provenance { limit: Some(7), ..run_of(1) }).unwrap());
        let Results { provenance, trials, targets, timings } = Results::read(folder.path()).unwrap();
        assert_eq!((provenance.limit, trials.len(), targets.len(), timings.len()), (Some(7), 0, 0, 0));
    }
}

/// The first run was given other data, and found none of the renders: the right ones are not counted as others.
#[test]
fn places_of_a_run_without_a_score_are_forgotten() {
    let of = |data: &str, renders: &str| {
        let mut provenance = run_of(1);
        provenance.methods.truncate(1);
        provenance.methods[0].parameters.insert("folder".to_owned(), renders.into());
        let toml = atsplat_protocol::Preset::text_of("re10k-2v-256").unwrap().to_owned();
        let (name, dataset) = ("p".to_owned(), data.to_owned());
        provenance.presets = vec![PresetRecord { name, toml, dataset, ..PresetRecord::default() }];
        provenance
    };
    let resumed = |is_scored: bool, data: &str, renders: &str| {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::create(folder.path(), of("wrong", "empty")).unwrap();
        let (trial, targets) = if is_scored { scored("m", "a") } else { failed("a") };
        store.append(&trial, &targets).unwrap();
        drop(store);
        let store = Store::resume(folder.path(), of(data, renders)).unwrap();
        let is_known = is_known(&store, "m", "a");
        let [begun, ended] = [store.provenance().clone(), store.finish().unwrap().provenance].map(|found| {
            assert_eq!(found.warnings, []);
            let folder = found.methods[0].parameters["folder"].as_str().unwrap().to_owned();
            [found.presets[0].dataset.clone(), folder]
        });
        (begun, ended, is_known)
    };
    let (new, corrected) = (["right", "renders"].map(str::to_owned), ["wrong", "renders"].map(str::to_owned));
    assert_eq!(resumed(false, "right", "renders"), (new.clone(), new.clone(), false));
    assert_eq!(resumed(false, "wrong", "renders"), (corrected.clone(), corrected, false));
    let first = ["wrong", "empty"].map(str::to_owned);
    assert_eq!(resumed(true, "right", "renders"), (first, new, true), "until the run has ended, which compares them");
}

/// Neither is one recorded that was refused, nor does one get lost that was killed.
#[test]
fn commands_are_recorded_with_what_they_make() {
    let of = |command: &str| Provenance { command: vec![command.to_owned()], ..run_of(1) };
    let folder = tempfile::tempdir().unwrap();
    let resumed = |command: &str| Store::resume(folder.path(), of(command)).unwrap();
    let add = |store: &Store, method: &str, scene: &str| {
        let (trial, targets) = scored(method, scene);
        store.append(&trial, &targets).unwrap();
    };
    let commands = || {
        let provenance = Results::read(folder.path()).unwrap().provenance;
        provenance.commands().map(|command| command.join(" ")).collect::<Vec<_>>()
    };
    add(&Store::create(folder.path(), of("first")).unwrap(), "m", "a");
    drop(resumed("refused"));
    assert_eq!(commands(), ["first"]);
    let killed = resumed("killed");
    for method in ["m", "n"] {
        add(&killed, method, "b");
    }
    drop(killed);
    assert_eq!(commands(), ["first", "killed"]);
    resumed("timed").add_timings(vec![timing("a", 1)]).unwrap();
    assert_eq!(commands(), ["first", "killed", "timed"]);
    resumed("of results that are there").finish().unwrap();
    assert_eq!(commands(), ["first", "killed", "timed"]);
    let whole = resumed("whole");
    add(&whole, "n", "a");
    whole.finish().unwrap();
    assert_eq!(commands(), ["first", "killed", "timed", "whole"]);
}

/// A copy of the data has another scene; the run that was given it stopped before its first result.
#[test]
fn scenes_without_a_result_do_not_stay_in_the_record() {
    let of = |entries: u64, index: &str| {
        let toml = atsplat_protocol::Preset::text_of("re10k-2v-256").unwrap().to_owned();
        let (name, index_sha256) = ("p".to_owned(), index.to_owned());
        let scenes_sha256 = Some(format!("of {entries}"));
        let preset = PresetRecord { name, toml, index_sha256, entries, scenes_sha256, ..PresetRecord::default() };
        Provenance { presets: vec![preset], ..run_of(1) }
    };
    let folder = tempfile::tempdir().unwrap();
    let store = Store::create(folder.path(), of(3, "index")).unwrap();
    for (method, scene) in [("m", "a"), ("n", "a"), ("m", "b")] {
        let (trial, targets) = scored(method, scene);
        store.append(&trial, &targets).unwrap();
    }
    drop(store);
    let recorded = || {
        let preset = Results::read(folder.path()).unwrap().provenance.presets.remove(0);
        (preset.entries, preset.scenes_sha256)
    };
    let with = |entries: u64| (entries, Some(format!("of {entries}")));
    drop(Store::resume(folder.path(), of(5, "index")).unwrap());
    assert_eq!(recorded(), with(5));
    drop(Store::resume(folder.path(), of(3, "index")).unwrap());
    assert_eq!(recorded(), with(3), "as before the run that stopped");
    let mut store = Store::resume(folder.path(), of(5, "index")).unwrap();
    let (trial, targets) = scored("n", "c");
    store.append(&trial, &targets).unwrap();
    let skipped = SkippedEntry { preset: "p".to_owned(), scene: "d".to_owned(), ..SkippedEntry::default() };
    store.set_findings(Vec::new(), vec![skipped]);
    store.finish().unwrap();
    let fewer = Store::resume(folder.path(), of(3, "index")).unwrap_err().to_string();
    assert!(fewer.contains("then 5 entries of the index, now 3; restore the data"), "{fewer}");
    assert!(Store::resume(folder.path(), of(4, "another")).is_err(), "entries of another index");
    drop(Store::resume(folder.path(), of(4, "index")).unwrap());
    assert_eq!(recorded(), with(4), "three have results, and one has a reason why there is none");
}

/// It has results under p, and the run is of q alone.
#[test]
fn files_in_another_folder_that_a_run_does_not_compare_are_rejected() {
    let of = |preset: &str, renders: &str| {
        let mut provenance = run_of(1);
        provenance.methods[0].parameters.insert("folder".to_owned(), renders.into());
        let toml = atsplat_protocol::Preset::text_of("re10k-2v-256").unwrap().to_owned();
        provenance.presets = vec![PresetRecord { name: preset.to_owned(), toml, ..PresetRecord::default() }];
        provenance
    };
    let folder = tempfile::tempdir().unwrap();
    let store = Store::create(folder.path(), of("p", "step_10000")).unwrap();
    let (trial, targets) = scored("m", "a");
    store.append(&trial, &targets).unwrap();
    drop(store);
    let refused = Store::resume(folder.path(), of("q", "step_20000")).unwrap_err().to_string();
    let said = "imported files of the two runs differ: expected those of m in step_10000, also under p, found those in step_20000";
    assert!(refused.starts_with(said), "{refused}");
    assert_eq!(Results::read(folder.path()).unwrap().provenance, of_this_schema(of("p", "step_10000")));
    let resumed = Store::resume(folder.path(), of("p", "step_20000")).unwrap();
    let places = ["step_10000", "step_20000"].map(str::to_owned);
    assert_eq!(resumed.moved(), Moved { files: [("m".to_owned(), places)].into(), ..Moved::default() });
    drop(resumed);
    assert_eq!(Store::resume(folder.path(), of("q", "step_10000")).unwrap().moved(), Moved::default());
}

/// Of m and n, which the run read from another place, n was given other images.
#[test]
fn places_of_a_run_with_other_data_are_not_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let of = |data: &str| {
        let toml = atsplat_protocol::Preset::text_of("re10k-2v-256").unwrap().to_owned();
        let (name, dataset) = ("p".to_owned(), data.to_owned());
        Provenance { presets: vec![PresetRecord { name, toml, dataset, ..PresetRecord::default() }], ..run_of(1) }
    };
    let store = Store::create(folder.path(), of("first")).unwrap();
    let (trial, targets) = scored("m", "a");
    store.append(&trial, &targets).unwrap();
    store.finish().unwrap();
    let store = Store::resume(folder.path(), of("second")).unwrap();
    let (trial, targets) = scored("n", "a");
    let other = TrialRow { data_hash: Some("other".to_owned()), ..trial.clone() };
    store.append(&other, &targets).unwrap();
    assert!(matches!(store.finish(), Err(ResultsError::MixedData { .. })));
    let store = Store::open(folder.path()).unwrap();
    assert_eq!(store.provenance().presets[0].dataset, "first");
    store.append(&trial, &targets).unwrap();
    drop(store);
    let store = Store::resume(folder.path(), of("second")).unwrap();
    assert_eq!(store.finish().unwrap().provenance.presets[0].dataset, "second");
}
