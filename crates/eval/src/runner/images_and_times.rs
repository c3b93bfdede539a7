//! Images and times belong to the rows that they were made with: they are removed before a row is replaced, so that a killed run
//! loses them instead of leaving them with another row. A row that is made again from the same trial, data and files, for a
//! metric or an image that it lacks, keeps its times, and the images of renders that are the same again. One that is made again
//! because it failed keeps the images alone: its times may be those of the failure.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, PoisonError};

use atsplat_protocol::trial::Trial;
use atsplat_results::store::StoredImage;
use atsplat_results::store::images::{self, CONTEXT, TRUTH};
use atsplat_results::{ResultsError, Store, TrialId, TrialKey, TrialRow};

use super::KeepImages;
use super::group_run::trial_id;

/// Images and times that a store contained when a run began.
#[derive(Debug)]
pub(super) struct ImagesAndTimes<'a> {
    store: &'a Store,
    /// The images of each result that are to be kept; empty unless the run keeps all images.
    kept: BTreeMap<TrialKey, Vec<StoredImage>>,
    /// Results whose times are in the store. The lock is held while the table of times is written.
    timed: Mutex<BTreeSet<TrialKey>>,
    /// Trials whose images of other data were removed.
    renewed: Mutex<BTreeSet<TrialId>>,
}

impl<'a> ImagesAndTimes<'a> {
    /// After the images of a run that was killed are settled.
    pub(super) fn of(store: &'a Store, keep: KeepImages) -> Result<Self, ResultsError> {
        images::settle(store)?;
        let kept = if keep == KeepImages::All { store.images_of_results()? } else { BTreeMap::new() };
        let timed = store.timings()?.into_iter().map(|row| row.key).collect();
        Ok(Self { store, kept, timed: Mutex::new(timed), renewed: Mutex::default() })
    }

    /// Whether the run keeps all images, and the store has a result without one of its images, or with another result's.
    pub(super) fn lacks_images(&self, key: &TrialKey) -> Result<bool, ResultsError> {
        for StoredImage { key, frame, hash } in self.kept.get(key).into_iter().flatten() {
            if !images::is_stored(self.store.folder(), key, *frame, hash.as_deref())? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Removes the images of a trial's results that were computed from other data, and the images of that data.
    pub(super) fn remove_outdated_images(
        &self,
        preset: &str,
        trial: &Trial,
        data_hash: &str,
    ) -> Result<(), ResultsError> {
        self.remove_images_of(&trial_id(preset, trial.scene(), trial.entry_number()), data_hash)
    }

    fn remove_images_of(&self, trial: &TrialId, data_hash: &str) -> Result<(), ResultsError> {
        let known = self.store.known();
        let outdated: Vec<&str> = known.outdated(trial, data_hash).collect();
        // Once in a run: methods with other poses evaluate the trial after those that have replaced their images.
        if outdated.is_empty() || !self.renewed.lock().unwrap_or_else(PoisonError::into_inner).insert(trial.clone()) {
            return Ok(());
        }
        // If a run was killed after it had replaced some of the results, it had removed the images of the old data before.
        let is_all = known.methods(trial).count() == outdated.len();
        let of_data = [TRUTH, CONTEXT].into_iter().filter(|_| is_all);
        let mut names = outdated.iter().copied().chain(of_data);
        names.try_for_each(|name| images::remove(self.store.folder(), &trial.of_method(name)))
    }

    /// Removes the times of the row that this one replaces, unless that was made from the same data and files, and had not failed.
    pub(super) fn remove_outdated_times(&self, row: &TrialRow) -> Result<(), ResultsError> {
        let TrialRow { key, trial_hash, data_hash, input_hash, .. } = row;
        let (known, data_hash) = (self.store.known(), data_hash.as_deref().unwrap_or_default());
        if known.contains(key, trial_hash, data_hash, input_hash.as_deref()) && !known.is_retried(key) {
            return Ok(());
        }
        let mut timed = self.timed.lock().unwrap_or_else(PoisonError::into_inner);
        if timed.remove(key) { self.store.remove_timings(key) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use atsplat_results::Provenance;
    use atsplat_results::store::images::image_path;

    use super::*;
    use crate::sample_rows::{key, target, trial};

    const NAMES: [&str; 4] = ["a", "b", TRUTH, CONTEXT];

    fn write(store: &Store, scene: &str, names: &[&str]) {
        for name in names {
            atsplat_tests::write_file(&image_path(store.folder(), &key(name, scene, 0), 0), "an image");
        }
    }

    fn stored(store: &Store, scene: &str) -> [bool; 4] {
        NAMES.map(|name| image_path(store.folder(), &key(name, scene, 0), 0).exists())
    }

    /// Scenes x and y under methods a and b, all with images; the result of a in x was computed from this data.
    fn store(folder: &Path, data_of_a: &str) -> Store {
        let store = Store::create(folder, Provenance::default()).unwrap();
        for scene in ["x", "y"] {
            for name in ["a", "b"] {
                let mut row = trial(name, scene, 0, 1);
                if (scene, name) == ("x", "a") {
                    row.data_hash = Some(data_of_a.to_owned());
                }
                store.append(&row, &[target(name, scene, 0, 0, "psnr", 20.0)]).unwrap();
            }
        }
        drop(store);
        let store = Store::open(folder).unwrap();
        for scene in ["x", "y"] {
            write(&store, scene, &NAMES);
        }
        store
    }

    #[test]
    fn images_of_other_data_are_removed_once() {
        let folder = tempfile::tempdir().unwrap();
        let store = store(folder.path(), "data x 0");
        let images_and_times = ImagesAndTimes::of(&store, KeepImages::Nothing).unwrap();
        let of_x = key("a", "x", 0).trial();
        images_and_times.remove_images_of(&of_x, "data x 0").unwrap();
        assert_eq!(stored(&store, "x"), [true; 4], "the same data");
        images_and_times.remove_images_of(&of_x, "other").unwrap();
        assert_eq!((stored(&store, "x"), stored(&store, "y")), ([false; 4], [true; 4]));
        // a was evaluated again; b has other poses, and follows.
        write(&store, "x", &["a", TRUTH]);
        images_and_times.remove_images_of(&of_x, "other").unwrap();
        assert_eq!(stored(&store, "x"), [true, false, true, false]);
    }

    #[test]
    fn images_of_new_data_stay_if_a_run_was_killed_between_two_methods() {
        let folder = tempfile::tempdir().unwrap();
        let store = store(folder.path(), "other");
        let images_and_times = ImagesAndTimes::of(&store, KeepImages::Nothing).unwrap();
        images_and_times.remove_images_of(&key("a", "x", 0).trial(), "other").unwrap();
        assert_eq!(stored(&store, "x"), [true, false, true, true]);
    }
}
