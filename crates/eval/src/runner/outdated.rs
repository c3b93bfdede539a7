use atsplat_protocol::DropReason;
use atsplat_protocol::trial::{SkipReason, Skipped, Trial};

use super::plan::{Dataset, Plan};
use super::walk::number;
use crate::{EvalError, Store, TrialKey};

const RECOMPUTE: &str = "run these methods too, so that they are computed again";
const RESTORE: &str = "bring the data back";

/// Results in a store that were made from other data than there is now, and that a run would leave as they are.
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

    /// A trial as it is now. What the run's own methods made of other data is computed again; what others made stays.
    pub(super) fn look_at(&mut self, trial: &Trial, data_hash: &str) {
        let key = self.key(trial.scene(), trial.entry_number());
        for method in self.store.known().outdated(&key, data_hash) {
            if !self.plan.methods.iter().any(|own| own.record().name == method) {
                self.note(&key, method, "its pictures or cameras changed", RECOMPUTE);
            }
        }
    }

    /// An entry that makes no trial any more. Whether poses can be normalised depends on the method: that alone says
    /// nothing of what others made.
    pub(super) fn look_at_skipped(&mut self, skipped: &Skipped) {
        if matches!(skipped.reason, SkipReason::PoseNormalisation | SkipReason::Dropped(DropReason::Baseline)) {
            return;
        }
        let key = self.key(&skipped.scene, skipped.entry_number);
        for method in self.store.known().methods(&key.preset, &key.scene, key.entry) {
            let why = format!("it is skipped now, {}: {}", skipped.reason.name(), skipped.detail);
            self.note(&key, method, &why, RESTORE);
        }
    }

    /// A scene that the dataset lacks.
    pub(super) fn look_at_absent(&mut self, scene: &str) {
        let entries = self.dataset.index.index.scenes.get(scene).map_or(0, Vec::len);
        for entry in 0..entries {
            let key = self.key(scene, entry);
            for method in self.store.known().methods(&key.preset, &key.scene, key.entry) {
                self.note(&key, method, "the scene is not in the data any more", RESTORE);
            }
        }
    }

    /// # Errors
    /// [`EvalError::DataChanged`] where there is any.
    pub(super) fn refuse(self) -> Result<(), EvalError> {
        match self.first {
            None => Ok(()),
            Some((first, advice)) => Err(EvalError::DataChanged { count: self.count, first, advice }),
        }
    }

    fn key(&self, scene: &str, entry: usize) -> TrialKey {
        let preset = self.dataset.name.clone();
        TrialKey { preset, method: String::new(), scene: scene.to_owned(), entry: number(entry) }
    }

    fn note(&mut self, key: &TrialKey, method: &str, why: &str, advice: &'static str) {
        self.count += 1;
        let key = TrialKey { method: method.to_owned(), ..key.clone() };
        self.first.get_or_insert_with(|| (format!("{key}: {why}"), advice));
    }
}
