use std::collections::BTreeMap;
use std::sync::Arc;

use atsplat_metrics::Suite;
use atsplat_protocol::trial::{DecodeAhead, Prefetch, TargetPictures, Trial, TrialRecipe, Trials};
use atsplat_protocol::{EvaluationIndex, Preset};
use atsplat_scene::SceneSource;
use rayon::prelude::*;
use serde::Serialize;

use super::evaluate::{Decoded, Evaluation};
use super::selection::Selected;
use super::{Findings, KeepPictures, PlannedIndex, Selection, metric_records};
use crate::method::{Method, Repetitions};
use crate::{EvalError, PresetRecord, Provenance, Results, Store, TargetStatus, TimingRecord, TrialKey, TrialStatus};

/// Trials that are kept with pictures where only the worst are.
const WORST: usize = 10;

/// A protocol on a dataset.
pub struct Dataset {
    /// Name in the rows.
    pub name: String,
    /// The protocol.
    pub preset: Preset,
    /// The scenes.
    pub source: Arc<dyn SceneSource>,
    /// Where they are, in the user's words.
    pub told: String,
    /// What is asked.
    pub index: PlannedIndex,
}

/// Everything that a run is about.
#[derive(Clone, Copy)]
pub struct Plan<'a> {
    /// Protocols.
    pub datasets: &'a [Dataset],
    /// Methods.
    pub methods: &'a [Arc<dyn Method>],
    /// Metrics.
    pub suite: &'a Suite,
    /// Which scenes.
    pub selection: Selection,
    /// How often work is repeated to time it.
    pub repetitions: Repetitions,
    /// Whether a trial is the only work while it is timed.
    pub alone: bool,
    /// Which pictures are kept.
    pub pictures: KeepPictures,
    /// How far ahead trials are prepared; `alone` prepares none.
    pub prefetch: Prefetch,
}

/// What became of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Summary {
    /// Trials that were evaluated now.
    pub evaluated: u64,
    /// Trials that were there.
    pub resumed: u64,
    /// Trials, new and old, that are not whole: failed ones and those with failed targets.
    pub incomplete: u64,
    /// Targets, new and old, with samples that are no numbers.
    pub non_finite: u64,
    /// Index entries without a trial.
    pub skipped: u64,
    /// Scenes that indices name and datasets lack.
    pub not_there: u64,
}

impl Summary {
    /// Whether every question of every index was answered whole.
    pub const fn is_complete(&self) -> bool {
        self.incomplete == 0 && self.non_finite == 0 && self.skipped == 0 && self.not_there == 0
    }
}

impl std::fmt::Debug for Dataset {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Dataset").field("name", &self.name).field("told", &self.told).finish_non_exhaustive()
    }
}

impl Plan<'_> {
    /// How many results the run will have, those that are there already and index entries without a trial among them.
    pub fn results(&self) -> u64 {
        let of = |dataset: &Dataset| self.selected(dataset).index.entries().count() as u64;
        self.datasets.iter().map(of).sum::<u64>() * self.methods.len() as u64
    }

    /// What a store says of this run; `here` is what it says of the machine.
    ///
    /// # Errors
    /// [`EvalError::Protocol`] for a preset that cannot be written, [`EvalError::Settings`] for methods or presets of one
    /// name and a shard that is none.
    pub fn provenance(&self, here: Provenance) -> Result<Provenance, EvalError> {
        let methods: Vec<_> = self.methods.iter().map(|method| method.record()).collect();
        unique("methods", methods.iter().map(|method| method.name.as_str()))?;
        unique("presets", self.datasets.iter().map(|dataset| dataset.name.as_str()))?;
        if let Some(shard) = self.selection.shard.filter(|shard| shard.number == 0 || shard.number > shard.of) {
            let found = format!("{} of {}", shard.number, shard.of);
            return Err(EvalError::Settings {
                what: "shard",
                expected: "a number from 1 to how many".to_owned(),
                found,
            });
        }
        let preset = |dataset: &Dataset| {
            let Dataset { name, preset, told, index, .. } = dataset;
            Ok(PresetRecord {
                name: name.clone(),
                preset: preset.name.clone(),
                title: preset.title.clone(),
                hash: preset.hash()?.to_string(),
                toml: preset.to_toml()?,
                dataset: told.clone(),
                index: index.told.clone(),
                index_sha256: index.sha256.to_string(),
                index_name: index.name.clone(),
                entries: self.selected(dataset).index.entries().count() as u64,
                entries_of_index: index.index.entries().count() as u64,
            })
        };
        let Repetitions { warm_up, counted } = self.repetitions;
        Ok(Provenance {
            timing: TimingRecord { alone: self.alone, warm_up, repetitions: counted.max(1) },
            shard: self.selection.shard,
            limit: self.selection.limit,
            presets: self.datasets.iter().map(preset).collect::<Result<_, EvalError>>()?,
            methods,
            metrics: metric_records(self.suite),
            ..here
        })
    }

    fn selected(&self, dataset: &Dataset) -> Selected {
        self.selection.of(&dataset.index.index, dataset.source.keys())
    }
}

