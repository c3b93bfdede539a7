//! A results store: a folder.
//!
//! | file | content |
//! |---|---|
//! | `provenance.json` | what was run, how and where; the SHA-256 of each table |
//! | `trials.parquet`, `targets.parquet` | the rows, in the order of their keys |
//! | `timings.parquet` | the rows of timing passes, if there were any |
//! | `parts/*.json` | trials that were finished since, one file each, written to a temporary file, synchronised and renamed |
//! | `images/` | if requested: `<preset>/<method>/<scene>-<entry>/<frame>.png`, each with the hash in its row |
//! | `digests.txt` | SHA-256 of the images that were read, by path, size, times and inode |
//! | `merge.partial` | while a merge writes: without `provenance.json` its files belong to no store, and are written again |
//! | `run.lock`, `run.json` | the lock of the writing process, and which process it is |
//!
//! A crash loses at most the trials in progress. [`Store::finish`] moves the parts into the tables. Schema versions are the
//! files in `crates/results/schema`; stores of older versions can be read, with nulls in columns that were added later.
//!
//! One process writes at a time. Others may read meanwhile and see every trial that was finished when they began.

mod columns;
mod data;
mod disk;
mod hashes;
pub mod images;
mod merge;
mod parts;
mod read;
mod resume;
mod schema;
mod stored_images;
mod table;
mod targets;
#[cfg(test)]
mod tests;
mod timings;
mod trials;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use atsplat_files::{FolderLock, remove_abandoned};
use atsplat_protocol::trial::ImageDigests;
use rayon::prelude::*;
use serde::Serialize;

pub use data::KnownResults;
pub use merge::{MergeError, Merged, Unfinished, repeated_store};
pub use schema::{SCHEMA_VERSION, schema_hash};
pub use stored_images::StoredImage;

use crate::{MetricRecord, Moved, Provenance, Results, ResultsError, SkippedEntry, TargetRow, TrialRow, WarningCount};
use hashes::{NewTable, TableHashes};
use read::Content;

/// The file that makes a folder a store.
pub const PROVENANCE: &str = "provenance.json";
const TRIALS: &str = "trials.parquet";
const TARGETS: &str = "targets.parquet";
const TABLES: [&str; 3] = [TRIALS, TARGETS, timings::TIMINGS];
const DIGESTS: &str = "digests.txt";
/// The file that says that the tables of a store without [`PROVENANCE`] are those of an unfinished merge.
const MERGING: &str = "merge.partial";

/// A store opened for writing; it is locked against other writers.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    provenance: Provenance,
    /// That of the run that resumed it, until [`Store::finish`] takes over its places.
    run: Option<Provenance>,
    recorded: Mutex<Recorded>,
    known: KnownResults,
    /// Methods with at least one scored target.
    scored_methods: BTreeSet<String>,
    digests: ImageDigests,
    lock: FolderLock,
}

/// What changes in a store's records while a run adds results.
#[derive(Clone, Debug, Default)]
struct Recorded {
    /// Whether they have the command of the run that resumed the store: one that makes nothing leaves none.
    has_command: bool,
    hashes: TableHashes,
}

impl Store {
    /// Creates a store in a folder without one, and checks that it can be written.
    ///
    /// # Errors
    /// [`ResultsError::Io`]; [`ResultsError::HasResults`] if the folder already contains a store, or rows of one; [`ResultsError::InUse`] if
    /// another process is creating one.
    pub fn create(folder: &Path, provenance: Provenance) -> Result<Self, ResultsError> {
        let lock = lock(folder)?;
        Self::create_locked(folder, provenance, lock)
    }

    fn create_locked(folder: &Path, provenance: Provenance, lock: FolderLock) -> Result<Self, ResultsError> {
        require_no_rows(folder)?;
        let digests = ImageDigests::open(&folder.join(DIGESTS), false)?;
        let parts = parts::folder(folder);
        fs::create_dir_all(&parts).map_err(ResultsError::io("creating a results store", &parts))?;
        let provenance = of_this_schema(provenance);
        let (known, scored_methods) = (KnownResults::default(), BTreeSet::new());
        let (folder, recorded) = (folder.to_owned(), Mutex::default());
        let store = Self { folder, provenance, run: None, recorded, known, scored_methods, digests, lock };
        store.write_provenance()?;
        Ok(store)
    }

