//! Against the storage in memory, and in a folder, of the crate `object_store`: without a network.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod killed;

use std::fs;
use std::path::Path;
use std::sync::{Arc, Mutex};

use object_store::memory::InMemory;
use object_store::path::Path as ObjectPath;
use object_store::{ObjectStore, ObjectStoreExt as _};
use tempfile::TempDir;

use crate::cache::Cache;
use crate::storage::connected::Connected;
use crate::storage::{Done, Download, Object, Storage, Upload, Version};
use crate::{Mirror, ObjectError, StoreCopy, Traffic};

/// Storage in memory, and a cache on disk.
struct Fixture {
    store: Arc<InMemory>,
    cache: TempDir,
}

impl Fixture {
    fn new(objects: &[(&str, &[u8])]) -> Self {
        let fixture = Self { store: Arc::new(InMemory::new()), cache: tempfile::tempdir().unwrap() };
        for (name, bytes) in objects {
            fixture.put(name, bytes);
        }
        fixture
    }

    fn of_store(names: &[&str]) -> Self {
        let fixture = Self::new(&[]);
        for name in names {
            fixture.put(&format!("store/{name}"), b"old contents");
        }
        fixture
    }

    fn put(&self, name: &str, bytes: &[u8]) {
        let place = ObjectPath::parse(name).unwrap();
        futures::executor::block_on(self.store.put(&place, bytes.to_vec().into())).unwrap();
    }

    fn delete(&self, name: &str) {
        futures::executor::block_on(self.store.delete(&ObjectPath::parse(name).unwrap())).unwrap();
    }

    fn names(&self) -> Vec<String> {
        self.storage("").list().unwrap().into_iter().map(|object| object.name).collect()
    }

    fn storage(&self, prefix: &str) -> Box<Connected> {
        let store = Arc::clone(&self.store) as Arc<dyn ObjectStore>;
        let url = format!("s3://bucket/{prefix}");
        Box::new(Connected::of(store, ObjectPath::parse(prefix).unwrap(), &url).unwrap())
    }

    fn cache(&self) -> Cache {
        Cache::new(Some(self.cache.path())).unwrap()
    }

    fn mirror(&self, prefix: &str) -> Result<Mirror, ObjectError> {
        Mirror::of(self.storage(prefix), self.cache())
    }

    fn copy(&self, writer: &str) -> Result<StoreCopy, ObjectError> {
        StoreCopy::of(self.storage("store"), &self.cache(), writer)
    }

    /// A copy of the store, and the changes that it makes there.
    fn recorded(&self) -> (StoreCopy, Arc<Mutex<Vec<String>>>) {
        self.killed_after(usize::MAX)
    }

    /// As [`Self::recorded`], without any change after this many.
    fn killed_after(&self, most: usize) -> (StoreCopy, Arc<Mutex<Vec<String>>>) {
        let changes: Arc<Mutex<Vec<String>>> = Arc::default();
        let storage = Recorded { storage: self.storage("store"), changes: Arc::clone(&changes), most };
        (StoreCopy::of(Box::new(storage), &self.cache(), "one").unwrap(), changes)
    }
}

/// Storage with a list of what was written and removed (`-name`), in order.
#[derive(Debug)]
struct Recorded {
    storage: Box<Connected>,
    changes: Arc<Mutex<Vec<String>>>,
    /// Further changes are errors.
    most: usize,
}

impl Recorded {
    fn change(&self, what: String) -> Result<(), ObjectError> {
        let mut changes = self.changes.lock().unwrap();
        if changes.len() == self.most {
            let [url, action, detail] = ["s3://bucket/store", "changing", "killed"].map(str::to_owned);
            return Err(ObjectError::Request { url, action, detail });
        }
        changes.push(what);
        Ok(())
    }
}

impl Storage for Recorded {
    fn url(&self) -> &str {
        self.storage.url()
    }

    fn traffic(&self) -> Traffic {
        self.storage.traffic()
    }

    fn list(&self) -> Result<Vec<Object>, ObjectError> {
        self.storage.list()
    }

    fn download(&self, downloads: Vec<Download>, done: Done<'_>) -> Result<(), ObjectError> {
        self.storage.download(downloads, done)
    }