fn unique<'a>(what: &'static str, names: impl Iterator<Item = &'a str>) -> Result<(), EvalError> {
    let mut seen = std::collections::BTreeSet::new();
    for name in names {
        if !seen.insert(name) {
            let found = format!("{name} twice: name one of them otherwise");
            return Err(EvalError::Settings { what, expected: "every name once".to_owned(), found });
        }
    }
    Ok(())
}

/// Runs a plan into a store, which was made or resumed with [`Plan::provenance`], and finishes it. Trials that are there
/// and asked the same question are not asked again. `step` is called after each result, from any thread.
///
/// # Errors
/// [`EvalError::Io`] where the store cannot be written; what was evaluated before is kept.
pub fn run(plan: &Plan<'_>, mut store: Store, step: &(dyn Fn() + Sync)) -> Result<(Results, Summary), EvalError> {
    let mut findings = Findings::default();
    let mut summary = Summary::default();
    for dataset in plan.datasets {
        let Selected { index, not_there } = plan.selected(dataset);
        summary.not_there += not_there.len() as u64;
        if let Some(first) = not_there.first() {
            findings.add(
                &dataset.name,
                "scenes of the index that are not in the data",
                not_there.len() as u64,
                first.clone(),
            );
        }
        for methods in groups(&dataset.preset, plan.methods) {
            let walk = Walk { plan, dataset, methods, store: &store, step };
            walk.run(&index, &mut findings, &mut summary)?;
        }
    }
    let is_run = |preset: &str| plan.datasets.iter().any(|dataset| dataset.name == preset);
    summary.skipped = findings.skipped.len() as u64;
    let before = store.provenance();
    findings.warnings.extend(before.warnings.iter().filter(|found| !is_run(&found.preset)).cloned());
    findings.skipped.extend(before.skipped.iter().filter(|found| !is_run(&found.preset)).cloned());
    let findings = findings.in_order();
    store.set_findings(findings);
    let folder = store.folder().to_owned();
    let results = store.finish()?;
    let incomplete = |status| matches!(status, TrialStatus::Failed | TrialStatus::Partial | TrialStatus::NotApplicable);
    summary.incomplete = results.trials.iter().filter(|trial| incomplete(trial.status)).count() as u64;
    let non_finite = |status| status == TargetStatus::NonFinite;
    summary.non_finite = results.targets.iter().filter(|target| non_finite(target.status)).count() as u64;
    if plan.pictures == KeepPictures::Worst {
        for dataset in plan.datasets {
            for methods in groups(&dataset.preset, plan.methods) {
                keep_worst(plan, dataset, &methods, &results, &folder)?;
            }
        }
    }
    Ok((results, summary))
}

/// Methods that take the same pose normalisation and planes, and so the same trials.
fn groups(preset: &Preset, methods: &[Arc<dyn Method>]) -> Vec<Vec<Arc<dyn Method>>> {
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

fn recipe(dataset: &Dataset, methods: &[Arc<dyn Method>]) -> TrialRecipe {
    TrialRecipe::of(&dataset.preset, methods.first().map_or("ATSplat", |method| method.setting()))
}

fn key_of(dataset: &Dataset, method: &dyn Method, scene: &str, entry: usize) -> TrialKey {
    TrialKey {
        preset: dataset.name.clone(),
        method: method.record().name,
        scene: scene.to_owned(),
        entry: u32::try_from(entry).unwrap_or(u32::MAX),
    }
}

/// One walk over a dataset.
struct Walk<'a> {
    plan: &'a Plan<'a>,
    dataset: &'a Dataset,
    methods: Vec<Arc<dyn Method>>,
    store: &'a Store,
    step: &'a (dyn Fn() + Sync),
}