    /// Opens an existing store for writing.
    ///
    /// # Errors
    /// Those of [`Results::read`], except that rows of different data are accepted, since they can be replaced;
    /// [`ResultsError::InUse`].
    pub fn open(folder: &Path) -> Result<Self, ResultsError> {
        if !folder.join(PROVENANCE).exists() {
            return Err(ResultsError::NoStore { folder: folder.to_owned() });
        }
        let lock = lock(folder)?;
        Self::open_locked(folder, lock, None)
    }

    /// With the metrics of the run that opens it; by default the store's.
    fn open_locked(folder: &Path, lock: FolderLock, metrics: Option<&[MetricRecord]>) -> Result<Self, ResultsError> {
        let Content { provenance, mut hashes, rows, .. } = Content::read(folder)?;
        hashes.add_missing(folder)?;
        let parts = parts::folder(folder);
        fs::create_dir_all(&parts).map_err(ResultsError::io("opening a results store", &parts))?;
        let scored = rows.values().filter(|(_, targets)| targets.iter().any(|target| !target.scores.is_empty()));
        let scored_methods = scored.map(|(trial, _)| trial.key.method.clone()).collect();
        let metrics = metrics.unwrap_or(&provenance.metrics);
        let known = KnownResults::of(rows.into_values(), &provenance.methods, metrics);
        let digests = ImageDigests::open(&folder.join(DIGESTS), false)?;
        let (folder, recorded) = (folder.to_owned(), Mutex::new(Recorded { has_command: false, hashes }));
        Ok(Self { folder, provenance, run: None, recorded, known, scored_methods, digests, lock })
    }

    /// The store's folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// What was run, how and where.
    pub const fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// The places in which the run that resumed the store finds its data and files, where these are not the recorded ones.
    pub fn moved(&self) -> Moved {
        self.run.as_ref().map_or_else(Moved::default, |run| self.provenance.moved(run))
    }

    /// Replaces warnings and skipped entries.
    pub fn set_findings(&mut self, warnings: Vec<WarningCount>, skipped: Vec<SkippedEntry>) {
        self.provenance.warnings = warnings;
        self.provenance.skipped = skipped;
    }

    /// Discards the digests known by size, times and inode, so that every image is read again.
    ///
    /// # Errors
    /// [`ResultsError::Digests`] if the file of digests cannot be read.
    pub fn reread_images(self) -> Result<Self, ResultsError> {
        let digests = ImageDigests::open(&self.folder.join(DIGESTS), true)?;
        Ok(Self { digests, ..self })
    }

    /// Makes a run evaluate again the trials that failed, wholly or in part. Where fewer targets have scores then, the earlier result
    /// stays.
    #[must_use]
    pub fn retry_failed(mut self) -> Self {
        self.known.retry_failed();
        self
    }

    /// Digests of image files.
    pub const fn digests(&self) -> &ImageDigests {
        &self.digests
    }

    /// The results that the store had when it was opened.
    pub const fn known(&self) -> &KnownResults {
        &self.known
    }

    /// Adds a trial atomically; callable from any thread.
    ///
    /// # Errors
    /// [`ResultsError::NotFinite`] before anything is written, [`ResultsError::Io`].
    pub fn append(&self, trial: &TrialRow, targets: &[TargetRow]) -> Result<(), ResultsError> {
        trial.check()?;
        targets.iter().try_for_each(TargetRow::check)?;
        self.record_command()?;
        parts::write(&self.folder, trial, targets)
    }

    /// Records the command of the run that resumed the store, before its first result.
    fn record_command(&self) -> Result<(), ResultsError> {
        let mut recorded = self.recorded();
        if self.run.is_some() && !recorded.has_command {
            let with_command = Recorded { has_command: true, ..recorded.clone() };
            self.write_records(&with_command)?;
            *recorded = with_command;
        }
        Ok(())
    }

    /// Moves all trials into the two tables, unless they were made from different data, and records where the run read its data and
    /// files. If interrupted at any moment, it can be repeated.
    ///
    /// # Errors
    /// Those of [`Results::read`], and [`ResultsError::Io`].
    pub fn finish(self) -> Result<Results, ResultsError> {
        self.finish_and(|_results| Ok(()))
    }

