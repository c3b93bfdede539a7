use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use atsplat_files::Sha256Digest;
use atsplat_protocol::trial::{DecodeAhead, ImageDigests, Prefetch, Skipped, TargetImages, Trial, TrialRecipe, Trials};
use atsplat_protocol::{EvaluationIndex, Preset};
use atsplat_results::store::images;
use atsplat_results::{ResultsError, RunWarning, Store, TargetRow, TrialId, TrialKey, TrialRow};
use indexmap::IndexMap;
use rayon::prelude::*;

use super::evaluate::{DecodedTrial, Evaluation};
use super::findings::SceneWarnings;
use super::images_and_times::ImagesAndTimes;
use super::kept_images::ImageSink;
use super::outdated::Outdated;
use super::plan::{Dataset, Plan};
use super::run::{Progress, Step};
use crate::EvalError;
use crate::method::Method;

/// Groups methods with the same pose normalisation and near/far planes, which share their trials.
pub(crate) fn groups(preset: &Preset, methods: &[Arc<dyn Method>]) -> Vec<Vec<Arc<dyn Method>>> {
    let mut groups: Vec<Vec<Arc<dyn Method>>> = Vec::new();
    for method in methods {
        let same_setting = |group: &&mut Vec<Arc<dyn Method>>| {
            group
                .first()
                .is_some_and(|first| preset.setting_for(first.setting()) == preset.setting_for(method.setting()))
        };
        match groups.iter_mut().find(same_setting) {
            Some(group) => group.push(Arc::clone(method)),
            None => groups.push(vec![Arc::clone(method)]),
        }
    }
    groups
}

/// The trials of a part of a dataset's index under the methods of a group, given the positions of all
/// ([`EvaluationIndex::first_positions`]).
pub(crate) fn trials_of(
    dataset: &Dataset,
    part: &EvaluationIndex,
    positions: &BTreeMap<&str, usize>,
    methods: &[Arc<dyn Method>],
    prefetch: Prefetch,
) -> Trials {
    let setting = methods.first().map_or(Preset::OWN_METHOD, |method| method.setting());
    let recipe = TrialRecipe::of(&dataset.preset, setting);
    Trials::new(Arc::clone(&dataset.source), part, recipe, prefetch).at_positions(positions).requiring_targets()
}

pub(crate) fn key_of(dataset: &Dataset, method: &dyn Method, scene: &str, entry: usize) -> TrialKey {
    trial_id(&dataset.name, scene, entry).of_method(&method.record().name)
}

pub(super) fn trial_id(preset: &str, scene: &str, entry: usize) -> TrialId {
    TrialId { preset: preset.to_owned(), scene: scene.to_owned(), entry: to_u32(entry) }
}

/// A number of entries or targets as stored in rows.
#[expect(clippy::expect_used, reason = "index files are far smaller than 2³² entries")]
pub(super) fn to_u32(count: usize) -> u32 {
    u32::try_from(count).expect("a scene has fewer than 2³² entries and targets")
}

/// SHA-256 over an imported method's files for a trial; `None` for methods without files.
pub(super) fn input_hash(method: &dyn Method, trial: &Trial, digests: &ImageDigests) -> Option<String> {
    let files = method.files(trial);
    let mut text = String::new();
    for file in &files {
        let digest = file.as_ref().and_then(|path| digests.of_file(path));
        text.push_str(&digest.map_or_else(|| "none".to_owned(), |digest| digest.to_string()));
    }
    (!files.is_empty()).then(|| Sha256Digest::of(text.as_bytes()).to_string())
}

/// What [`Trials`] yields: a trial, or why an entry has none.
type Prepared = Result<(Trial, TargetImages), Skipped>;

fn scene_of(prepared: &Prepared) -> &str {
    match prepared {
        Ok((trial, _)) => trial.scene(),
        Err(skipped) => &skipped.scene,
    }
}