impl Walk<'_> {
    fn run(&self, index: &EvaluationIndex, findings: &mut Findings, summary: &mut Summary) -> Result<(), EvalError> {
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
        let ahead = if self.plan.alone { Prefetch { trials: 0, ..self.plan.prefetch } } else { self.plan.prefetch };
        let mut trials = self.trials(&rest, ahead);
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
        let one = self.plan.alone || self.methods.iter().any(|method| method.is_heavy());
        if one { 1 } else { 2 * rayon::current_num_threads() }
    }

    /// Evaluates a trial under each method that has not answered it; how many did, and how many had.
    fn evaluate(&self, trial: Trial, targets: &TargetPictures) -> Result<(u64, u64), EvalError> {
        let decoded = Decoded::new(trial, targets);
        let missing = self.missing(&decoded.trial);
        let keep = (self.plan.pictures == KeepPictures::All).then(|| self.store.folder());
        let evaluation = Evaluation {
            preset: &self.dataset.preset,
            suite: self.plan.suite,
            repetitions: self.plan.repetitions,
            alone: self.plan.alone,
            pictures: keep,
        };
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

/// Makes the pictures of each method's worst trials once more, and keeps them.
fn keep_worst(
    plan: &Plan<'_>,
    dataset: &Dataset,
    methods: &[Arc<dyn Method>],
    results: &Results,
    folder: &std::path::Path,
) -> Result<(), EvalError> {
    for method in methods {
        let name = method.record().name;
        let worst = worst(results, &dataset.name, &name);
        let of = |scene: &&String| Some(((*scene).clone(), dataset.index.index.scenes.get(*scene)?.clone()));
        let scenes: std::collections::BTreeSet<&String> = worst.iter().map(|key| &key.scene).collect();
        let index = EvaluationIndex { scenes: scenes.iter().filter_map(of).collect() };
        let recipe = recipe(dataset, methods);
        for (trial, targets) in Trials::new(Arc::clone(&dataset.source), &index, recipe, plan.prefetch).flatten() {
            let key = key_of(dataset, method.as_ref(), trial.scene(), trial.entry_number());
            if worst.contains(&key) {
                let evaluation = Evaluation {
                    preset: &dataset.preset,
                    suite: plan.suite,
                    repetitions: Repetitions::ONCE,
                    alone: false,
                    pictures: Some(folder),
                };
                evaluation.rows(key, &Decoded::new(trial, &targets), method.as_ref())?;
            }
        }
    }
    Ok(())
}

/// Keys of the trials with the lowest mean PSNR, whichever the protocol means, the worst first.
fn worst(results: &Results, preset: &str, method: &str) -> Vec<TrialKey> {
    let mut sums: BTreeMap<&TrialKey, (f64, u64)> = BTreeMap::new();
    for row in results.targets.iter().filter(|row| row.key.preset == preset && row.key.method == method) {
        if let Some((_, score)) = row.scores.iter().find(|(id, _)| id.starts_with("psnr")) {
            let (sum, count) = sums.entry(&row.key).or_default();
            *sum += score;
            *count += 1;
        }
    }
    let mut means: Vec<(f64, &TrialKey)> = sums.into_iter().map(|(key, (sum, n))| (sum / n as f64, key)).collect();
    means.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    means.into_iter().take(WORST).map(|(_, key)| key.clone()).collect()
}

impl std::fmt::Debug for Plan<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { datasets, methods, selection, repetitions, alone, pictures, prefetch, suite: _ } = self;
        f.debug_struct("Plan")
            .field("datasets", datasets)
            .field("methods", methods)
            .field("selection", selection)
            .field("repetitions", repetitions)
            .field("alone", alone)
            .field("pictures", pictures)
            .field("prefetch", prefetch)
            .finish_non_exhaustive()
    }
}