    fn get(&self, name: &str) -> Result<Option<(String, Version)>, ObjectError> {
        self.storage.get(name)
    }

    fn put(&self, uploads: Vec<Upload>, done: Done<'_>) -> Result<(), ObjectError> {
        uploads.into_iter().try_for_each(|upload| {
            self.change(upload.name.clone())?;
            self.storage.put(vec![upload], done)
        })
    }

    fn delete(&self, name: &str) -> Result<(), ObjectError> {
        self.change(format!("-{name}"))?;
        self.storage.delete(name)
    }
}

fn read(path: &Path) -> Vec<u8> {
    fs::read(path).unwrap()
}

#[test]
fn contents_are_fetched_once_and_only_when_they_are_needed() {
    // Two parts and a byte, none like another.
    let large: Vec<u8> = (0..=8u32 << 20).map(|at| (at.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let fixture =
        Fixture::new(&[("data/a.torch", &large), ("data/b.torch", b"bb"), ("data/more/c", b"c"), ("data/more/d", b"")]);
    fixture.put("data-2/e", b"e");
    let mirror = fixture.mirror("data").unwrap();
    let [a, b, more] = ["a.torch", "b.torch", "more"].map(|name| mirror.path().join(name));
    assert!(mirror.path().ends_with("data"));
    assert_eq!((mirror.traffic().bytes_read, read(&a), read(&b)), (0, vec![], vec![]));
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| mirror.fetch(std::slice::from_ref(&a)).unwrap());
        }
    });
    assert!(read(&a) == large && read(&b).is_empty());
    assert_eq!(mirror.traffic().bytes_read, large.len() as u64);
    assert_eq!(mirror.traffic().requests, 1 + 3, "a list and three ranges");
    mirror.fetch(&[more.clone(), "/elsewhere".into()]).unwrap();
    assert_eq!((read(&more.join("c")), read(&more.join("d"))), (b"c".to_vec(), vec![]));
    let again = fixture.mirror("data").unwrap();
    assert_eq!(again.path(), mirror.path());
    again.fetch(&[again.path().to_owned()]).unwrap();
    assert_eq!((read(&a) == large, read(&b)), (true, b"bb".to_vec()));
    assert_eq!(again.traffic().bytes_read, 2);
}

#[test]
fn one_object_is_a_file() {
    let fixture = Fixture::new(&[("data/a.torch", b"aa"), ("data/a.torch.txt", b"t")]);
    let mirror = fixture.mirror("data/a.torch").unwrap();
    mirror.fetch(&[mirror.path().to_owned()]).unwrap();
    assert!(mirror.path().ends_with("a.torch"));
    assert_eq!((read(mirror.path()), mirror.traffic().bytes_read), (b"aa".to_vec(), 2));
}

#[test]
fn an_object_that_changes_is_noticed_and_never_mixed() {
    let fixture = Fixture::new(&[("data/a", b"old"), ("data/b", b"b")]);
    let first = fixture.mirror("data").unwrap();
    first.fetch(&[first.path().join("b")]).unwrap();
    fixture.put("data/a", b"new");
    for _ in 0..2 {
        let error = first.fetch(&[first.path().join("a")]).unwrap_err();
        assert!(matches!(&error, ObjectError::Changed { url, .. } if url == "s3://bucket/data/a"), "{error}");
    }
    assert!(first.failure().is_some() && read(&first.path().join("a")).is_empty());
    let second = fixture.mirror("data").unwrap();
    assert_ne!(second.path(), first.path());
    second.fetch(&[second.path().to_owned()]).unwrap();
    assert_eq!((read(&second.path().join("a")), read(&second.path().join("b"))), (b"new".to_vec(), b"b".to_vec()));
    assert_eq!(second.traffic().bytes_read, 3, "what did not change is not fetched again");
}