/// A method under which a trial has to be evaluated.
struct Pending<'a> {
    method: &'a dyn Method,
    /// Of its result.
    key: TrialKey,
    /// Hash of its imported files.
    input_hash: Option<String>,
    /// Whether the store has a result of it for the same trial, data and files: an incomplete one.
    has_earlier_result: bool,
}

/// What became of a trial under the methods of a group.
#[derive(Default)]
struct TrialOutcome {
    evaluated: u64,
    /// Results that were there before, and stay.
    resumed: u64,
    /// Those of them that should have been replaced, with the reason why not.
    failed_again: Vec<(TrialKey, String)>,
}

/// Current state of a scene that the store already has results of.
#[derive(Default)]
struct SceneState {
    trials: u64,
    skipped: u64,
    /// Whether one of its trials has to be evaluated under some method: then the scene is read again with images.
    is_pending: bool,
}

/// Evaluates a group of methods on a dataset.
pub(super) struct GroupRun<'a> {
    pub(super) plan: &'a Plan<'a>,
    pub(super) dataset: &'a Dataset,
    pub(super) methods: Vec<Arc<dyn Method>>,
    pub(super) store: &'a Store,
    pub(super) images_and_times: &'a ImagesAndTimes<'a>,
    pub(super) images: ImageSink<'a>,
    pub(super) step: &'a (dyn Fn(Step<'_>) + Sync),
    pub(super) stop: &'a (dyn Fn() -> bool + Sync),
}

