//! Tables that are not as they were written, and stores that do not say how they were written.

use atsplat_files::Sha256Digest;

use super::*;

/// The tables whose hashes the records state, each that of its file.
fn stated(folder: &Path) -> Vec<String> {
    let records: serde_json::Value = serde_json::from_slice(&fs::read(folder.join(PROVENANCE)).unwrap()).unwrap();
    let hashes = records.get(hashes::FIELD).and_then(serde_json::Value::as_object).cloned().unwrap_or_default();
    for (table, hash) in &hashes {
        let found = Sha256Digest::of_file(&folder.join(table)).unwrap();
        assert_eq!(hash.as_str(), Some(found.to_string().as_str()), "{table}");
    }
    hashes.into_iter().map(|(table, _)| table).collect()
}

/// Results of two scenes with times.
fn finished(folder: &Path) -> Results {
    let store = filled(folder, &["a", "b"]);
    store.add_timings(vec![timing("a", 1)]).unwrap();
    store.finish().unwrap()
}

/// Many of these bits belong to numbers, and leave a table that can be read.
#[test]
fn a_flipped_bit_is_an_error_with_both_hashes() {
    let folder = tempfile::tempdir().unwrap();
    let results = finished(folder.path());
    for table in TABLES {
        let path = folder.path().join(table);
        let bytes = fs::read(&path).unwrap();
        for at in (0..bytes.len()).step_by(61) {
            let mut flipped = bytes.clone();
            flipped[at] ^= 1 << (at % 8);
            fs::write(&path, &flipped).unwrap();
            let error = Results::read(folder.path()).unwrap_err().to_string();
            let [expected, found] = [&bytes, &flipped].map(|bytes| Sha256Digest::of(bytes));
            let expected = format!("expected a table with the SHA-256 {expected}, as provenance.json states (restore");
            let found = format!("found {found}: it was damaged or changed");
            let is_said = error.contains(&expected) && error.contains(&found);
            assert!(is_said && error.ends_with(&format!("{table})")), "{at}: {error}");
        }
        assert!(Store::open(folder.path()).is_err(), "{table}");
        assert!(Store::resume(folder.path(), Provenance::default()).is_err(), "{table}");
        fs::write(&path, &bytes).unwrap();
    }
    assert_eq!(Results::read(folder.path()).unwrap(), results);
}

/// As many rows of the same trials, with other numbers.
#[test]
fn a_table_of_another_store_is_rejected() {
    let [here, there] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    filled(here.path(), &["a"]).finish().unwrap();
    let store = filled(there.path(), &[]);
    let mut others = targets("a");
    others[0].scores.insert("psnr".to_owned(), 12.0);
    store.append(&trial("a"), &others).unwrap();
    store.finish().unwrap();
    fs::copy(there.path().join(TARGETS), here.path().join(TARGETS)).unwrap();
    let error = Results::read(here.path()).unwrap_err().to_string();
    assert!(error.contains("found") && error.ends_with("targets.parquet)"), "{error}");
    forget_hash(here.path(), TARGETS);
    assert_eq!(Results::read(here.path()).unwrap().targets, others, "nothing else notices it");
}

/// A finished run whose table was lost: its rows do not vanish in silence.
#[test]
fn a_lost_table_is_an_error() {
    for table in TABLES {
        let folder = tempfile::tempdir().unwrap();
        finished(folder.path());
        fs::remove_file(folder.path().join(table)).unwrap();
        let error = Results::read(folder.path()).unwrap_err().to_string();
        assert!(error.contains("found no file") && error.ends_with(&format!("{table})")), "{error}");
    }
    let folder = tempfile::tempdir().unwrap();
    finished(folder.path());
    fs::remove_file(folder.path().join(TRIALS)).unwrap();
    forget_hash(folder.path(), TRIALS);
    let error = Results::read(folder.path()).unwrap_err().to_string();
    assert!(
        error.contains("expected targets of trials in trials.parquet") && error.contains("which has no trial"),
        "of an older version: {error}"
    );
}

#[test]
fn a_store_without_hashes_is_read_as_it_is_and_has_them_when_it_is_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let results = finished(folder.path());
    let all = ["targets.parquet", "timings.parquet", "trials.parquet"];
    assert_eq!(stated(folder.path()), all);
    for table in TABLES {
        forget_hash(folder.path(), table);
    }
    let records = fs::read(folder.path().join(PROVENANCE)).unwrap();
    assert_eq!(stated(folder.path()), [] as [&str; 0]);
    assert_eq!(Results::read(folder.path()).unwrap(), results);
    assert_eq!(fs::read(folder.path().join(PROVENANCE)).unwrap(), records);
    assert_eq!(Store::resume(folder.path(), Provenance::default()).unwrap().finish().unwrap(), results);
    assert_eq!(stated(folder.path()), all);
}

