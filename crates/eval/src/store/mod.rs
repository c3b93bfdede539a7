//! A results store: a folder.
//!
//! | file | holds |
//! |---|---|
//! | `provenance.json` | what was run, with what, where |
//! | `trials.parquet`, `targets.parquet` | the rows, in the order of their keys |
//! | `timings.parquet` | where a timing pass was made: its rows |
//! | `parts/*.json` | trials that were finished since: one file each, written beside, synchronised and renamed |
//! | `pictures/` | where asked for: `<preset>/<method>/<scene>-<entry>/<frame>.png` |
//! | `digests.txt` | SHA-256 of the pictures that were read, by path, size and time of modification |
//! | `run.lock`, `run.json` | whether a process writes here, and which |
//!
//! A crash loses at most the trials that were under way. [`Store::finish`] moves the parts into the tables. Versions of
//! the schema are the files in `crates/eval/schema`: older ones are read, with nothing in columns that came later.
//!
//! One process writes at a time; others may read meanwhile, and see every trial that was finished when they began.

mod columns;
mod data;
pub(crate) mod disk;
mod lock;
mod merge;
mod parts;
mod read;
mod schema;
mod table;
mod targets;
#[cfg(test)]
mod tests;
mod timings;
mod trials;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use atsplat_protocol::trial::PictureDigests;
pub use merge::Merged;
pub use schema::{SCHEMA_VERSION, schema_hash};

use crate::{EvalError, Provenance, Results, TargetRow, TrialRow, TrialStatus};
use data::Known;
use lock::Lock;
use read::Content;

/// The file by which a folder is a store.
pub const PROVENANCE: &str = "provenance.json";
const TRIALS: &str = "trials.parquet";
const TARGETS: &str = "targets.parquet";
const DIGESTS: &str = "digests.txt";

/// A store that is being filled. No other process writes into it meanwhile.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    provenance: Provenance,
    known: Known,
    /// Methods with a trial of which something was compared.
    answered: BTreeSet<String>,
    digests: PictureDigests,
    lock: Lock,
}

impl Store {
    /// Makes a store in a folder that holds none, and tries whether it can be written.
    ///
    /// # Errors
    /// [`EvalError::Io`]; [`EvalError::Different`] where the folder holds a store already, [`EvalError::InUse`] where another
    /// process is about to make one.
    pub fn create(folder: &Path, provenance: Provenance) -> Result<Self, EvalError> {
        let lock = Lock::of(folder)?;
        Self::make(folder, provenance, lock)
    }

    fn make(folder: &Path, provenance: Provenance, lock: Lock) -> Result<Self, EvalError> {
        if folder.join(PROVENANCE).exists() {
            return Err(EvalError::Different {
                what: "the places".to_owned(),
                expected: "an empty folder".to_owned(),
                found: format!("results in {}", folder.display()),
                advice: "; resume them, or choose another folder",
            });
        }
        let parts = parts::folder(folder);
        fs::create_dir_all(&parts).map_err(EvalError::io("making a results store", &parts))?;
        let (schema_version, schema_hash) = (SCHEMA_VERSION, schema_hash());
        let provenance = Provenance { schema_version, schema_hash, ..provenance };
        let digests = PictureDigests::open(&folder.join(DIGESTS), false)?;
        let (known, answered) = (Known::default(), BTreeSet::new());
        let store = Self { folder: folder.to_owned(), provenance, known, answered, digests, lock };
        store.write_provenance()?;
        Ok(store)
    }

    /// Opens a store to go on with it.
    ///
    /// # Errors
    /// As [`Results::read`], except that rows of different data are let through, to be replaced; [`EvalError::InUse`].
    pub fn open(folder: &Path) -> Result<Self, EvalError> {
        if !folder.join(PROVENANCE).exists() {
            return Err(EvalError::NoStore { folder: folder.to_owned() });
        }
        let lock = Lock::of(folder)?;
        Self::of_content(folder, lock)
    }

    fn of_content(folder: &Path, lock: Lock) -> Result<Self, EvalError> {
        let Content { provenance, rows, .. } = Content::read(folder)?;
        let parts = parts::folder(folder);
        fs::create_dir_all(&parts).map_err(EvalError::io("opening a results store", &parts))?;
        let compared = |trial: &TrialRow| matches!(trial.status, TrialStatus::Done | TrialStatus::Partial);
        let answered = rows.values().filter(|(trial, _)| compared(trial)).map(|(trial, _)| trial.key.method.clone());
        let answered = answered.collect();
        let known = Known::of(rows.into_values().map(|(trial, _)| trial));
        let digests = PictureDigests::open(&folder.join(DIGESTS), false)?;
        Ok(Self { folder: folder.to_owned(), provenance, known, answered, digests, lock })
    }

