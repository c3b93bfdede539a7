//! A results store that is written in a local folder and sent to object storage.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use atsplat_files::{FileError, is_plain_name};
use tempfile::TempDir;

use crate::ObjectError;
use crate::cache::{self, Cache};
use crate::storage::{Download, Object, Process, Storage, Traffic, Upload, Version};

/// Says which process writes. The one that wrote it last may write; one before it finds that out and stops.
const WRITER: &str = "writer.txt";
/// Files of a store that mean nothing on another machine.
const LOCAL: [&str; 3] = ["run.lock", "run.json", "digests.txt"];
/// The file without which a folder is no store.
const FIRST: &str = "provenance.json";
/// The table of times: those of a row are removed before another row takes its place.
const TIMES: &str = "timings.parquet";
/// The folder of rows that are not in the tables yet.
const PARTS: &str = "parts/";
/// Folders of a store, which object storage may hold as empty objects.
const FOLDERS: [&str; 2] = [PARTS, "pictures/"];
/// The tables of rows, in the order in which they must arrive.
const TABLES: [&str; 2] = ["targets.parquet", "trials.parquet"];
/// Results are sent at most this often while a run goes on.
const INTERVAL: Duration = Duration::from_secs(2);

/// A results store in object storage, opened for writing: a local folder that begins with what is there.
///
/// No lock outlives a process that was killed: a later process takes the store over ([`Self::claim`]), and an earlier one that goes
/// on after all finds [`ObjectError::TakenOver`] before it writes. Objects are created and replaced on the condition that nobody else did.
#[derive(Debug)]
pub struct StoreCopy {
    storage: Box<dyn Storage>,
    folder: TempDir,
    /// Links to parts: a run that ends moves its last parts into the tables before they are sent.
    kept_folder: TempDir,
    /// Parts that are linked, or were fetched.
    kept: Mutex<BTreeMap<String, Stamp>>,
    claim: String,
    before: Option<(String, Version)>,
    /// The store as it was fetched.
    begun: Vec<Object>,
    sent: Mutex<Sent>,
    /// Apart, because it is asked for while something is sent.
    failed: Mutex<Option<ObjectError>>,
}

#[derive(Debug)]
struct Sent {
    claimed: bool,
    files: BTreeMap<String, SentFile>,
    last: Option<Instant>,
}

/// A file as it was when it was read or written, and its object.
#[derive(Clone, Debug)]
struct SentFile {
    stamp: Stamp,
    version: Version,
}

/// Size and time of the last change.
type Stamp = (u64, Option<SystemTime>);

impl StoreCopy {
    /// Fetches a store, which may be empty. `writer` describes this process to others.
    ///
    /// # Errors
    /// As [`crate::Mirror::open`], but for an empty store.
    pub fn begin(url: &str, cache: Option<&Path>, writer: &str) -> Result<Self, ObjectError> {
        Self::of(Box::new(Process::start(url)?), &Cache::new(cache)?, writer)
    }

    pub(crate) fn of(storage: Box<dyn Storage>, cache: &Cache, writer: &str) -> Result<Self, ObjectError> {
        let failed =
            |path: &Path| FileError::during::<ObjectError>("creating a copy of a results store", path.to_owned());
        let stores = cache.stores();
        fs::create_dir_all(&stores).map_err(failed(&stores))?;
        let folder = tempfile::tempdir_in(&stores).map_err(failed(&stores))?;
        let kept_folder = tempfile::tempdir_in(&stores).map_err(failed(&stores))?;
        fs::create_dir(kept_folder.path().join(PARTS)).map_err(failed(kept_folder.path()))?;
        let before = storage.get(WRITER)?;
        let begun = list(storage.as_ref())?;
        let sent = Sent { claimed: false, files: BTreeMap::new(), last: None };
        let claim = claim_of(writer);
        let (kept, sent, failed) = (Mutex::default(), Mutex::new(sent), Mutex::default());
        let copy = Self { storage, folder, kept_folder, kept, claim, before, begun, sent, failed };
        copy.fetch()?;
        Ok(copy)
    }