#[test]
fn missing_objects_and_impossible_names_are_errors_with_the_url() {
    let fixture = Fixture::new(&[("data/a", b"a"), ("data/b", b"b"), ("names/c:d", b"x")]);
    let error = fixture.mirror("dat").unwrap_err();
    assert!(matches!(&error, ObjectError::NotFound { url } if url == "s3://bucket/dat"), "{error}");
    assert!(matches!(fixture.mirror("names").unwrap_err(), ObjectError::Name { name, .. } if name == "c:d"));
    let mirror = fixture.mirror("data").unwrap();
    fixture.delete("data/a");
    let error = mirror.fetch(&[mirror.path().to_owned()]).unwrap_err();
    assert!(matches!(&error, ObjectError::NotFound { url } if url == "s3://bucket/data/a"), "{error}");
}

#[test]
fn urls_are_told_from_paths() {
    assert_eq!(crate::url(Path::new("s3://b/c")), Some("s3://b/c"));
    for path in ["data", "/data", "c:/data", "https://b/c", "s3:/b"] {
        assert_eq!(crate::url(Path::new(path)), None, "{path}");
    }
    let invalid = Connected::open("s3://").unwrap_err();
    assert!(
        matches!(&invalid, ObjectError::Invalid { .. }) && invalid.to_string().contains("s3://BUCKET"),
        "{invalid}"
    );
}

/// Both would be left out of requests: another folder would be read, and two stores would be one.
#[test]
fn urls_with_a_query_or_a_fragment_are_rejected() {
    for (url, expected) in [
        ("s3://b/runs/lr#2", "found #2; in names, write %23 for #"),
        ("gs://b/runs#", "write %23 for #"),
        ("az://c/runs?v=1", "found ?v=1; in names, write %3F for ?"),
        ("file:///tmp/a?b#c", "found ?b; "),
    ] {
        let error = Connected::open(url).unwrap_err();
        assert!(matches!(&error, ObjectError::Invalid { url: named, .. } if named == url), "{error}");
        assert!(error.to_string().contains(expected), "{url}: {error}");
    }
    assert!(Connected::open("file:///tmp/a%23b%3Fc").is_ok());
}

/// Storage that says nothing about what it was asked to read.
#[derive(Debug)]
struct Silent(Box<Connected>);

impl Storage for Silent {
    fn url(&self) -> &str {
        self.0.url()
    }

    fn traffic(&self) -> Traffic {
        self.0.traffic()
    }

    fn list(&self) -> Result<Vec<Object>, ObjectError> {
        self.0.list()
    }

    fn download(&self, _: Vec<Download>, _: Done<'_>) -> Result<(), ObjectError> {
        Ok(())
    }

    fn get(&self, name: &str) -> Result<Option<(String, Version)>, ObjectError> {
        self.0.get(name)
    }

    fn put(&self, uploads: Vec<Upload>, done: Done<'_>) -> Result<(), ObjectError> {
        self.0.put(uploads, done)
    }

    fn delete(&self, name: &str) -> Result<(), ObjectError> {
        self.0.delete(name)
    }
}

#[test]
fn a_missing_answer_is_a_failure_of_the_storage() {
    let fixture = Fixture::new(&[("data/a", b"a")]);
    let mirror = Mirror::of(Box::new(Silent(fixture.storage("data"))), fixture.cache()).unwrap();
    let error = mirror.fetch(&[mirror.path().join("a")]).unwrap_err();
    assert!(error.to_string().contains("no answer about a"), "{error}");
    assert_eq!(mirror.failure(), Some(error), "a run stops, and does not call the scene unreadable");
}

#[test]
fn a_store_is_sent_resumed_and_cleared_of_what_it_no_longer_holds() {
    let fixture = Fixture::new(&[]);
    let first = fixture.copy("one").unwrap();
    assert_eq!(first.unfinished_writer(), None);
    fs::create_dir(first.folder().join("parts")).unwrap();
    for name in ["provenance.json", "parts/1.json", "parts/2.json", "run.lock", "digests.txt", "parts/.x.partial"] {
        fs::write(first.folder().join(name), name).unwrap();
    }
    first.send_soon();
    assert!(first.failure().is_none());
    let sent = ["store/parts/1.json", "store/parts/2.json", "store/provenance.json", "store/writer.txt"];
    assert_eq!(fixture.names(), sent);
    // As if the first process had been killed.
    let second = fixture.copy("two").unwrap();
    assert_eq!(second.unfinished_writer().as_deref(), Some("one"));
    assert_eq!(read(&second.folder().join("parts/2.json")), b"parts/2.json");
    fs::write(second.folder().join("trials.parquet"), "rows").unwrap();
    fs::remove_dir_all(second.folder().join("parts")).unwrap();
    second.finish().unwrap();
    assert_eq!(fixture.names(), ["store/provenance.json", "store/trials.parquet"]);
    let third = fixture.copy("three").unwrap();
    assert_eq!((third.unfinished_writer(), read(&third.folder().join("trials.parquet"))), (None, b"rows".to_vec()));
}

