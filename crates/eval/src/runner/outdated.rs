use std::collections::BTreeSet;

use atsplat_protocol::trial::{Skipped, Trial};
use atsplat_results::{Store, TrialId};

use super::findings::depends_on_poses;
use super::group_run::trial_id;
use super::plan::{Dataset, Plan};
use crate::EvalError;

const RECOMPUTE: &str = "run these methods too, so that they are recomputed";
const RESTORE: &str = "restore the data";

/// Results in a store that were computed from data which has changed since, and which a run would not replace.
pub(super) struct Outdated<'a> {
    plan: &'a Plan<'a>,
    dataset: &'a Dataset,
    store: &'a Store,
    count: usize,
    first: Option<(String, &'static str)>,
}

impl<'a> Outdated<'a> {
    pub(super) const fn of(plan: &'a Plan<'a>, dataset: &'a Dataset, store: &'a Store) -> Self {
        Self { plan, dataset, store, count: 0, first: None }
    }

    /// Checks the current state of a trial. Outdated results of the run's methods are recomputed; those of other methods are
    /// recorded here.
    pub(super) fn check_trial(&mut self, trial: &Trial, data_hash: &str) {
        let id = self.id(trial.scene(), trial.entry_number());
        for method in self.store.known().outdated(&id, data_hash) {
            if !self.plan.methods.iter().any(|run| run.record().name == method) {
                self.note(&id, method, "its images or cameras changed", RECOMPUTE);
            }
        }
    }

    /// Checks a trial of which so many targets can be scored, because of an image that cannot be decoded: results of the run's methods
    /// with more scores are not replaced.
    pub(super) fn check_scorable(&mut self, trial: &Trial, data_hash: &str, targets: usize, why: &str) {
        let (id, known) = (self.id(trial.scene(), trial.entry_number()), self.store.known());
        for method in known.outdated(&id, data_hash) {
            let is_run = self.plan.methods.iter().any(|run| run.record().name == method);
            if is_run && known.scored(&id.of_method(method)) > targets {
                self.note(&id, method, &format!("an image changed and cannot be decoded: {why}"), RESTORE);
            }
        }
    }

    /// Checks an entry that is skipped now for the methods of a group. Whether poses can be normalised depends on the method, so
    /// that reason alone does not make other methods' results outdated.
    pub(super) fn check_skipped(&mut self, skipped: &Skipped, group: &BTreeSet<String>) {
        let is_of_group = depends_on_poses(skipped.reason);
        let id = self.id(&skipped.scene, skipped.entry_number);
        let methods = self.store.known().methods(&id);
        for method in methods.filter(|method| !is_of_group || group.contains(*method)) {
            let why = format!("its entry is skipped now, {}: {}", skipped.reason.name(), skipped.detail);
            self.note(&id, method, &why, RESTORE);
        }
    }

    /// Checks a scene that is missing from the dataset.
    pub(super) fn check_missing_scene(&mut self, scene: &str) {
        let entries = self.dataset.index.index.scenes.get(scene).map_or(0, Vec::len);
        for entry in 0..entries {
            let id = self.id(scene, entry);
            for method in self.store.known().methods(&id) {
                self.note(&id, method, "the scene is no longer in the data", RESTORE);
            }
        }
    }

    /// # Errors
    /// [`EvalError::DataChanged`] if any result is outdated.
    pub(super) fn into_result(self) -> Result<(), EvalError> {
        match self.first {
            None => Ok(()),
            Some((first, advice)) => Err(EvalError::DataChanged { count: self.count, first, advice }),
        }
    }

    fn id(&self, scene: &str, entry: usize) -> TrialId {
        trial_id(&self.dataset.name, scene, entry)
    }

    fn note(&mut self, id: &TrialId, method: &str, why: &str, advice: &'static str) {
        self.count += 1;
        self.first.get_or_insert_with(|| (format!("{}: {why}", id.of_method(method)), advice));
    }
}
