use std::collections::BTreeMap;
use std::fmt;

use atsplat_camera::ImageSize;
use atsplat_scene::{Frame, SceneError, SceneSource, WarningKind, Warnings};
use rayon::prelude::*;
use serde::Serialize;

use crate::{DropReason, Dropped, EvaluationIndex, Filters, IndexEntry, Preset};

/// A dataset, and what a protocol asks of it.
#[derive(Clone, Copy)]
pub struct DatasetCheck<'a> {
    /// The scenes.
    pub source: &'a dyn SceneSource,
    /// Which scenes the published loaders leave out.
    pub filters: &'a Filters,
    /// The only picture size that the protocol takes.
    pub expected_size: Option<ImageSize>,
    /// Tells a frame's picture size; `None` where it cannot be told.
    pub picture_size: &'a (dyn Fn(&Frame) -> Option<ImageSize> + Sync),
}

impl<'a> DatasetCheck<'a> {
    /// What `preset` asks of `source`, with the picture sizes that the scenes' metadata state.
    pub fn of(source: &'a dyn SceneSource, preset: &'a Preset) -> Self {
        Self {
            source,
            filters: &preset.filters,
            expected_size: preset.preprocessing.expected_size,
            picture_size: &|frame| frame.stated_size,
        }
    }
}

impl fmt::Debug for DatasetCheck<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DatasetCheck")
            .field("scenes", &self.source.keys().len())
            .field("filters", self.filters)
            .field("expected_size", &self.expected_size)
            .finish_non_exhaustive()
    }
}

/// What a dataset makes of an index.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct DatasetFacts {
    /// Scenes of the dataset that the index does not name, or names with `null`.
    pub not_asked_for: u64,
    /// Entries that make a trial.
    pub usable: u64,
    /// Entries that do not, by reason.
    pub dropped: BTreeMap<DropReason, u64>,
    /// The first few of each reason, in index order.
    pub examples: Vec<DropExample>,
}

/// One entry that makes no trial.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct DropExample {
    /// Scene key.
    pub scene: String,
    /// Position of the entry in the scene.
    pub entry: usize,
    /// Why it is dropped.
    pub reason: DropReason,
    /// What was found.
    pub detail: String,
}

const EXAMPLES_PER_REASON: u64 = 3;

pub(super) fn check(index: &EvaluationIndex, dataset: &DatasetCheck<'_>, warnings: &mut Warnings) -> DatasetFacts {
    let asked: Vec<_> = index.scenes.iter().filter(|(_, entries)| !entries.is_empty()).collect();
    let outcomes: Vec<_> = asked
        .par_iter()
        .map(|(key, entries)| {
            let mut own = Warnings::new();
            (scene(key, entries, dataset, &mut own), own)
        })
        .collect();
    let keys = dataset.source.keys();
    let not_asked_for = keys.iter().filter(|key| index.scenes.get(*key).is_none_or(Vec::is_empty)).count();
    let mut facts = DatasetFacts { not_asked_for: not_asked_for as u64, ..DatasetFacts::default() };
    for ((key, _), (outcome, own)) in asked.into_iter().zip(outcomes) {
        warnings.merge(own);
        for (entry, dropped) in outcome.into_iter().enumerate() {
            let Some(Dropped { reason, detail }) = dropped else {
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

/// For each entry of one scene, why it is dropped.
fn scene(
    key: &str,
    entries: &[IndexEntry],
    dataset: &DatasetCheck<'_>,
    warnings: &mut Warnings,
) -> Vec<Option<Dropped>> {
    let (reason, error) = match dataset.source.load(key, warnings) {
        Ok(scene) => {
            let judge = |entry| {
                dataset
                    .filters
                    .drop_reason(&scene, entry, dataset.expected_size, &|frame| (dataset.picture_size)(frame))
            };
            return entries.iter().map(judge).collect();
        }
        Err(error @ SceneError::UnknownScene { .. }) => {
            warnings.push(WarningKind::SceneNotFound, key, error.to_string());
            (DropReason::SceneMissing, error)
        }
        Err(error) => {
            warnings.push(WarningKind::UnreadableScene, key, error.to_string());
            (DropReason::Unreadable, error)
        }
    };
    entries.iter().map(|_| Some(Dropped { reason, detail: error.to_string() })).collect()
}