impl GroupRun<'_> {
    pub(super) fn run(&self, index: &EvaluationIndex, progress: &mut Progress) -> Result<(), EvalError> {
        let (known, mut rest) = self.split_known(index);
        let (preset, with_results, new) = (&self.dataset.name, known.scenes.len(), rest.scenes.len());
        tracing::info!(preset, with_results, new, "scenes to evaluate, of which some have results in the store");
        let scenes = self.check_existing(&known, progress)?;
        let is_pending = |scene: &str| scenes.get(scene).is_some_and(|state| state.is_pending);
        rest.scenes.extend(known.scenes.into_iter().filter(|(scene, _)| is_pending(scene)));
        self.evaluate_scenes(&rest, progress)
    }

    /// Checks scenes with results without decoding: whether their trials and data are unchanged. Those that are complete are done.
    fn check_existing(
        &self,
        known: &EvaluationIndex,
        progress: &mut Progress,
    ) -> Result<IndexMap<String, SceneState>, EvalError> {
        let names = self.method_names();
        let ahead = Prefetch { decode: DecodeAhead::Nothing, ..self.plan.prefetch };
        let mut trials = self.trials(known, ahead);
        let mut scenes: IndexMap<String, SceneState> = IndexMap::new();
        let mut reading = SceneWarnings::default();
        let mut outdated = Outdated::of(self.plan, self.dataset, self.store);
        while let Some(prepared) = trials.next() {
            self.check_stop()?;
            let scene = scene_of(&prepared);
            reading.add(scene, trials.take_warnings());
            let state = scenes.entry(scene.to_owned()).or_default();
            match prepared {
                Ok((trial, targets)) => {
                    let data = trial.data_hash(&targets, self.store.digests()).to_string();
                    outdated.check_trial(&trial, &data);
                    state.trials += 1;
                    state.is_pending |= !self.pending(&trial, &data)?.is_empty();
                }
                Err(skipped) => {
                    outdated.check_skipped(&skipped, &names);
                    state.skipped += 1;
                }
            }
        }
        self.store.digests().save()?;
        outdated.into_result()?;
        progress.warnings.join(reading);
        progress.findings.add_skipped(&self.dataset.name, &names, trials.report());
        for state in scenes.values().filter(|state| !state.is_pending) {
            let methods = self.methods.len() as u64;
            progress.summary.resumed += state.trials * methods;
            (0..(state.trials + state.skipped) * methods).for_each(|_| (self.step)(Step::Nothing));
        }
        Ok(scenes)
    }

    /// Evaluates scenes without results, or with some, batch by batch.
    fn evaluate_scenes(&self, scenes: &EvaluationIndex, progress: &mut Progress) -> Result<(), EvalError> {
        let mut trials = self.trials(scenes, self.plan.prefetch);
        let mut reading = SceneWarnings::default();
        loop {
            let mut batch = Vec::new();
            while batch.len() < self.batch_size() {
                let Some(prepared) = trials.next() else { break };
                reading.add(scene_of(&prepared), trials.take_warnings());
                batch.push(prepared);
            }
            if batch.is_empty() {
                break;
            }
            for TrialOutcome { evaluated, resumed, failed_again } in self.evaluate_batch(batch)? {
                progress.summary.evaluated += evaluated;
                progress.summary.resumed += resumed;
                for (TrialKey { preset, method, scene, .. }, why) in failed_again {
                    let kind = RunWarning::FailedAgain.about(&method);
                    progress.findings.add(&preset, &kind, 1, format!("{scene}: {why}"));
                }
            }
        }
        progress.warnings.join(reading);
        progress.findings.add_skipped(&self.dataset.name, &self.method_names(), trials.report());
        Ok(())
    }

    fn evaluate_batch(&self, batch: Vec<Prepared>) -> Result<Vec<TrialOutcome>, EvalError> {
        let mut trials = Vec::new();
        for prepared in batch {
            match prepared {
                Ok(trial) => trials.push(trial),
                Err(_skipped) => self.methods.iter().for_each(|_| (self.step)(Step::Nothing)),
            }
        }
        let evaluate = |(trial, targets): (Trial, TargetImages)| self.evaluate_trial(trial, &targets);
        match trials.len() {
            0 | 1 => trials.into_iter().map(evaluate).collect(),
            _ => trials.into_par_iter().map(evaluate).collect(),
        }
    }

    fn method_names(&self) -> BTreeSet<String> {
        self.methods.iter().map(|method| method.record().name).collect()
    }

    fn check_stop(&self) -> Result<(), EvalError> {
        if (self.stop)() { Err(EvalError::Stopped) } else { Ok(()) }
    }

    /// Splits the index into scenes that the store has results of, by any method, and the rest.
    fn split_known(&self, index: &EvaluationIndex) -> (EvaluationIndex, EvaluationIndex) {
        let is_known = |scene: &str, entries: usize| {
            let name = &self.dataset.name;
            (0..entries).any(|entry| self.store.known().methods(&trial_id(name, scene, entry)).next().is_some())
        };
        let (mut known, mut rest) = (EvaluationIndex::default(), EvaluationIndex::default());
        for (scene, entries) in &index.scenes {
            let part = if is_known(scene, entries.len()) { &mut known } else { &mut rest };
            part.scenes.insert(scene.clone(), entries.clone());
        }
        (known, rest)
    }

    fn trials(&self, index: &EvaluationIndex, prefetch: Prefetch) -> Trials {
        trials_of(self.dataset, index, &self.dataset.index.index.first_positions(), &self.methods, prefetch)
    }

    /// The methods under which a trial has to be evaluated: without a result for this trial, data and imported files, or with one that
    /// lacks a metric of the run, lacks images that are to be kept, or failed and is retried.
    fn pending(&self, trial: &Trial, data_hash: &str) -> Result<Vec<Pending<'_>>, ResultsError> {
        let (hash, known) = (trial.hash().to_string(), self.store.known());
        let mut pending = Vec::new();
        for method in &self.methods {
            let method = method.as_ref();
            let key = key_of(self.dataset, method, trial.scene(), trial.entry_number());
            let input_hash = input_hash(method, trial, self.store.digests());
            let has_earlier_result = known.contains(&key, &hash, data_hash, input_hash.as_deref());
            let is_complete = has_earlier_result && !known.lacks_metric(&key) && !known.is_retried(&key);
            if !is_complete || self.images_and_times.lacks_images(&key)? {
                pending.push(Pending { method, key, input_hash, has_earlier_result });
            }
        }
        Ok(pending)
    }

    /// Trials that are evaluated concurrently. Networks need too much memory for more than one.
    fn batch_size(&self) -> usize {
        let runs_alone = self.methods.iter().any(|method| method.runs_alone());
        if runs_alone { 1 } else { 2 * rayon::current_num_threads() }
    }

    /// Evaluates a trial under each method without a complete result.
    fn evaluate_trial(&self, trial: Trial, targets: &TargetImages) -> Result<TrialOutcome, EvalError> {
        let decoded = DecodedTrial::new(trial, targets, self.store.digests());
        self.store.digests().save()?;
        // The data may have changed since the first check.
        let mut outdated = Outdated::of(self.plan, self.dataset, self.store);
        if let (scorable, Some(why)) = decoded.scorable() {
            outdated.check_scorable(&decoded.trial, &decoded.data_hash, scorable, &why);
        }
        outdated.check_trial(&decoded.trial, &decoded.data_hash);
        outdated.into_result()?;
        self.images_and_times.remove_outdated_images(&self.dataset.name, &decoded.trial, &decoded.data_hash)?;
        let pending = self.pending(&decoded.trial, &decoded.data_hash)?;
        let resumed = (self.methods.len() - pending.len()) as u64;
        (0..resumed).for_each(|_| (self.step)(Step::Nothing));
        let mut outcome = TrialOutcome { resumed, ..TrialOutcome::default() };
        for method in pending {
            self.check_stop()?;
            self.evaluate_method(&decoded, method, &mut outcome)?;
        }
        Ok(outcome)
    }

    /// Evaluates a trial under a method, and stores the result unless an earlier one stays.
    fn evaluate_method(
        &self,
        decoded: &DecodedTrial,
        Pending { method, key, input_hash, has_earlier_result }: Pending<'_>,
        outcome: &mut TrialOutcome,
    ) -> Result<(), EvalError> {
        if !has_earlier_result {
            images::remove(self.images.store, &key)?;
        }
        let evaluation = Evaluation { preset: &self.dataset.preset, suite: self.plan.suite, images: self.images };
        let (row, targets) = evaluation.rows(key, input_hash, decoded, method)?;
        // A trial that was interrupted has not failed.
        self.check_stop()?;
        if has_earlier_result && self.has_fewer_scores(&row.key, &targets) {
            self.keep_earlier(&row.key, targets, outcome)?;
        } else {
            self.replace(&row, &targets)?;
            outcome.evaluated += 1;
        }
        (self.step)(if row.status.is_incomplete() { Step::Failed(&row) } else { Step::Done });
        Ok(())
    }

    /// Keeps the earlier result of a trial, which has more scores than these targets.
    #[expect(clippy::expect_used, reason = "every target without scores has a detail")]
    fn keep_earlier(
        &self,
        key: &TrialKey,
        targets: Vec<TargetRow>,
        outcome: &mut TrialOutcome,
    ) -> Result<(), EvalError> {
        images::discard(self.images.store, key)?;
        let why = targets.into_iter().find_map(|target| target.detail).expect("a target without scores says why");
        // One that failed before counts as incomplete by its row.
        if !self.store.known().is_retried(key) {
            outcome.failed_again.push((key.clone(), why));
        }
        outcome.resumed += 1;
        Ok(())
    }

    /// Whether rows have scores of fewer targets than the result of the same trial that they would replace.
    fn has_fewer_scores(&self, key: &TrialKey, targets: &[TargetRow]) -> bool {
        targets.iter().filter(|target| target.status.is_scored()).count() < self.store.known().scored(key)
    }

    /// Stores rows, with the images that were written for them.
    fn replace(&self, row: &TrialRow, targets: &[TargetRow]) -> Result<(), EvalError> {
        self.images_and_times.remove_outdated_times(row)?;
        images::remove_others(self.images.store, &row.key, targets)?;
        self.store.append(row, targets)?;
        images::publish(self.images.store, &row.key)?;
        Ok(())
    }
}
