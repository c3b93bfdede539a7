//! A results store that is written in a local folder and sent to object storage.
//!
//! A process may be killed between any two requests. What it leaves can be read, or at least resumed:
//!
//! | while | object storage contains |
//! |---|---|
//! | rows are added | the old tables or the new ones: those in `update/` count from when both are there until one is removed |
//! | rows without a score are removed, for others to take their place | the same, and the old records until the rows are gone |
//! | all rows are removed, or a store is created | no records, so it is not a store: the next writer removes the rest |
//!
//! From [`StoreCopy::claim`] to [`StoreCopy::finish`], the records there do not state the hashes of tables, which arrive one by one.
//!
//! Programs that do not know `update/` may find tables that contradict each other, or none, until the store is resumed.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use atsplat_files::{FileError, PARTIAL, is_plain_name};
use tempfile::TempDir;

use crate::ObjectError;
use crate::cache::Cache;
use crate::storage::{Download, Object, Process, Storage, Traffic, Upload, Version};
use crate::store_files::{
    self, PARTS, RECORDS, TIMES, UPDATE, UPDATED, WRITER, file_name, holds_rows, is_folder, is_shared, is_table, round,
    without_hashes,
};

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
    claim: String,
    before: Option<(String, Version)>,
    /// The store as it was listed.
    begun: Vec<Object>,
    sent: Mutex<Sent>,
    /// Apart, because it is asked for while something is sent.
    failed: Mutex<Option<ObjectError>>,
}

