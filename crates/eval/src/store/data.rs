//! Which data the rows were computed from.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use crate::{EvalError, Results, TrialKey, TrialRow};

/// Preset, scene and entry: a trial without its method.
type TrialId = (String, String, u32);

/// The results of a store: for each trial, the inputs of each method's result.
#[derive(Debug, Default)]
pub(crate) struct KnownResults(HashMap<TrialId, BTreeMap<String, Inputs>>);

/// Hashes of what a result was computed from.
#[derive(Debug)]
struct Inputs {
    trial: String,
    data: Option<String>,
    input: Option<String>,
}

impl KnownResults {
    pub(super) fn of(trials: impl Iterator<Item = TrialRow>) -> Self {
        let mut known = Self::default();
        for TrialRow { key, trial_hash, data_hash, input_hash, .. } in trials {
            let by_method = known.0.entry(trial_id(&key.preset, &key.scene, key.entry)).or_default();
            by_method.insert(key.method, Inputs { trial: trial_hash, data: data_hash, input: input_hash });
        }
        known
    }

    fn get(&self, key: &TrialKey) -> Option<&Inputs> {
        self.0.get(&trial_id(&key.preset, &key.scene, key.entry))?.get(&key.method)
    }

    /// Whether there is a result for exactly this trial, data and input files.
    pub(crate) fn contains(&self, key: &TrialKey, trial: &str, data: &str, input: Option<&str>) -> bool {
        let same = |known: &Inputs| {
            known.trial == trial && known.data.as_deref() == Some(data) && known.input.as_deref() == input
        };
        self.get(key).is_some_and(same)
    }

    /// Drops the results of these methods.
    pub(super) fn forget(&mut self, methods: &BTreeSet<String>) {
        self.0.values_mut().for_each(|by_method| by_method.retain(|name, _| !methods.contains(name)));
    }

    /// The hash of the trial that a method's result belongs to.
    pub(crate) fn trial_hash(&self, key: &TrialKey) -> Option<&str> {
        self.get(key).map(|known| known.trial.as_str())
    }

    /// Methods with a result for a trial.
    pub(crate) fn methods(&self, preset: &str, scene: &str, entry: u32) -> impl Iterator<Item = &str> {
        self.0.get(&trial_id(preset, scene, entry)).into_iter().flatten().map(|(method, _)| method.as_str())
    }

    /// Methods whose result for a trial was computed from other data.
    pub(crate) fn outdated(&self, key: &TrialKey, data_hash: &str) -> impl Iterator<Item = &str> {
        let methods = self.0.get(&trial_id(&key.preset, &key.scene, key.entry)).into_iter().flatten();
        methods.filter(move |(_, known)| known.data.as_deref() != Some(data_hash)).map(|(name, _)| name.as_str())
    }
}

fn trial_id(preset: &str, scene: &str, entry: u32) -> TrialId {
    (preset.to_owned(), scene.to_owned(), entry)
}

/// Rejects rows of one trial that were computed from different data.
pub(super) fn check_consistent(results: &Results) -> Result<(), EvalError> {
    let mut data: HashMap<(&str, &str, u32), (&TrialKey, &str)> = HashMap::new();
    for TrialRow { key, data_hash, .. } in &results.trials {
        let Some(hash) = data_hash else { continue };
        let (first, known) = *data.entry((&key.preset, &key.scene, key.entry)).or_insert((key, hash));
        if known != hash {
            return Err(mixed("images or cameras", first, key));
        }
    }
    // Rows of older schema versions only record the ground-truth images.
    let mut truths: HashMap<(&str, &str, u32, u32), (&TrialKey, &str)> = HashMap::new();
    for row in &results.targets {
        let (key, Some(hash)) = (&row.key, &row.truth_hash) else { continue };
        let (first, known) = *truths.entry((&key.preset, &key.scene, key.entry, row.target)).or_insert((key, hash));
        if known != hash {
            return Err(mixed("ground-truth images", first, key));
        }
    }
    Ok(())
}

fn mixed(what: &'static str, first: &TrialKey, second: &TrialKey) -> EvalError {
    EvalError::MixedData { what, first: first.to_string(), second: second.to_string() }
}