    /// Goes on with the store in a folder, or makes one where there is none. Presets and methods that it lacks are added.
    /// What failed in every trial binds nobody: such a method may be another one now, and a store in which nothing was
    /// compared is begun anew.
    ///
    /// # Errors
    /// As [`Self::create`] and [`Self::open`]; [`EvalError::Differences`] where what stands there was made in another way, or
    /// with a schema that is older.
    pub fn resume(folder: &Path, provenance: Provenance) -> Result<Self, EvalError> {
        let lock = Lock::of(folder)?;
        if !folder.join(PROVENANCE).exists() {
            return Self::make(folder, provenance, lock);
        }
        let mut store = Self::of_content(folder, lock)?;
        let mut joined = store.provenance.clone();
        let mut replaced = Vec::new();
        for known in joined.methods.iter_mut().filter(|known| !store.answered.contains(&known.name)) {
            let own = provenance.methods.iter().find(|own| own.name == known.name);
            if let Some(own) = own.filter(|own| *own != known) {
                replaced.push(known.name.clone());
                known.clone_from(own);
            }
        }
        match joined.go_on_with(provenance.clone()) {
            Ok(()) => {
                store.known.forget(&replaced);
                store.provenance = joined;
                store.write_provenance()?;
                Ok(store)
            }
            Err(_other) if store.answered.is_empty() => store.begin_anew(provenance),
            Err(other) => Err(other),
        }
    }

    /// Removes rows that hold no number, and what they were made with.
    fn begin_anew(self, provenance: Provenance) -> Result<Self, EvalError> {
        let rows = [TRIALS, TARGETS].map(|name| self.folder.join(name));
        for path in rows.into_iter().chain(disk::files(&parts::folder(&self.folder))?) {
            disk::remove(&path)?;
        }
        disk::remove(&self.folder.join(PROVENANCE))?;
        Self::make(&self.folder, provenance, self.lock)
    }

    /// Where it is.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// What it says of itself.
    pub const fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// Replaces what it says of datasets: warnings and entries that made no trial.
    pub fn set_findings(&mut self, findings: crate::runner::Findings) {
        self.provenance.warnings = findings.warnings;
        self.provenance.skipped = findings.skipped;
    }

    /// Forgets which pictures are known by size and time of modification, so that every one is read again.
    ///
    /// # Errors
    /// [`EvalError::Protocol`] where the file that remembers them cannot be read.
    pub fn reread_pictures(self) -> Result<Self, EvalError> {
        let digests = PictureDigests::open(&self.folder.join(DIGESTS), true)?;
        Ok(Self { digests, ..self })
    }

    /// What is known of pictures' bytes.
    pub(crate) const fn digests(&self) -> &PictureDigests {
        &self.digests
    }

    /// The trials that were there when the store was opened.
    pub(crate) const fn known(&self) -> &Known {
        &self.known
    }

    /// Adds a trial, whole or not at all; callable from any thread.
    ///
    /// # Errors
    /// [`EvalError::NotFinite`] before anything is written, [`EvalError::Io`].
    pub fn append(&self, trial: &TrialRow, targets: &[TargetRow]) -> Result<(), EvalError> {
        trial.check()?;
        targets.iter().try_for_each(TargetRow::check)?;
        parts::write(&self.folder, trial, targets)
    }

    /// Moves all trials into the two tables. Killed at any moment, it can be done again.
    ///
    /// # Errors
    /// As [`Results::read`], and [`EvalError::Io`].
    pub fn finish(self) -> Result<Results, EvalError> {
        self.digests.keep()?;
        self.write_provenance()?;
        let content = Content::read(&self.folder)?;
        let parts = content.parts.clone();
        let results = content.into_results();
        table::write(&self.folder.join(TARGETS), targets::columns(&results.targets).frame())?;
        table::write(&self.folder.join(TRIALS), trials::columns(&results.trials).frame())?;
        for part in parts {
            fs::remove_file(&part).map_err(EvalError::io("removing what is in the tables now", &part))?;
        }
        fs::remove_dir(parts::folder(&self.folder)).ok();
        data::of_one_dataset(&results)?;
        Ok(results)
    }

    fn write_provenance(&self) -> Result<(), EvalError> {
        let path = self.folder.join(PROVENANCE);
        let json = serde_json::to_vec_pretty(&self.provenance);
        let json = json.map_err(|error| EvalError::malformed(&path, "file", "provenance that JSON holds", error))?;
        disk::write(&path, &json)
    }
}

impl Results {
    /// Reads a store, finished or not, while another process writes into it or not.
    ///
    /// # Errors
    /// [`EvalError::NoStore`]; [`EvalError::TooNew`] and [`EvalError::SchemaHash`] for a schema that is not known;
    /// [`EvalError::Malformed`] with file, column and row; [`EvalError::MixedData`] where methods were given different
    /// pictures or cameras under one name; [`EvalError::Io`].
    pub fn read(folder: &Path) -> Result<Self, EvalError> {
        let results = Content::read(folder)?.into_results();
        data::of_one_dataset(&results)?;
        Ok(results)
    }

    /// Writes these rows into a new store.
    ///
    /// # Errors
    /// As [`Store::create`], [`Store::append`] and [`Store::finish`].
    pub fn write(&self, folder: &Path) -> Result<(), EvalError> {
        let store = Store::create(folder, self.provenance.clone())?;
        self.trials.iter().try_for_each(TrialRow::check)?;
        self.targets.iter().try_for_each(TargetRow::check)?;
        table::write(&folder.join(TARGETS), targets::columns(&self.targets).frame())?;
        table::write(&folder.join(TRIALS), trials::columns(&self.trials).frame())?;
        if !self.timings.is_empty() {
            timings::write(folder, &self.timings)?;
        }
        store.finish().map(drop)
    }
}