#[derive(Debug)]
struct Sent {
    claimed: bool,
    /// Whether the records there lack the hashes of tables that the local ones state.
    withheld: bool,
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
        let before = storage.get(WRITER)?;
        let begun = list(storage.as_ref())?;
        let sent = Sent { claimed: false, withheld: false, files: BTreeMap::new(), last: None };
        let claim = claim_of(writer);
        let (sent, failed) = (Mutex::new(sent), Mutex::default());
        let copy = Self { storage, folder, claim, before, begun, sent, failed };
        copy.fetch()?;
        Ok(copy)
    }

    fn fetch(&self) -> Result<(), ObjectError> {
        let mut objects = store_files::files(&self.begun);
        // Files of a process that was killed before its records arrived do not belong to a store.
        if self.before.is_some() && objects.iter().all(|object| object.name != RECORDS) {
            objects.retain(|object| !holds_rows(&object.name) && object.name != TIMES);
        }
        let mut wanted = Vec::new();
        for object in objects {
            if !object.name.split('/').all(is_plain_name) {
                return Err(ObjectError::Name { url: self.storage.url().to_owned(), name: object.name });
            }
            let file = self.folder().join(file_name(&object.name));
            let folder = file.parent().unwrap_or(&file);
            fs::create_dir_all(folder)
                .map_err(FileError::during::<ObjectError>("creating a copy of a results store", folder))?;
            wanted.push(Download { object, file });
        }
        self.storage.download(wanted, &|name, version| {
            let file = self.folder().join(file_name(name));
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
        // What was not fetched: tables that those in `update/` replace, and what does not belong to a store.
        let names = self.begun.iter().map(|object| &object.name);
        let unused = names.filter(|name| !sent.files.contains_key(*name)).cloned().collect();
        self.remove(&mut sent, unused)?;
        if sent.files.contains_key(RECORDS) {
            // Removed rows must be gone before new records arrive: a later run would take them to belong to these.
            let mut rows = self.changed(&sent)?;
            rows.retain(|(name, _)| name == TIMES || is_table(name));
            self.upload(&mut sent, rows)?;
            let mut gone = self.gone(&sent, |_name| true);
            if gone.iter().any(|name| is_table(name)) {
                // No row is left. Both tables cannot be removed at once, but without records they do not belong to a store.
                gone.insert(0, RECORDS.to_owned());
            }
            self.remove(&mut sent, gone)?;
        }
        self.send(&mut sent, |_name| true)
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
        let Ok(mut sent) = self.sent.try_lock() else { return };
        if sent.last.is_some_and(|last| last.elapsed() < INTERVAL) || self.failure().is_some() {
            return;
        }
        // The tables change only when the run ends, one after the other.
        if let Err(error) = self.send(&mut sent, |name| !is_table(name)) {
            self.failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        }
        sent.last = Some(Instant::now());
    }

    /// Sends everything, and removes what the store no longer contains.
    ///
    /// # Errors
    /// [`ObjectError::TakenOver`], [`ObjectError::Denied`], [`ObjectError::Request`], [`ObjectError::Io`].
    pub fn finish(&self) -> Result<(), ObjectError> {
        let mut sent = self.lock();
        self.send(&mut sent, |_name| true)?;
        let gone = self.gone(&sent, |_name| true);
        self.check_claim(&mut sent)?;
        // Until it is removed, a part that was sent stands for its trial, even if the tables have a newer row, from other data, that
        // was never sent as a part. Who resumes a run that is killed here evaluates the trial again.
        self.remove(&mut sent, gone)?;
        self.put_hashes(&sent)?;
        self.storage.delete(WRITER)
    }

    /// Takes the hashes of tables out of the records there, before a table changes.
    fn withhold_hashes(&self, sent: &mut Sent) -> Result<(), ObjectError> {
        let Some(known) = sent.files.get_mut(RECORDS) else { return Ok(()) };
        let Some((records, _)) = self.storage.get(RECORDS)? else { return Ok(()) };
        let Some(file) = self.without_hashes(records.as_bytes())? else { return Ok(()) };
        let upload = Upload { name: RECORDS.to_owned(), file, replaces: Some(known.version.clone()) };
        let written = Mutex::new(None);
        self.storage.put(vec![upload], &|_, version| {
            *written.lock().unwrap_or_else(PoisonError::into_inner) = Some(version);
            Ok(())
        })?;
        if let Some(version) = written.into_inner().unwrap_or_else(PoisonError::into_inner) {
            known.version = version;
        }
        sent.withheld = true;
        Ok(())
    }

    /// A file with records without the hashes of tables; `None` if they state none.
    fn without_hashes(&self, records: &[u8]) -> Result<Option<PathBuf>, ObjectError> {
        let Some(without) = without_hashes(records) else { return Ok(None) };
        let file = self.folder().join(format!("{RECORDS}.{PARTIAL}"));
        fs::write(&file, without).map_err(FileError::during::<ObjectError>("writing results", &file))?;
        Ok(Some(file))
    }

    /// Sends the records with the hashes of tables, none of which changes any more.
    fn put_hashes(&self, sent: &Sent) -> Result<(), ObjectError> {
        if !sent.withheld {
            return Ok(());
        }
        let replaces = sent.files.get(RECORDS).map(|known| known.version.clone());
        let upload = Upload { name: RECORDS.to_owned(), file: self.folder().join(RECORDS), replaces };
        self.storage.put(vec![upload], &|_, _| Ok(()))
    }

    /// Sends what is new of `which` files. Parts that are gone are in the tables by now and stay until [`Self::finish`]; what else
    /// is gone belonged to rows that new ones replace.
    fn send(&self, sent: &mut Sent, which: impl Fn(&str) -> bool) -> Result<(), ObjectError> {
        let mut files = self.changed(sent)?;
        files.retain(|(name, _)| which(name));
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
        files.retain(|(name, stamp)| is_shared(name) && sent.files.get(name).is_none_or(|known| known.stamp != *stamp));
        Ok(files)
    }

    /// Objects that the local store no longer contains, times before the parts with their rows.
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

    /// Sends files, and then tables. The records of a new store are the last, and make it one.
    fn upload(&self, sent: &mut Sent, files: Vec<(String, Stamp)>) -> Result<(), ObjectError> {
        let is_new = !sent.files.contains_key(RECORDS);
        let (tables, files): (Vec<_>, Vec<_>) = files.into_iter().partition(|(name, _)| is_table(name));
        let (records, files): (Vec<_>, Vec<_>) = files.into_iter().partition(|(name, _)| is_new && name == RECORDS);
        self.put(sent, files)?;
        self.put_tables(sent, tables)?;
        if records.is_empty() {
            return Ok(());
        }
        // Another process that has claimed the folder since removes what has arrived.
        self.check_claim(sent)?;
        self.put(sent, records)
    }

    /// Replaces tables. While the second is on its way, those in [`UPDATE`] count, from this process or from one that was killed
    /// here.
    fn put_tables(&self, sent: &mut Sent, tables: Vec<(String, Stamp)>) -> Result<(), ObjectError> {
        if tables.is_empty() {
            return Ok(());
        }
        let is_update = tables.len() > 1 && sent.files.contains_key(RECORDS);
        if is_update && !sent.files.contains_key(UPDATED) {
            let update = tables.iter().map(|(name, stamp)| (format!("{UPDATE}{name}"), *stamp)).collect();
            self.put(sent, update)?;
        }
        self.put(sent, tables)?;
        let update: Vec<String> = sent.files.keys().rev().filter(|name| name.starts_with(UPDATE)).cloned().collect();
        if !update.is_empty() {
            // For another process that has claimed the store since, they may be its only tables.
            self.check_claim(sent)?;
        }
        self.remove(sent, update)
    }

    fn put(&self, sent: &mut Sent, files: Vec<(String, Stamp)>) -> Result<(), ObjectError> {
        let mut rounds: BTreeMap<usize, Vec<(String, Stamp)>> = BTreeMap::new();
        for (name, stamp) in files {
            rounds.entry(round(&name)).or_default().push((name, stamp));
        }
        for files in rounds.into_values() {
            let mut uploads = Vec::with_capacity(files.len());
            for (name, _) in &files {
                let mut file = self.folder().join(file_name(name));
                if name == RECORDS
                    && let Some(records) = read(&file)?
                    && let Some(without) = self.without_hashes(&records)?
                {
                    (file, sent.withheld) = (without, true);
                }
                let replaces = sent.files.get(name).map(|known| known.version.clone());
                uploads.push(Upload { name: name.clone(), file, replaces });
            }
            let versions = Mutex::new(BTreeMap::new());
            // A part that went into the tables just now is left out.
            let outcome = self.storage.put(uploads, &|name, version| {
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
        self.withhold_hashes(sent)
    }

    fn lock(&self) -> MutexGuard<'_, Sent> {
        self.sent.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Files below a folder of the local store, with `/` in their names.
fn list_files(folder: &Path, prefix: &str, found: &mut Vec<(String, Stamp)>) -> Result<(), ObjectError> {
    let entries = atsplat_files::entries_if_exists(folder);
    for path in entries.map_err(FileError::during::<ObjectError>("listing results", folder))? {
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

fn read(path: &Path) -> Result<Option<Vec<u8>>, ObjectError> {
    atsplat_files::read_if_exists(path).map_err(FileError::during("reading results", path))
}

fn stamp(path: &Path) -> io::Result<Stamp> {
    let metadata = fs::metadata(path)?;
    Ok((metadata.len(), metadata.modified().ok()))
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
