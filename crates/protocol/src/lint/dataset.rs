use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use atsplat_scene::{SceneSource, Warnings};
use serde::Serialize;

use crate::loading::{in_parallel, load};
use crate::trial::{self, Refusal, SkipReason, TrialRecipe};
use crate::{EvaluationIndex, IndexEntry, Preset};

/// A dataset, and the recipe that turns the index's entries into trials.
#[derive(Clone)]
pub struct DatasetCheck<'a> {
    /// The scenes.
    pub source: &'a dyn SceneSource,
    /// Filters, preprocessing and pose normalisation.
    pub recipe: TrialRecipe,
}

impl<'a> DatasetCheck<'a> {
    /// Checks `source` under `preset`, for a method that the preset does not list.
    pub fn of(source: &'a dyn SceneSource, preset: &Preset) -> Self {
        Self { source, recipe: TrialRecipe::of(preset, "") }
    }
}

impl fmt::Debug for DatasetCheck<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DatasetCheck")
            .field("scenes", &self.source.keys().len())
            .field("recipe", &self.recipe)
            .finish_non_exhaustive()
    }
}

/// Which entries of an index give trials on a dataset.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct DatasetFacts {
    /// Scenes of the dataset that the index does not contain, or contains as `null`.
    pub unused_scenes: u64,
    /// Entries that give a trial: as many as [`crate::trial::Trials`] yields.
    pub usable: u64,
    /// Entries that do not, by reason.
    pub dropped: BTreeMap<SkipReason, u64>,
    /// The first few of each reason, in index order.
    pub examples: Vec<DropExample>,
}

/// An entry that gives no trial.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct DropExample {
    /// Scene key.
    pub scene: String,
    /// Position of the entry in the scene.
    pub entry: usize,
    /// Why it is dropped.
    pub reason: SkipReason,
    /// What was found.
    pub detail: String,
}

const EXAMPLES_PER_REASON: u64 = 3;

pub(super) fn check(index: &EvaluationIndex, dataset: &DatasetCheck<'_>, warnings: &mut Warnings) -> DatasetFacts {
    let scenes: Vec<_> = index.scenes.iter().filter(|(_, entries)| !entries.is_empty()).collect();
    let outcomes =
        in_parallel(&scenes, warnings, |(key, entries), warnings| check_scene(key, entries, dataset, warnings));
    let keys = dataset.source.keys();
    let unused_scenes = keys.iter().filter(|key| index.scenes.get(*key).is_none_or(Vec::is_empty)).count();
    let mut facts = DatasetFacts { unused_scenes: unused_scenes as u64, ..DatasetFacts::default() };
    for ((key, _), outcome) in scenes.into_iter().zip(outcomes) {
        for (entry, checked) in outcome.into_iter().enumerate() {
            let Err(Refusal { reason, detail }) = checked else {
                facts.usable += 1;
                continue;
            };
            let count = facts.dropped.entry(reason).or_default();
            *count += 1;
            if *count <= EXAMPLES_PER_REASON {
                facts.examples.push(DropExample { scene: key.clone(), entry, reason, detail });
            }
        }
    }
    facts
}

/// For each entry of a scene, whether it gives a trial.
fn check_scene(
    key: &str,
    entries: &[IndexEntry],
    dataset: &DatasetCheck<'_>,
    warnings: &mut Warnings,
) -> Vec<Result<(), Refusal>> {
    match load(dataset.source, key, warnings).map(Arc::new) {
        Ok(scene) => entries.iter().map(|entry| trial::check(&scene, entry, &dataset.recipe, warnings)).collect(),
        Err(dropped) => vec![Err(dropped.into()); entries.len()],
    }
}
