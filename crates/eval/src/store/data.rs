//! Which data rows were made from.

use std::collections::{BTreeMap, HashMap};

use crate::{EvalError, Results, TrialKey, TrialRow};

/// A trial, whichever method answered it.
type Asked = (String, String, u32);

/// The trials of a store, by what they were asked and made from.
#[derive(Debug, Default)]
pub(crate) struct Known(HashMap<Asked, BTreeMap<String, Made>>);

/// What a row says of where it came from.
#[derive(Debug)]
struct Made {
    trial: String,
    data: Option<String>,
    input: Option<String>,
}

impl Known {
    pub(super) fn of(trials: impl Iterator<Item = TrialRow>) -> Self {
        let mut known = Self::default();
        for TrialRow { key, trial_hash, data_hash, input_hash, .. } in trials {
            let by_method = known.0.entry(asked(&key.preset, &key.scene, key.entry)).or_default();
            by_method.insert(key.method, Made { trial: trial_hash, data: data_hash, input: input_hash });
        }
        known
    }

    /// Whether a method answered this very question about these very data, with these files.
    pub(crate) fn answered(&self, key: &TrialKey, trial: &str, data: &str, input: Option<&str>) -> bool {
        let made = self.0.get(&asked(&key.preset, &key.scene, key.entry)).and_then(|methods| methods.get(&key.method));
        made.is_some_and(|made| {
            made.trial == trial && made.data.as_deref() == Some(data) && made.input.as_deref() == input
        })
    }

    /// Drops what these methods answered.
    pub(super) fn forget(&mut self, methods: &[String]) {
        self.0.values_mut().for_each(|by_method| by_method.retain(|name, _| !methods.contains(name)));
    }

    /// The hash of the trial that a method answered.
    pub(crate) fn trial_hash(&self, key: &TrialKey) -> Option<&str> {
        let made = self.0.get(&asked(&key.preset, &key.scene, key.entry)).and_then(|methods| methods.get(&key.method));
        made.map(|made| made.trial.as_str())
    }

    /// Methods that answered a trial.
    pub(crate) fn methods(&self, preset: &str, scene: &str, entry: u32) -> impl Iterator<Item = &str> {
        self.0.get(&asked(preset, scene, entry)).into_iter().flatten().map(|(method, _)| method.as_str())
    }

    /// Methods that answered a trial when its data were others.
    pub(crate) fn outdated(&self, key: &TrialKey, data_hash: &str) -> impl Iterator<Item = &str> {
        let methods = self.0.get(&asked(&key.preset, &key.scene, key.entry)).into_iter().flatten();
        methods.filter(move |(_, made)| made.data.as_deref() != Some(data_hash)).map(|(name, _)| name.as_str())
    }
}

fn asked(preset: &str, scene: &str, entry: u32) -> Asked {
    (preset.to_owned(), scene.to_owned(), entry)
}

/// Refuses rows of one trial that were made from different data.
pub(super) fn of_one_dataset(results: &Results) -> Result<(), EvalError> {
    let mut data: HashMap<(&str, &str, u32), (&TrialKey, &str)> = HashMap::new();
    for TrialRow { key, data_hash, .. } in &results.trials {
        let Some(hash) = data_hash else { continue };
        let (first, known) = *data.entry((&key.preset, &key.scene, key.entry)).or_insert((key, hash));
        if known != hash {
            return Err(mixed("pictures or cameras", first, key));
        }
    }
    // Rows of older versions say which true pictures they were compared with, and no more.
    let mut truths: HashMap<(&str, &str, u32, u32), (&TrialKey, &str)> = HashMap::new();
    for row in &results.targets {
        let (key, Some(hash)) = (&row.key, &row.truth_hash) else { continue };
        let (first, known) = *truths.entry((&key.preset, &key.scene, key.entry, row.target)).or_insert((key, hash));
        if known != hash {
            return Err(mixed("true pictures", first, key));
        }
    }
    Ok(())
}

fn mixed(what: &'static str, first: &TrialKey, second: &TrialKey) -> EvalError {
    EvalError::MixedData { what, first: first.to_string(), second: second.to_string() }
}