    fn fetch(&self) -> Result<(), ObjectError> {
        let mut wanted = Vec::new();
        for object in self.begun.clone() {
            if !object.name.split('/').all(is_plain_name) {
                return Err(ObjectError::Name { url: self.storage.url().to_owned(), name: object.name.clone() });
            }
            let file = self.folder().join(&object.name);
            let folder = file.parent().unwrap_or(&file);
            fs::create_dir_all(folder)
                .map_err(FileError::during::<ObjectError>("creating a copy of a results store", folder))?;
            wanted.push(Download { object, file });
        }
        self.storage.download(wanted, &|name, version| {
            let file = self.folder().join(name);
            let stamp =
                stamp(&file).map_err(FileError::during::<ObjectError>("reading a copy of a results store", &file))?;
            self.lock().files.insert(name.to_owned(), SentFile { stamp, version });
            Ok(())
        })
    }

    /// The local store.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// The process that wrote before, and has not said that it was done.
    pub fn unfinished_writer(&self) -> Option<String> {
        self.before.as_ref().map(|(claim, _)| writer_of(claim))
    }

    /// Takes the store over, before anything else is written, and sends what opening the local store has changed.
    ///
    /// # Errors
    /// [`ObjectError::TakenOver`] if another process has written to the store since [`Self::begin`]; [`ObjectError::Denied`],
    /// [`ObjectError::Request`], [`ObjectError::Io`].
    pub fn claim(&self) -> Result<(), ObjectError> {
        let mut sent = self.lock();
        self.check_claim(&mut sent)?;
        if sent.files.contains_key(FIRST) {
            // Removed rows must be gone before new records arrive: a later run would take them to belong to these.
            let mut tables = self.changed(&sent)?;
            tables.retain(|(name, _)| TABLES.contains(&name.as_str()));
            self.upload(&mut sent, tables)?;
            let gone = self.gone(&sent, |_name| true);
            self.remove(&mut sent, gone)?;
        }
        let parts = sent.files.iter().filter(|(name, _)| name.starts_with(PARTS));
        self.lock_kept().extend(parts.map(|(name, known)| (name.clone(), known.stamp)));
        self.send(&mut sent)
    }

    /// What was exchanged.
    pub fn traffic(&self) -> Traffic {
        self.storage.traffic()
    }

    /// Why results could not be sent, if that has happened.
    pub fn failure(&self) -> Option<ObjectError> {
        self.failed.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Sends what is new, unless that was done a moment ago or another thread does it; keeps the error for
    /// [`Self::failure`]. Callable from any thread, whenever a trial is finished.
    pub fn send_soon(&self) {
        if let Err(error) = self.keep_parts() {
            self.fail(error);
        }
        let Ok(mut sent) = self.sent.try_lock() else { return };
        if sent.last.is_some_and(|last| last.elapsed() < INTERVAL) || self.failure().is_some() {
            return;
        }
        if let Err(error) = self.send(&mut sent) {
            self.fail(error);
        }
        sent.last = Some(Instant::now());
    }

    fn fail(&self, error: ObjectError) {
        self.failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }

    /// Links parts that are new. Sent before the tables, they stand for rows of which only one table has arrived.
    fn keep_parts(&self) -> Result<(), ObjectError> {
        let folder = self.folder().join(PARTS);
        let failed = || FileError::during::<ObjectError>("listing results", &folder);
        let mut kept = self.lock_kept();
        let entries = match fs::read_dir(&folder) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            outcome => outcome.map_err(failed())?,
        };
        for entry in entries {
            let part = entry.map_err(failed())?.path();
            let name = format!("{PARTS}{}", atsplat_files::name_of(&part));
            // A part of the same name replaces one that was sent, which stands for its trial as well.
            if is_shared(&name) && !kept.contains_key(&name) {
                let stamp = stamp(&part).map_err(failed())?;
                cache::link(&part, &self.kept_folder.path().join(&name))?;
                kept.insert(name, stamp);
            }
        }
        Ok(())
    }

