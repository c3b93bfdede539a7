use std::sync::Arc;

use atsplat_protocol::trial::{DecodeAhead, Prefetch, TargetPictures, Trial, TrialRecipe, Trials};
use atsplat_protocol::{EvaluationIndex, Preset};
use rayon::prelude::*;

use super::Findings;
use super::evaluate::{Decoded, Evaluation};
use super::pictures::Keeping;
use super::plan::{Dataset, Plan, Summary};
use crate::method::Method;
use crate::{EvalError, Store, TrialKey};

/// Methods that take the same pose normalisation and planes, and so the same trials.
pub(crate) fn groups(preset: &Preset, methods: &[Arc<dyn Method>]) -> Vec<Vec<Arc<dyn Method>>> {
    let mut groups: Vec<Vec<Arc<dyn Method>>> = Vec::new();
    for method in methods {
        let alike = |group: &&mut Vec<Arc<dyn Method>>| {
            group.first().is_some_and(|first| preset.setting_of(first.setting()) == preset.setting_of(method.setting()))
        };
        match groups.iter_mut().find(alike) {
            Some(group) => group.push(Arc::clone(method)),
            None => groups.push(vec![Arc::clone(method)]),
        }
    }
    groups
}

pub(crate) fn recipe(dataset: &Dataset, methods: &[Arc<dyn Method>]) -> TrialRecipe {
    TrialRecipe::of(&dataset.preset, methods.first().map_or("ATSplat", |method| method.setting()))
}

pub(crate) fn key_of(dataset: &Dataset, method: &dyn Method, scene: &str, entry: usize) -> TrialKey {
    TrialKey {
        preset: dataset.name.clone(),
        method: method.record().name,
        scene: scene.to_owned(),
        entry: u32::try_from(entry).unwrap_or(u32::MAX),
    }
}

/// One walk over a dataset.
pub(super) struct Walk<'a> {
    pub(super) plan: &'a Plan<'a>,
    pub(super) dataset: &'a Dataset,
    pub(super) methods: Vec<Arc<dyn Method>>,
    pub(super) store: &'a Store,
    pub(super) keeping: Keeping<'a>,
    pub(super) step: &'a (dyn Fn() + Sync),
}

impl Walk<'_> {
    pub(super) fn run(
        &self,
        index: &EvaluationIndex,
        findings: &mut Findings,
        summary: &mut Summary,
    ) -> Result<(), EvalError> {
        let (known, mut rest) = self.parted(index);
        // Scenes that are there are looked at without their pictures: whether they still ask the same.
        let ahead = Prefetch { decode: DecodeAhead::Nothing, ..self.plan.prefetch };
        let mut trials = self.trials(&known, ahead);
        let mut changed = Vec::new();
        for outcome in trials.by_ref() {
            match outcome {
                Ok((trial, _)) if self.missing(&trial).is_empty() => {
                    summary.resumed += self.methods.len() as u64;
                    self.methods.iter().for_each(|_| (self.step)());
                }
                Ok((trial, _)) => changed.push(trial.scene().to_owned()),
                Err(_skipped) => self.methods.iter().for_each(|_| (self.step)()),
            }
        }
        self.found(&trials, findings);
        rest.scenes.extend(known.scenes.into_iter().filter(|(key, _)| changed.contains(key)));
        let mut trials = self.trials(&rest, self.plan.prefetch);
        loop {
            let batch: Vec<_> = trials.by_ref().take(self.together()).collect();
            if batch.is_empty() {
                break;
            }
            let mut work = Vec::new();
            for outcome in batch {
                match outcome {
                    Ok(trial) => work.push(trial),
                    Err(_skipped) => self.methods.iter().for_each(|_| (self.step)()),
                }
            }
            let evaluated: Vec<(u64, u64)> = if work.len() > 1 {
                work.into_par_iter().map(|(trial, targets)| self.evaluate(trial, &targets)).collect::<Result<_, _>>()?
            } else {
                work.into_iter().map(|(trial, targets)| self.evaluate(trial, &targets)).collect::<Result<_, _>>()?
            };
            for (evaluated, resumed) in evaluated {
                summary.evaluated += evaluated;
                summary.resumed += resumed;
            }
        }
        self.found(&trials, findings);
        Ok(())
    }

    /// Scenes of which everything is there, and the others.
    fn parted(&self, index: &EvaluationIndex) -> (EvaluationIndex, EvaluationIndex) {
        let is_known = |scene: &str, entries: usize| {
            let mut keys = (0..entries).flat_map(|entry| {
                self.methods.iter().map(move |method| key_of(self.dataset, method.as_ref(), scene, entry))
            });
            keys.all(|key| self.store.trial_hash(&key).is_some())
        };
        let (mut known, mut rest) = (EvaluationIndex::default(), EvaluationIndex::default());
        for (scene, entries) in &index.scenes {
            let part = if is_known(scene, entries.len()) { &mut known } else { &mut rest };
            part.scenes.insert(scene.clone(), entries.clone());
        }
        (known, rest)
    }

    fn trials(&self, index: &EvaluationIndex, prefetch: Prefetch) -> Trials {
        Trials::new(Arc::clone(&self.dataset.source), index, recipe(self.dataset, &self.methods), prefetch)
    }

    /// Methods that have not answered this very question.
    fn missing(&self, trial: &Trial) -> Vec<&Arc<dyn Method>> {
        let hash = trial.hash().to_string();
        let answered = |method: &&Arc<dyn Method>| {
            let key = key_of(self.dataset, method.as_ref(), trial.scene(), trial.entry_number());
            self.store.trial_hash(&key) == Some(hash.as_str())
        };
        self.methods.iter().filter(|method| !answered(method)).collect()
    }

    /// Trials that are worked on at once. Networks take too much memory for several.
    fn together(&self) -> usize {
        let one = self.methods.iter().any(|method| method.is_heavy());
        if one { 1 } else { 2 * rayon::current_num_threads() }
    }

    /// Evaluates a trial under each method that has not answered it; how many did, and how many had.
    fn evaluate(&self, trial: Trial, targets: &TargetPictures) -> Result<(u64, u64), EvalError> {
        let decoded = Decoded::new(trial, targets);
        let missing = self.missing(&decoded.trial);
        let evaluation = Evaluation { preset: &self.dataset.preset, suite: self.plan.suite, pictures: self.keeping };
        let before = (self.methods.len() - missing.len()) as u64;
        (0..before).for_each(|_| (self.step)());
        for method in &missing {
            let trial = &decoded.trial;
            let key = key_of(self.dataset, method.as_ref(), trial.scene(), trial.entry_number());
            let (row, targets) = evaluation.rows(key, &decoded, method.as_ref())?;
            self.store.append(&row, &targets)?;
            (self.step)();
        }
        Ok((missing.len() as u64, before))
    }

    fn found(&self, trials: &Trials, findings: &mut Findings) {
        findings.add_warnings(&self.dataset.name, trials.warnings());
        findings.add_skipped(&self.dataset.name, trials.report());
    }
}
