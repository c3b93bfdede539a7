//! What a run does with the results of the store that it resumes.

use std::collections::BTreeSet;
use std::path::Path;

use super::read::{Content, Rows};
use super::timings::{self, TIMINGS};
use super::{PROVENANCE, Store, TARGETS, TRIALS, disk, lock, parts};
use crate::{Moved, Provenance, ResultsError};

/// What a run does with the results of a store.
enum Resumption {
    /// It keeps them and adds others.
    Continue {
        /// The store's record with what the run adds.
        record: Box<Provenance>,
        /// Methods whose rows, none of which has a score, go: the run has other ones of their names.
        replaced: BTreeSet<String>,
    },
    /// It removes all of them, none of which has a score, and begins with its own record.
    Restart,
}

impl Resumption {
    /// Decides, without changing anything.
    ///
    /// # Errors
    /// Those of [`Store::resume`] for results that the run cannot resume.
    fn of(store: &Store, run: &Provenance) -> Result<Self, ResultsError> {
        let (mut record, replaced) = store.record_with_replaced_methods(run);
        record.forget_added_scenes(run, |preset| store.known.entries_of(preset, &store.provenance.skipped));
        let moved = record.moved(run);
        let joined = record.resume_with(run.clone());
        // Without a score, nothing is worth the record of another run, or of data that were given by mistake.
        if store.scored_methods.is_empty() && (joined.is_err() || !moved.data.is_empty()) {
            return Ok(Self::Restart);
        }
        joined?;
        store.check_compared(&moved, run)?;
        record.forget_skipped(&replaced);
        Ok(Self::Continue { record: Box::new(record), replaced })
    }
}

impl Store {
    /// Resumes the store in a folder for a run, or creates one if there is none.
    ///
    /// - Results that the run would make in the same way stay. It may add presets, methods, metrics and scenes that a limit or the data
    ///   left out ([`KnownResults::lacks_metric`](super::KnownResults::lacks_metric) says which results lack a metric); scenes that a
    ///   stopped run added to the record alone may be missing again. Data, indices and imported files may be in other places: the run
    ///   has to reject other contents in those of [`Self::moved`], and [`Self::finish`] records its places.
    /// - A method without a score may be replaced by another of its name; its rows are removed.
    /// - If nothing has a score, a run that cannot resume the results, or has its data in another place, removes all of them.
    ///
    /// # Errors
    /// Those of [`Self::create`] and [`Self::open`]; [`ResultsError::Differences`] if the existing results were made in
    /// another way or with an older schema; [`ResultsError::Different`] if a method's files are in another folder, and the run
    /// lacks a protocol of its results, under which they could be compared.
    pub fn resume(folder: &Path, run: Provenance) -> Result<Self, ResultsError> {
        let lock = lock(folder)?;
        if !folder.join(PROVENANCE).exists() {
            return Self::create_locked(folder, run, lock);
        }
        let mut store = Self::open_locked(folder, lock, Some(run.metrics.as_slice()))?;
        match Resumption::of(&store, &run)? {
            Resumption::Restart => store.restart(run),
            Resumption::Continue { record, replaced } => {
                // Under the new records, the run after one that is killed would keep the old rows.
                if !replaced.is_empty() {
                    store.remove_rows(|method| replaced.contains(method))?;
                    store.known.forget(&replaced);
                }
                store.provenance = *record;
                store.write_provenance()?;
                store.run = Some(run);
                Ok(store)
            }
        }
    }

    /// The record with the run's methods in place of others of their names that have no score, and these names.
    fn record_with_replaced_methods(&self, run: &Provenance) -> (Provenance, BTreeSet<String>) {
        let mut record = self.provenance.clone();
        let mut replaced = BTreeSet::new();
        for known in record.methods.iter_mut().filter(|known| !self.scored_methods.contains(&known.name)) {
            let Some(requested) = run.method(&known.name) else { continue };
            if requested.is_elsewhere(known) || requested.clone().with_places_recorded_in(&self.provenance) != *known {
                replaced.insert(known.name.clone());
                known.clone_from(requested);
            }
        }
        (record, replaced)
    }

    /// Rejects files in another folder if the method has results of a protocol that the run does not have: the record names one
    /// folder for all.
    fn check_compared(&self, moved: &Moved, run: &Provenance) -> Result<(), ResultsError> {
        const ADVICE: &str = "; run it under all of them, so that the contents of its files are compared, or choose another name for it \
                              or another folder for the results";
        for (method, [first, found]) in &moved.files {
            let lacks = |preset: &str| run.preset(preset).is_none() && self.known.has(preset, method);
            if let Some(preset) = self.provenance.presets.iter().find(|preset| lacks(&preset.name)) {
                let expected = format!("those of {method} in {first}, also under {}", preset.name);
                let found = format!("those in {found}, without this protocol");
                return Err(ResultsError::Different { what: "imported files", expected, found, advice: ADVICE });
            }
        }
        Ok(())
    }

    /// Removes all rows, none of which has a score, and the provenance.
    fn restart(self, run: Provenance) -> Result<Self, ResultsError> {
        self.remove_rows(|_method| true)?;
        for unfinished in disk::files(&parts::folder(&self.folder))? {
            disk::remove(&unfinished)?;
        }
        disk::remove(&self.folder.join(PROVENANCE))?;
        Self::create_locked(&self.folder, run, self.lock)
    }

    /// Removes the rows of some methods from disk. Until the rows are gone from both tables, part files override them, so an
    /// interrupted removal leaves a readable store and can be repeated.
    fn remove_rows(&self, is_removed: impl Fn(&str) -> bool) -> Result<(), ResultsError> {
        let mut content = Content::read(&self.folder)?;
        let timed = content.timings.len();
        content.timings.retain(|row| !is_removed(&row.key.method));
        match content.timings.len() {
            0 if self.folder.join(TIMINGS).exists() => self.replace_tables(&[(TIMINGS, None)])?,
            kept if kept < timed => self.replace_tables(&[timings::encoded(&self.folder, &content.timings)?])?,
            _ => {}
        }
        let rows = std::mem::take(&mut content.rows);
        let (removed, kept): (Rows, Rows) = rows.into_iter().partition(|(key, _)| is_removed(&key.method));
        for (trial, targets) in removed.values() {
            if !parts::path(&self.folder, &trial.key).exists() {
                parts::write(&self.folder, trial, targets)?;
            }
        }
        if kept.is_empty() {
            self.replace_tables(&[(TARGETS, None), (TRIALS, None)])?;
        } else if !removed.is_empty() {
            let kept = Content { rows: kept, ..content }.into_results();
            self.replace_tables(&kept.encoded(&self.folder)?)?;
        }
        removed.keys().try_for_each(|key| disk::remove(&parts::path(&self.folder, key)))
    }
}
