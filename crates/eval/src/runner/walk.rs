use atsplat_files::Sha256Digest;
use std::sync::Arc;

use atsplat_protocol::trial::{DecodeAhead, PictureDigests, Prefetch, TargetPictures, Trial, TrialRecipe, Trials};
use atsplat_protocol::{EvaluationIndex, Preset};
use atsplat_scene::Warnings;
use indexmap::IndexMap;
use rayon::prelude::*;

use super::Findings;
use super::evaluate::{Decoded, Evaluation};
use super::outdated::Outdated;
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
        entry: number(entry),
    }
}

/// How many entries or targets a scene has, as rows have it.
#[expect(clippy::expect_used, reason = "no index file holds so many")]
pub(super) fn number(count: usize) -> u32 {
    u32::try_from(count).expect("a scene has fewer than 2³² entries and targets")
}

/// SHA-256 over the files that a method brings for a trial; `None` where it brings none.
fn input_hash(method: &dyn Method, trial: &Trial, digests: &PictureDigests) -> Option<String> {
    let files = method.files(trial);
    let mut text = String::new();
    for file in &files {
        let digest = file.as_ref().and_then(|path| digests.of_file(path));
        text.push_str(&digest.map_or_else(|| "none".to_owned(), |digest| digest.to_string()));
    }
    (!files.is_empty()).then(|| Sha256Digest::of(text.as_bytes()).to_string())
}

/// A scene that the store has results of, as it is now.
#[derive(Default)]
struct Looked {
    warnings: Warnings,
    trials: u64,
    skipped: u64,
    /// Whether a method has yet to answer one of its trials: then the scene is gone through again, with its pictures.
    is_missing: bool,
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
        // Scenes that are there are looked at without decoding: whether they still ask the same of the same data.
        let ahead = Prefetch { decode: DecodeAhead::Nothing, ..self.plan.prefetch };
        let mut trials = self.trials(&known, ahead);
        let mut scenes: IndexMap<String, Looked> = IndexMap::new();
        let mut outdated = Outdated::of(self.plan, self.dataset, self.store);
        while let Some(outcome) = trials.next() {
            let scene = outcome.as_ref().map_or_else(|skipped| skipped.scene.as_str(), |(trial, _)| trial.scene());
            let looked = scenes.entry(scene.to_owned()).or_default();
            looked.warnings.merge(trials.take_warnings());
            match outcome {
                Ok((trial, targets)) => {
                    let data = trial.data_hash(&targets, self.store.digests()).to_string();
                    outdated.look_at(&trial, &data);
                    looked.trials += 1;
                    looked.is_missing |= !self.missing(&trial, &data).is_empty();
                }
                Err(skipped) => {
                    outdated.look_at_skipped(&skipped);
                    looked.skipped += 1;
                }
            }
        }
        self.store.digests().keep()?;
        outdated.refuse()?;
        findings.add_skipped(&self.dataset.name, trials.report());
        for looked in scenes.values().filter(|looked| !looked.is_missing) {
            findings.add_warnings(&self.dataset.name, &looked.warnings);
            let methods = self.methods.len() as u64;
            summary.resumed += looked.trials * methods;
            (0..(looked.trials + looked.skipped) * methods).for_each(|_| (self.step)());
        }
        let is_missing = |scene: &str| scenes.get(scene).is_some_and(|looked| looked.is_missing);
        rest.scenes.extend(known.scenes.into_iter().filter(|(scene, _)| is_missing(scene)));
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
        findings.add_warnings(&self.dataset.name, trials.warnings());
        findings.add_skipped(&self.dataset.name, trials.report());
        Ok(())
    }

    /// Scenes that the store has results of, by whichever method, and the others.
    fn parted(&self, index: &EvaluationIndex) -> (EvaluationIndex, EvaluationIndex) {
        let is_known = |scene: &str, entries: usize| {
            let name = &self.dataset.name;
            (0..entries).any(|entry| self.store.known().methods(name, scene, number(entry)).next().is_some())
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

    /// Methods that have not answered this very question about these data with these files, and what their files are.
    fn missing(&self, trial: &Trial, data_hash: &str) -> Vec<(&Arc<dyn Method>, Option<String>)> {
        let hash = trial.hash().to_string();
        let missing = |method: &'_ Arc<dyn Method>| {
            let key = key_of(self.dataset, method.as_ref(), trial.scene(), trial.entry_number());
            let input_hash = input_hash(method.as_ref(), trial, self.store.digests());
            let answered = self.store.known().answered(&key, &hash, data_hash, input_hash.as_deref());
            (!answered).then_some(input_hash)
        };
        self.methods.iter().filter_map(|method| Some((method, missing(method)?))).collect()
    }

    /// Trials that are worked on at once. Networks take too much memory for several.
    fn together(&self) -> usize {
        let one = self.methods.iter().any(|method| method.is_heavy());
        if one { 1 } else { 2 * rayon::current_num_threads() }
    }

    /// Evaluates a trial under each method that has not answered it; how many did, and how many had.
    fn evaluate(&self, trial: Trial, targets: &TargetPictures) -> Result<(u64, u64), EvalError> {
        let decoded = Decoded::new(trial, targets, self.store.digests());
        self.store.digests().keep()?;
        // The data may have changed since they were looked at.
        let mut outdated = Outdated::of(self.plan, self.dataset, self.store);
        outdated.look_at(&decoded.trial, &decoded.data_hash);
        outdated.refuse()?;
        let missing = self.missing(&decoded.trial, &decoded.data_hash);
        let evaluation = Evaluation { preset: &self.dataset.preset, suite: self.plan.suite, pictures: self.keeping };
        let before = (self.methods.len() - missing.len()) as u64;
        (0..before).for_each(|_| (self.step)());
        let evaluated = missing.len() as u64;
        for (method, input_hash) in missing {
            let trial = &decoded.trial;
            let key = key_of(self.dataset, method.as_ref(), trial.scene(), trial.entry_number());
            let (row, targets) = evaluation.rows(key, input_hash, &decoded, method.as_ref())?;
            self.store.append(&row, &targets)?;
            (self.step)();
        }
        Ok((evaluated, before))
    }
}