    /// Sends everything, and removes what the store no longer holds.
    ///
    /// # Errors
    /// [`ObjectError::TakenOver`], [`ObjectError::Denied`], [`ObjectError::Request`], [`ObjectError::Io`].
    pub fn finish(&self) -> Result<(), ObjectError> {
        let mut sent = self.lock();
        self.send(&mut sent)?;
        let gone = self.gone(&sent, |_name| true);
        self.check_claim(&mut sent)?;
        self.remove(&mut sent, gone)?;
        self.storage.delete(WRITER)
    }

    /// Sends what is new. Parts that are gone are in the tables by now and stay until [`Self::finish`]; what else is gone
    /// belonged to rows that new ones replace.
    fn send(&self, sent: &mut Sent) -> Result<(), ObjectError> {
        let files = self.changed(sent)?;
        let gone = self.gone(sent, |name| !holds_rows(name));
        if files.is_empty() && gone.is_empty() {
            return Ok(());
        }
        self.check_claim(sent)?;
        self.remove(sent, gone)?;
        self.upload(sent, files)
    }

    /// Files that are new or have changed.
    fn changed(&self, sent: &Sent) -> Result<Vec<(String, Stamp)>, ObjectError> {
        let folder = self.folder();
        fs::metadata(folder).map_err(FileError::during::<ObjectError>("listing results", folder))?;
        let (mut parts, mut files) = (Vec::new(), Vec::new());
        // Before the rest: what belonged to the rows that a part replaces was removed before the part was written.
        list_files(&folder.join(PARTS), PARTS, &mut parts)?;
        list_files(folder, "", &mut files)?;
        files.retain(|(name, _)| !name.starts_with(PARTS));
        files.extend(parts);
        let kept = self.lock_kept();
        let moved = kept.iter().filter(|(name, _)| !sent.files.contains_key(*name) && !folder.join(name).exists());
        files.extend(moved.map(|(name, stamp)| (name.clone(), *stamp)));
        files.retain(|(name, stamp)| is_shared(name) && sent.files.get(name).is_none_or(|known| known.stamp != *stamp));
        Ok(files)
    }

    /// The file of a name; of a part that is in the tables by now, the one that was kept.
    fn file(&self, name: &str) -> PathBuf {
        let own = self.folder().join(name);
        if own.exists() { own } else { self.kept_folder.path().join(name) }
    }

    /// Objects that the local store no longer holds: tables before the parts, which stand for rows that tables lack.
    fn gone(&self, sent: &Sent, which: impl Fn(&str) -> bool) -> Vec<String> {
        let is_gone = |name: &&String| which(name) && !self.folder().join(name).exists();
        sent.files.keys().rev().filter(is_gone).cloned().collect()
    }

    fn remove(&self, sent: &mut Sent, names: Vec<String>) -> Result<(), ObjectError> {
        for name in names {
            self.storage.delete(&name)?;
            sent.files.remove(&name);
        }
        Ok(())
    }

    fn upload(&self, sent: &mut Sent, files: Vec<(String, Stamp)>) -> Result<(), ObjectError> {
        let mut rounds: BTreeMap<usize, Vec<(String, Stamp)>> = BTreeMap::new();
        for (name, stamp) in files {
            rounds.entry(round(&name)).or_default().push((name, stamp));
        }
        for files in rounds.into_values() {
            let upload = |(name, _): &(String, Stamp)| {
                let replaces = sent.files.get(name).map(|known| known.version.clone());
                Upload { name: name.clone(), file: self.file(name), replaces }
            };
            let versions = Mutex::new(BTreeMap::new());
            // A part that went into the tables just now is left out; the next call sends the one that was kept.
            let outcome = self.storage.put(files.iter().map(upload).collect(), &|name, version| {
                versions.lock().unwrap_or_else(PoisonError::into_inner).insert(name.to_owned(), version);
                Ok(())
            });
            let mut versions = versions.into_inner().unwrap_or_else(PoisonError::into_inner);
            for (name, stamp) in files {
                if let Some(version) = versions.remove(&name) {
                    sent.files.insert(name, SentFile { stamp, version });
                }
            }
            outcome?;
        }
        Ok(())
    }