/// Killed before and after each file that the end of a run writes: a finished store with another scene is extended.
#[test]
fn a_run_that_is_killed_while_it_replaces_tables_resumes() {
    let whole = tempfile::tempdir().unwrap();
    let expected = filled(whole.path(), &["a", "b"]).finish().unwrap();
    for written in 0..=3_usize {
        let killed = tempfile::tempdir().unwrap();
        filled(killed.path(), &["a"]).finish().unwrap();
        Store::open(killed.path()).unwrap().append(&trial("b"), &targets("b")).unwrap();
        if written > 0 {
            for table in [TARGETS, TRIALS] {
                forget_hash(killed.path(), table);
            }
        }
        for table in [TARGETS, TRIALS].iter().take(written.saturating_sub(1)) {
            fs::copy(whole.path().join(table), killed.path().join(table)).unwrap();
        }
        assert_eq!(Results::read(killed.path()).unwrap(), expected, "{written}");
        assert_eq!(Store::resume(killed.path(), Provenance::default()).unwrap().finish().unwrap(), expected);
        for file in [TARGETS, TRIALS, PROVENANCE] {
            let bytes = |folder: &Path| fs::read(folder.join(file)).unwrap();
            assert!(bytes(killed.path()) == bytes(whole.path()), "{written}: {file}");
        }
    }
}

/// Of times that are added, replaced and removed, and of a merge.
#[test]
fn records_state_the_hashes_of_the_tables_that_are_there() {
    let root = tempfile::tempdir().unwrap();
    let [folder, merged] = ["store", "merged"].map(|name| root.path().join(name));
    let store = filled(&folder, &["a", "b"]);
    assert_eq!(stated(&folder), [] as [&str; 0]);
    store.add_timings(vec![timing("a", 1)]).unwrap();
    assert_eq!(stated(&folder), [timings::TIMINGS]);
    store.add_timings(vec![timing("b", 2)]).unwrap();
    store.remove_timings(&key("a")).unwrap();
    assert_eq!(stated(&folder), [timings::TIMINGS]);
    let results = store.finish().unwrap();
    Results::merge(vec![results]).unwrap().results.write(&merged).unwrap();
    assert_eq!(stated(&merged), stated(&folder));
    assert_eq!(stated(&merged).len(), TABLES.len());
    Store::open(&merged).unwrap().remove_timings(&key("b")).unwrap();
    assert_eq!(Results::read(&merged).unwrap().timings, []);
    assert_eq!(stated(&merged).len(), TABLES.len());
}

#[test]
fn errors_of_damaged_tables_name_the_location() {
    let folder = tempfile::tempdir().unwrap();
    filled(folder.path(), &["a"]).finish().unwrap();
    forget_hash(folder.path(), TRIALS);
    let schema = |change: fn(&mut Schema)| {
        let mut schema = Schema::of_version(SCHEMA_VERSION).unwrap();
        change(&mut schema);
        read::tables(folder.path(), &schema, &TableHashes::default(), &BTreeSet::new()).unwrap_err().to_string()
    };
    let absent = schema(|schema| {
        schema.trials.push(Column { name: "colour".to_owned(), kind: Kind::Text, nullable: true });
    });
    assert!(absent.starts_with("results: column colour: ") && absent.contains("no such column"), "{absent}");
    assert!(absent.ends_with("trials.parquet)"), "{absent}");
    let retyped = schema(|schema| schema.trials[0].kind = Kind::Number);
    assert!(retyped.contains("column preset: expected number"), "{retyped}");
    let null = schema(|schema| schema.trials.iter_mut().for_each(|column| column.nullable = false));
    assert!(null.contains("1 nulls"), "{null}");
    let path = folder.path().join(TRIALS);
    let bytes = fs::read(&path).unwrap();
    let said = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let error = Results::read(folder.path()).unwrap_err();
        assert!(matches!(error, ResultsError::Malformed(_)), "{error}");
        error.to_string()
    };
    for cut in [0, 3, bytes.len() / 2, bytes.len() - 1] {
        let error = said(&bytes[..cut]);
        assert!(error.contains("restore the file from a copy") && error.ends_with("trials.parquet)"), "{error}");
    }
    // In the type of an unsigned column (64 bits, unsigned), one bit of the field that is a flag; polars panics.
    let unsigned = [0x13, 64, 0x12, 0];
    let at = bytes.windows(4).position(|window| window == unsigned).unwrap();
    let mut flipped = bytes;
    flipped[at + 2] ^= 1;
    let error = said(&flipped);
    assert!(error.contains("found damaged data: ") && error.ends_with("trials.parquet)"), "{error}");
}
