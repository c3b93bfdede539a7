//! Processes that are killed between any two changes of a store in object storage.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use super::Fixture;
use crate::storage::Storage as _;
use crate::{ObjectError, StoreCopy};

const TABLES: [&str; 3] = ["targets.parquet", "timings.parquet", "trials.parquet"];

impl Fixture {
    /// The rows that a reader finds; `None` if there is no store.
    fn rows(&self) -> Option<BTreeSet<String>> {
        let mirror = match self.mirror("store") {
            Err(ObjectError::NotFound { .. }) => return None,
            outcome => outcome.unwrap(),
        };
        mirror.fetch(&[mirror.path().to_owned()]).unwrap();
        rows_in(mirror.path())
    }

    fn text(&self, name: &str) -> Option<String> {
        self.storage("store").get(name).unwrap().map(|(text, _)| text)
    }
}

/// The rows of a store whose files are words: as a reader, who ignores a table's rows of trials that have a part.
fn rows_in(store: &Path) -> Option<BTreeSet<String>> {
    if !store.join("provenance.json").exists() {
        return None;
    }
    let words = |path: &Path| set(&fs::read_to_string(path).unwrap_or_default());
    let parts = fs::read_dir(store.join("parts")).into_iter().flatten();
    let parts: BTreeSet<String> = parts.flat_map(|part| words(&part.unwrap().path())).collect();
    let [targets, trials] = ["targets.parquet", "trials.parquet"].map(|table| &words(&store.join(table)) - &parts);
    assert_eq!(targets, trials, "rows of one table only, next to the parts {parts:?}");
    Some(&trials | &parts)
}

fn set(words: &str) -> BTreeSet<String> {
    words.split_whitespace().map(str::to_owned).collect()
}

fn is_empty(folder: &Path) -> bool {
    fs::read_dir(folder).unwrap().next().is_none()
}

/// The second part is not sent on its own: it is in the tables when the run has ended.
#[test]
fn a_store_can_be_read_wherever_sending_its_tables_stopped() {
    let mut seen = BTreeSet::new();
    for most in 0.. {
        let fixture = Fixture::new(&[]);
        for name in ["provenance.json", "targets.parquet", "trials.parquet"] {
            fixture.put(&format!("store/{name}"), b"old");
        }
        let (copy, changes) = fixture.killed_after(most);
        let run = || {
            copy.claim()?;
            let parts = copy.folder().join("parts");
            fs::create_dir(&parts).unwrap();
            for name in ["first", "second"] {
                fs::write(parts.join(format!("{name}.json")), name).unwrap();
                copy.send_soon();
            }
            fs::remove_dir_all(&parts).unwrap();
            for table in ["targets.parquet", "trials.parquet"] {
                fs::write(copy.folder().join(table), "old first second").unwrap();
            }
            copy.finish()
        };
        let outcome = run();
        let rows = fixture.rows().unwrap();
        assert!(rows.contains("old"), "{rows:?} after {:?}", changes.lock().unwrap());
        seen.insert(rows);
        if outcome.is_ok() {
            break;
        }
    }
    assert_eq!(seen, BTreeSet::from(["old", "old first", "old first second"].map(set)));
}

/// As when a method without any score is replaced by another of its name, next to rows of a third or alone.
#[test]
fn a_store_can_be_read_or_resumed_wherever_removing_rows_stopped() {
    for (kept, opens_again) in [("kept", true), ("kept", false), ("", true), ("", false)] {
        let open = |folder: &Path| {
            fs::remove_file(folder.join("parts/late.json")).ok();
            for table in TABLES.map(|name| folder.join(name)) {
                if kept.is_empty() {
                    fs::remove_file(table).ok();
                } else {
                    fs::write(table, kept).unwrap();
                }
            }
            fs::write(folder.join("provenance.json"), "new").unwrap();
        };
        for most in 0.. {
            let fixture = Fixture::new(&[("store/parts/late.json", b"late"), ("store/provenance.json", b"older")]);
            for table in TABLES {
                fixture.put(&format!("store/{table}"), format!("failed {kept}").as_bytes());
            }
            let (copy, changes) = fixture.killed_after(most);
            open(copy.folder());
            let outcome = copy.claim().and_then(|()| copy.finish());
            let (rows, records) = (fixture.rows(), fixture.text("provenance.json"));
            let context = format!("{rows:?} after {:?}", changes.lock().unwrap());
            match &rows {
                Some(rows) if records.as_deref() == Some("new") => {
                    let times = (!kept.is_empty()).then(|| kept.to_owned());
                    assert_eq!((rows, fixture.text("timings.parquet")), (&set(kept), times), "{context}");
                }
                Some(rows) => assert!(rows.is_superset(&set(kept)), "{context}"),
                None => assert!(kept.is_empty(), "{context}"),
            }
            let next = fixture.copy("two").unwrap();
            assert_eq!(rows_in(next.folder()), rows, "{context}");
            assert_eq!(is_empty(next.folder()), rows.is_none(), "{context}");
            if opens_again {
                open(next.folder());
            }
            next.claim().unwrap();
            next.finish().unwrap();
            assert_eq!(fixture.rows(), if opens_again { Some(set(kept)) } else { rows }, "{context}");
            assert!(TABLES.iter().all(|table| fixture.text(&format!("update/{table}")).is_none()), "{context}");
            if outcome.is_ok() {
                break;
            }
        }
    }
}