    /// Claims the store, or finds out whether another process has done so since.
    fn check_claim(&self, sent: &mut Sent) -> Result<(), ObjectError> {
        let taken_over = |by: String| ObjectError::TakenOver { url: self.storage.url().to_owned(), by };
        if sent.claimed {
            return match self.storage.get(WRITER)? {
                Some((claim, _)) if claim == self.claim => Ok(()),
                Some((claim, _)) => Err(taken_over(writer_of(&claim))),
                None => Err(taken_over("a process that has finished".to_owned())),
            };
        }
        let file = self.folder().join(WRITER);
        fs::write(&file, &self.claim).map_err(FileError::during::<ObjectError>("writing results", &file))?;
        let replaces = self.before.as_ref().map(|(_, version)| version.clone());
        self.storage.put(vec![Upload { name: WRITER.to_owned(), file, replaces }], &|_, _| Ok(()))?;
        // Who wrote before has not seen the claim until now.
        if list(self.storage.as_ref())? != self.begun {
            return Err(taken_over(self.unfinished_writer().unwrap_or_else(|| "another process".to_owned())));
        }
        sent.claimed = true;
        Ok(())
    }

    fn lock_kept(&self) -> MutexGuard<'_, BTreeMap<String, Stamp>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn lock(&self) -> MutexGuard<'_, Sent> {
        self.sent.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Files below a folder of the local store, with `/` in their names.
fn list_files(folder: &Path, prefix: &str, found: &mut Vec<(String, Stamp)>) -> Result<(), ObjectError> {
    let failed = || FileError::during::<ObjectError>("listing results", folder);
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        outcome => outcome.map_err(failed())?,
    };
    for entry in entries {
        let path = entry.map_err(failed())?.path();
        let name = format!("{prefix}{}", atsplat_files::name_of(&path));
        if path.is_dir() {
            list_files(&path, &format!("{name}/"), found)?;
        } else if let Ok(stamp) = stamp(&path) {
            // A file that is gone by now was temporary, or is in the tables.
            found.push((name, stamp));
        }
    }
    Ok(())
}

/// The objects of a store; none if there is nothing below its URL.
fn list(storage: &dyn Storage) -> Result<Vec<Object>, ObjectError> {
    match storage.list() {
        Ok(all) => {
            let is_file = |object: &&Object| is_shared(&object.name) && !is_folder(object, &all);
            Ok(all.iter().filter(is_file).cloned().collect())
        }
        Err(ObjectError::NotFound { .. }) => Ok(Vec::new()),
        Err(error) => Err(error),
    }
}

/// Whether an object stands for a folder: some tools write an empty one for each.
fn is_folder(object: &Object, all: &[Object]) -> bool {
    let inside = format!("{}/", object.name);
    let has_files = || all.iter().any(|other| other.name.starts_with(&inside));
    object.bytes == 0 && (FOLDERS.contains(&inside.as_str()) || has_files())
}

fn stamp(path: &Path) -> io::Result<Stamp> {
    let metadata = fs::metadata(path)?;
    Ok((metadata.len(), metadata.modified().ok()))
}

fn is_shared(name: &str) -> bool {
    let is_partial = name.rsplit('.').next() == Some(atsplat_files::PARTIAL);
    !is_partial && name != WRITER && !LOCAL.contains(&name)
}

fn holds_rows(name: &str) -> bool {
    name.starts_with(PARTS) || TABLES.contains(&name)
}

/// Files of a later round are sent when those of the earlier ones have arrived, so that a store that is read or resumed
/// meanwhile lacks nothing, and no row has the times or pictures of the one before it.
fn round(name: &str) -> usize {
    match name {
        FIRST => 0,
        TIMES => 1,
        _ if name.starts_with(PARTS) => 3,
        _ => TABLES.iter().position(|table| *table == name).map_or(2, |position| 4 + position),
    }
}

/// The process as text, and a number that no other process has.
fn claim_of(writer: &str) -> String {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    format!("{writer}\n{} {}\n", std::process::id(), now.as_nanos())
}

/// The process that a claim names.
fn writer_of(claim: &str) -> String {
    claim.lines().next().unwrap_or("an unknown process").to_owned()
}