#[test]
fn of_two_writers_the_earlier_one_stops() {
    let fixture = Fixture::new(&[("store/trials.parquet", b"none")]);
    let first = fixture.copy("process 1 on a").unwrap();
    first.claim().unwrap();
    let second = fixture.copy("process 2 on b").unwrap();
    assert_eq!(second.unfinished_writer().as_deref(), Some("process 1 on a"));
    let taken_over_by = |outcome: Result<(), ObjectError>, by: &str| {
        let error = outcome.unwrap_err();
        assert!(matches!(&error, ObjectError::TakenOver { by: found, .. } if found == by), "{error}");
    };
    fs::write(first.folder().join("provenance.json"), "1").unwrap();
    first.send_soon();
    // The second knows an older state of the store.
    taken_over_by(second.claim(), "process 1 on a");
    let third = fixture.copy("process 3 on c").unwrap();
    third.claim().unwrap();
    taken_over_by(first.finish(), "process 3 on c");
    fs::write(third.folder().join("trials.parquet"), "rows").unwrap();
    third.finish().unwrap();
    taken_over_by(third.finish(), "a process that has finished");
    assert_eq!(fixture.names(), ["store/provenance.json", "store/trials.parquet"]);
    // A change that no process announced.
    let fourth = fixture.copy("four").unwrap();
    fourth.claim().unwrap();
    fixture.put("store/trials.parquet", b"by hand");
    fs::write(fourth.folder().join("trials.parquet"), "fourth").unwrap();
    taken_over_by(fourth.finish(), "another process");
}

#[test]
fn whoever_only_looks_at_a_store_disturbs_nobody() {
    let fixture = Fixture::new(&[]);
    let first = fixture.copy("one").unwrap();
    first.claim().unwrap();
    drop(fixture.copy("two").unwrap());
    fs::write(first.folder().join("provenance.json"), "1").unwrap();
    first.finish().unwrap();
}

/// As if the answer to the first request had been lost, and the request repeated: its condition fails, because of the first one.
#[test]
fn an_object_that_holds_what_was_sent_was_written() {
    let fixture = Fixture::new(&[("store/1", b"same"), ("store/2", b"other"), ("store/3", b"longer")]);
    let storage = fixture.storage("store");
    let file = fixture.cache.path().join("file");
    fs::write(&file, "same").unwrap();
    let version = |name: &str| storage.get(name).unwrap().unwrap().1;
    let [stale, first] = ["2", "1"].map(version);
    fixture.put("store/2", b"same");
    let versions = Mutex::new(Vec::new());
    let put = |name: &str, replaces: Option<Version>| {
        let upload = Upload { name: name.to_owned(), file: file.clone(), replaces };
        storage.put(vec![upload], &|_, version| {
            versions.lock().unwrap().push(version);
            Ok(())
        })
    };
    put("1", None).unwrap();
    put("2", Some(stale)).unwrap();
    assert_eq!(*versions.lock().unwrap(), [first.clone(), version("2")], "later writes replace these");
    for replaces in [None, Some(first)] {
        let error = put("3", replaces).unwrap_err();
        assert!(matches!(error, ObjectError::TakenOver { .. }), "{error}");
    }
}

