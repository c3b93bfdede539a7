//! A results store: a folder.
//!
//! | file | holds |
//! |---|---|
//! | `provenance.json` | what was run, with what, where |
//! | `trials.parquet`, `targets.parquet` | the rows, in the order of their keys |
//! | `timings.parquet` | where a timing pass was made: its rows |
//! | `parts/*.json` | trials that were finished since: one file each, written beside, synchronised and renamed |
//! | `pictures/` | where asked for: `<preset>/<method>/<scene>-<entry>/<frame>.png` |
//!
//! A crash loses at most the trials that were under way. [`Store::finish`] moves the parts into the tables. Versions of
//! the schema are the files in `crates/eval/schema`: older ones are read, with nothing in columns that came later.

mod columns;
pub(crate) mod disk;
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

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

pub use merge::Merged;
pub(crate) use schema::hexadecimal;
pub use schema::{SCHEMA_VERSION, schema_hash};

use crate::{EvalError, Provenance, Results, TargetRow, TrialKey, TrialRow};
use read::Content;

/// The file by which a folder is a store.
pub const PROVENANCE: &str = "provenance.json";
const TRIALS: &str = "trials.parquet";
const TARGETS: &str = "targets.parquet";

/// A store that is being filled.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    provenance: Provenance,
    /// Hash of every trial that is there.
    known: BTreeMap<TrialKey, String>,
}

impl Store {
    /// Makes a store in a folder that holds none, and tries whether it can be written.
    ///
    /// # Errors
    /// [`EvalError::Io`]; [`EvalError::Different`] where the folder holds a store already.
    pub fn create(folder: &Path, provenance: Provenance) -> Result<Self, EvalError> {
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
        let store = Self { folder: folder.to_owned(), provenance, known: BTreeMap::new() };
        store.write_provenance()?;
        Ok(store)
    }

    /// Opens a store to go on with it.
    ///
    /// # Errors
    /// As [`Results::read`]. A store of an older schema is read but not gone on with: [`EvalError::Different`].
    pub fn open(folder: &Path) -> Result<Self, EvalError> {
        let Content { provenance, rows, .. } = Content::read(folder)?;
        let parts = parts::folder(folder);
        fs::create_dir_all(&parts).map_err(EvalError::io("opening a results store", &parts))?;
        let known = rows.into_iter().map(|(key, (trial, _))| (key, trial.trial_hash)).collect();
        Ok(Self { folder: folder.to_owned(), provenance, known })
    }

    /// Goes on with the store in a folder, or makes one where there is none. Presets and methods that it lacks are added.
    ///
    /// # Errors
    /// As [`Self::create`] and [`Self::open`]; [`EvalError::Different`] where what stands there was made in another way.
    pub fn resume(folder: &Path, provenance: Provenance) -> Result<Self, EvalError> {
        if !folder.join(PROVENANCE).exists() {
            return Self::create(folder, provenance);
        }
        let mut store = Self::open(folder)?;
        store.provenance.go_on_with(provenance)?;
        store.write_provenance()?;
        Ok(store)
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

    /// Hash of a trial that is there.
    pub fn trial_hash(&self, key: &TrialKey) -> Option<&str> {
        self.known.get(key).map(String::as_str)
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
    /// Reads a store, finished or not.
    ///
    /// # Errors
    /// [`EvalError::NoStore`]; [`EvalError::TooNew`] and [`EvalError::SchemaHash`] for a schema that is not known;
    /// [`EvalError::Malformed`] with file, column and row; [`EvalError::Io`].
    pub fn read(folder: &Path) -> Result<Self, EvalError> {
        Ok(Content::read(folder)?.into_results())
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