    /// As [`Self::finish`], with more work on the folder before another process can write to it.
    ///
    /// # Errors
    /// Those of [`Self::finish`] and of the work.
    pub fn finish_and<E: From<ResultsError>>(
        mut self,
        work: impl FnOnce(&Results) -> Result<(), E>,
    ) -> Result<Results, E> {
        let results = self.write_all()?;
        work(&results)?;
        Ok(results)
    }

    fn write_all(&mut self) -> Result<Results, ResultsError> {
        self.digests.save()?;
        let content = Content::read(&self.folder)?;
        let parts = content.parts.clone();
        let mut results = content.into_results();
        // The recorded places are those of the rows: first, their data are checked.
        data::check_consistent(&results)?;
        if let Some(run) = self.run.take() {
            self.provenance.take_places(&run);
            if self.recorded().has_command {
                self.provenance.add_commands(&run);
            }
        }
        self.replace_tables(&results.encoded(&self.folder)?)?;
        (results.provenance, _) = read::records(&self.folder)?;
        for part in parts {
            fs::remove_file(&part).map_err(ResultsError::io("removing a part that is in the tables", &part))?;
        }
        fs::remove_dir(parts::folder(&self.folder)).ok();
        Ok(results)
    }

    /// Replaces or removes tables. The records state no hash of them meanwhile, so that the store can be read and resumed if the process
    /// is killed.
    fn replace_tables(&self, tables: &[NewTable]) -> Result<(), ResultsError> {
        let mut recorded = self.recorded();
        recorded.hashes.forget(tables);
        self.write_records(&recorded)?;
        recorded.hashes.write(&self.folder, tables)?;
        self.write_records(&recorded)
    }

    fn recorded(&self) -> MutexGuard<'_, Recorded> {
        self.recorded.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn write_provenance(&self) -> Result<(), ResultsError> {
        self.write_records(&self.recorded())
    }

    fn write_records(&self, recorded: &Recorded) -> Result<(), ResultsError> {
        let mut provenance = self.provenance.clone();
        if let Some(run) = self.run.as_ref().filter(|_| recorded.has_command) {
            provenance.add_commands(run);
        }
        write_records(&self.folder, &provenance, &recorded.hashes)
    }
}

fn of_this_schema(provenance: Provenance) -> Provenance {
    let (schema_version, schema_hash) = (SCHEMA_VERSION, schema_hash());
    Provenance { schema_version, schema_hash, ..provenance }
}

/// The content of [`PROVENANCE`].
#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct Records<'a> {
    #[serde(flatten)]
    provenance: &'a Provenance,
    #[serde(skip_serializing_if = "TableHashes::is_empty")]
    tables_sha256: &'a TableHashes,
}

fn write_records(folder: &Path, provenance: &Provenance, tables_sha256: &TableHashes) -> Result<(), ResultsError> {
    let path = folder.join(PROVENANCE);
    let json = serde_json::to_vec_pretty(&Records { provenance, tables_sha256 });
    let json =
        json.map_err(|error| ResultsError::malformed(&path, "file", "provenance that JSON can represent", error))?;
    disk::write(&path, &json)
}

/// Locks a folder, and removes what a process that was killed left unfinished in it.
fn lock(folder: &Path) -> Result<FolderLock, ResultsError> {
    let lock = FolderLock::of(folder)?;
    remove_abandoned(folder).map_err(ResultsError::io("removing unfinished files", folder))?;
    let merging = folder.join(MERGING);
    if merging.exists() {
        if !folder.join(PROVENANCE).exists() {
            tables(folder).iter().try_for_each(|table| disk::remove(table))?;
            images::remove_all(folder)?;
        }
        disk::remove(&merging)?;
    }
    Ok(lock)
}

/// An error for a folder with a store, or with rows, which would become those of a new one.
fn require_no_rows(folder: &Path) -> Result<(), ResultsError> {
    if folder.join(PROVENANCE).exists() {
        return Err(ResultsError::HasResults { folder: folder.to_owned(), found: "results".to_owned() });
    }
    let parts = disk::files(&parts::folder(folder))?;
    let mut rows = tables(folder).into_iter().filter(|path| path.exists()).chain(parts);
    rows.next().map_or(Ok(()), |rows| {
        let found = format!("{} without {PROVENANCE}", rows.display());
        Err(ResultsError::HasResults { folder: folder.to_owned(), found })
    })
}