/// The process before was killed between the tables in `update/` and their places.
#[test]
fn tables_that_wait_for_their_places_count_until_they_have_them() {
    for most in 0.. {
        let fixture = Fixture::of_store(&["provenance.json"]);
        let tables = [
            ("targets.parquet", "kept"),
            ("trials.parquet", "kept failed"),
            ("update/targets.parquet", "kept"),
            ("update/trials.parquet", "kept"),
        ];
        for (name, words) in tables {
            fixture.put(&format!("store/{name}"), words.as_bytes());
        }
        let (copy, changes) = fixture.killed_after(most);
        let outcome = copy.claim().and_then(|()| copy.finish());
        assert_eq!(fixture.rows(), Some(set("kept")), "after {:?}", changes.lock().unwrap());
        if outcome.is_ok() {
            assert_eq!(fixture.text("trials.parquet").as_deref(), Some("kept"));
            break;
        }
    }
}

/// As by `atsplat merge`, for which a store that exists is an error.
#[test]
fn a_new_store_is_whole_or_none_wherever_sending_it_stopped() {
    let merge = |copy: &StoreCopy| {
        for name in TABLES.iter().chain(&["provenance.json"]) {
            fs::write(copy.folder().join(name), "first second").unwrap();
        }
        copy.claim()?;
        copy.finish()
    };
    let whole = Some(set("first second"));
    for most in 0.. {
        let fixture = Fixture::new(&[]);
        let (copy, changes) = fixture.killed_after(most);
        let outcome = merge(&copy);
        if fixture.rows().is_none() {
            let again = fixture.copy("two").unwrap();
            assert!(is_empty(again.folder()), "after {:?}", changes.lock().unwrap());
            merge(&again).unwrap();
        }
        assert_eq!(fixture.rows(), whole, "after {:?}", changes.lock().unwrap());
        assert_eq!(fixture.text("timings.parquet").as_deref(), Some("first second"));
        if outcome.is_ok() {
            break;
        }
    }
}

/// Here, the hash of a table is its words. Killed at any change, the records state those that are there, or none.
#[test]
fn records_never_state_hashes_of_other_tables() {
    let records = |words: &str| format!("{{\"started\": 1, \"tables-sha256\": {{\"trials.parquet\": \"{words}\"}}}}");
    let mut seen = Vec::new();
    for most in 0.. {
        let fixture = Fixture::new(&[]);
        fixture.put("store/provenance.json", records("old").as_bytes());
        for table in TABLES {
            fixture.put(&format!("store/{table}"), b"old");
        }
        let (copy, changes) = fixture.killed_after(most);
        let write = |name: &str, text: &str| fs::write(copy.folder().join(name), text).unwrap();
        let run = || {
            copy.claim()?;
            write("timings.parquet", "newer");
            write("provenance.json", &records("newer"));
            copy.send_soon();
            for table in TABLES {
                write(table, "newer");
            }
            copy.finish()
        };
        let outcome = run();
        let text = fixture.text("provenance.json").unwrap();
        let found: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(found["started"], 1, "{text}");
        let words = found.pointer("/tables-sha256/trials.parquet").map(|words| words.as_str().unwrap());
        for (table, words) in TABLES.into_iter().filter_map(|table| words.map(|words| (table, words))) {
            assert_eq!(fixture.text(table).as_deref(), Some(words), "{table} after {:?}", changes.lock().unwrap());
        }
        seen.push(words.map(str::to_owned));
        if outcome.is_ok() {
            assert_eq!(text, records("newer"), "byte for byte");
            break;
        }
    }
    seen.dedup();
    assert_eq!(seen, [Some("old".to_owned()), None, Some("newer".to_owned())]);
}