/// Whoever is killed between two of these leaves no row with the times or images of the one that it replaced.
#[test]
fn times_and_images_of_replaced_rows_are_gone_before_new_rows_arrive() {
    let names = ["images/old.png", "provenance.json", "timings.parquet", "trials.parquet"];
    let fixture = Fixture::of_store(&names);
    let (copy, changes) = fixture.recorded();
    fs::create_dir(copy.folder().join("parts")).unwrap();
    fs::remove_file(copy.folder().join("images/old.png")).unwrap();
    for name in ["parts/1.json", "images/new.png", "targets.parquet", "timings.parquet", "trials.parquet"] {
        fs::write(copy.folder().join(name), "new").unwrap();
    }
    copy.finish().unwrap();
    let expected = [
        "writer.txt",
        "-images/old.png",
        "timings.parquet",
        "images/new.png",
        "parts/1.json",
        "update/targets.parquet",
        "update/trials.parquet",
        "targets.parquet",
        "trials.parquet",
        "-update/trials.parquet",
        "-update/targets.parquet",
        "-writer.txt",
    ];
    assert_eq!(*changes.lock().unwrap(), expected);
}

/// Only those that stand for folders: an empty table is a damaged one.
#[test]
fn empty_objects_of_folders_are_skipped_in_a_store() {
    let fixture = Fixture::of_store(&["parts/1.json", "provenance.json"]);
    for name in ["parts", "images", "trials.parquet"] {
        fixture.put(&format!("store/{name}"), b"");
    }
    let copy = fixture.copy("one").unwrap();
    assert_eq!(read(&copy.folder().join("parts/1.json")), b"old contents");
    let mirror = fixture.mirror("store").unwrap();
    for folder in [copy.folder(), mirror.path()] {
        assert!(folder.join("parts").is_dir() && !folder.join("images").exists());
        assert!(folder.join("trials.parquet").is_file());
    }
    copy.finish().unwrap();
}

#[test]
fn an_empty_object_of_a_folder_without_files_is_skipped() {
    let fixture = Fixture::of_store(&["provenance.json"]);
    fixture.put("store/parts", b"");
    let mirror = fixture.mirror("store").unwrap();
    assert!(mirror.path().join("provenance.json").exists() && !mirror.path().join("parts").exists());
}

/// As when a method that failed in every trial is replaced by another of its name.
#[test]
fn rows_that_were_removed_on_opening_a_store_are_gone_before_its_new_records_arrive() {
    let tables = ["targets.parquet", "trials.parquet"];
    let of_store = ["parts/1.json", "provenance.json", "targets.parquet", "timings.parquet", "trials.parquet"];
    let fixture = Fixture::of_store(&of_store);
    let (copy, changes) = fixture.recorded();
    for name in ["parts/1.json", "timings.parquet"] {
        fs::remove_file(copy.folder().join(name)).unwrap();
    }
    for name in tables.iter().chain(&["provenance.json"]) {
        fs::write(copy.folder().join(name), "new").unwrap();
    }
    copy.claim().unwrap();
    let [targets, trials] = tables;
    let expected = [
        "writer.txt",
        "update/targets.parquet",
        "update/trials.parquet",
        targets,
        trials,
        "-update/trials.parquet",
        "-update/targets.parquet",
        "-timings.parquet",
        "-parts/1.json",
        "provenance.json",
    ];
    assert_eq!(*changes.lock().unwrap(), expected);
    // All rows: the tables go with them.
    let fixture = Fixture::of_store(&of_store);
    let (copy, changes) = fixture.recorded();
    for name in &of_store {
        fs::remove_file(copy.folder().join(name)).unwrap();
    }
    fs::write(copy.folder().join("provenance.json"), "new").unwrap();
    copy.claim().unwrap();
    let expected = [
        "-provenance.json",
        "-trials.parquet",
        "-timings.parquet",
        "-targets.parquet",
        "-parts/1.json",
        "provenance.json",
    ];
    assert_eq!(changes.lock().unwrap()[1..], expected);
    // The records make a new store one.
    let fixture = Fixture::new(&[]);
    let (copy, changes) = fixture.recorded();
    for name in tables.iter().chain(&["provenance.json"]) {
        fs::write(copy.folder().join(name), "new").unwrap();
    }
    copy.claim().unwrap();
    assert_eq!(changes.lock().unwrap()[1..], [targets, trials, "provenance.json"]);
}