fn tables(folder: &Path) -> [PathBuf; 3] {
    TABLES.map(|name| folder.join(name))
}

impl Results {
    /// Reads a store, finished or not; another process may write to it meanwhile.
    ///
    /// # Errors
    /// [`ResultsError::NoStore`]; [`ResultsError::TooNew`] and [`ResultsError::SchemaHash`] for an unknown schema;
    /// [`ResultsError::Malformed`] with file, column and row, or with the stated and the found hash of a table;
    /// [`ResultsError::MixedData`] if methods were given different images or cameras for one trial; [`ResultsError::Io`].
    pub fn read(folder: &Path) -> Result<Self, ResultsError> {
        let results = Content::read(folder)?.into_results();
        data::check_consistent(&results)?;
        Ok(results)
    }

    /// Reads several stores at once, each as [`Self::read`] does; what was read, or the error, is in the order of the folders.
    pub fn read_each<P: AsRef<Path> + Sync>(folders: &[P]) -> Vec<Result<Self, ResultsError>> {
        folders.par_iter().map(|folder| Self::read(folder.as_ref())).collect()
    }

    /// The tables of rows, in the order in which they are written.
    fn encoded(&self, folder: &Path) -> Result<[NewTable; 2], ResultsError> {
        let targets = table::encoded(&folder.join(TARGETS), targets::columns(&self.targets).frame())?;
        let trials = table::encoded(&folder.join(TRIALS), trials::columns(&self.trials).frame())?;
        Ok([(TARGETS, Some(targets)), (TRIALS, Some(trials))])
    }

    /// Writes these rows to a new store. If interrupted at any moment, there is no store or a whole one, and it can be repeated.
    ///
    /// # Errors
    /// Those of [`Store::create`], [`Store::append`] and [`Store::finish`], except for a store of exactly these results;
    /// [`ResultsError::HasResults`] for a folder with `images`.
    pub fn write(&self, folder: &Path) -> Result<(), ResultsError> {
        self.write_merged(folder, &[]).map(|_is_changed| ())
    }

    /// Writes these rows to a new store, with the images of the stores that they were merged from. If interrupted at any moment, there
    /// is no store or a whole one, and it can be repeated. `false` if the folder has exactly these results, and the images, already.
    ///
    /// # Errors
    /// Those of [`Self::write`].
    pub fn write_merged(&self, folder: &Path, parts: &[PathBuf]) -> Result<bool, ResultsError> {
        self.trials.iter().try_for_each(TrialRow::check)?;
        self.targets.iter().try_for_each(TargetRow::check)?;
        data::check_consistent(self)?;
        let _lock = lock(folder)?;
        if self.is_in(folder) {
            return images::add_those_of(parts, folder);
        }
        require_no_rows(folder)?;
        // Under the mark of a merge, they would be removed as its own.
        let images = folder.join(images::FOLDER);
        if images.exists() {
            let found = images.display().to_string();
            return Err(ResultsError::HasResults { folder: folder.to_owned(), found });
        }
        disk::write(&folder.join(MERGING), &[])?;
        let mut hashes = TableHashes::default();
        if !self.timings.is_empty() {
            hashes.write(folder, &[timings::encoded(folder, &self.timings)?])?;
        }
        hashes.write(folder, &self.encoded(folder)?)?;
        images::add_those_of(parts, folder)?;
        // Last, because it makes the folder a store.
        write_records(folder, &of_this_schema(self.provenance.clone()), &hashes)?;
        disk::remove(&folder.join(MERGING)).map(|()| true)
    }

    /// Whether a folder is a store of exactly these results.
    fn is_in(&self, folder: &Path) -> bool {
        let Self { provenance, trials, targets, timings } = self;
        let provenance = of_this_schema(provenance.clone());
        Self::read(folder).is_ok_and(|found| {
            let is_of_run = found.provenance == provenance && found.timings == *timings;
            is_of_run && found.trials == *trials && found.targets == *targets
        })
    }
}
