use std::collections::{BTreeMap, HashSet};
use std::fmt;
use std::sync::Arc;

use atsplat_scene::{Scene, SceneSource, Warnings};
use serde::Serialize;

use crate::loading::{in_parallel, load};
use crate::trial::{self, Rejection, SkipReason, TrialRecipe};
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
    /// Targets that show the image file of a context frame of their entry, as another frame.
    pub leaked_images: u64,
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
        for (entry, (checked, leaked_images)) in outcome.into_iter().enumerate() {
            facts.leaked_images += leaked_images;
            let Err(Rejection { reason, detail, .. }) = checked else {
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

/// For each entry of a scene, whether it gives a trial, and [`leaked_images`].
fn check_scene(
    key: &str,
    entries: &[IndexEntry],
    dataset: &DatasetCheck<'_>,
    warnings: &mut Warnings,
) -> Vec<(Result<(), Rejection>, u64)> {
    match load(dataset.source, key, warnings).map(Arc::new) {
        Ok(scene) => {
            let mut check = |entry| trial::check(&scene, entry, &dataset.recipe, warnings);
            entries.iter().map(|entry| (check(entry), leaked_images(&scene, entry))).collect()
        }
        Err(dropped) => vec![(Err(dropped.into()), 0); entries.len()],
    }
}

/// Number of targets that are not context frames but show the image file of one.
fn leaked_images(scene: &Scene, entry: &IndexEntry) -> u64 {
    let file = |frame: &usize| scene.frames.get(*frame)?.image.file();
    let seen: HashSet<_> = entry.context.iter().filter_map(file).collect();
    let others = entry.target.iter().filter(|frame| !entry.is_context(**frame));
    others.filter_map(file).filter(|path| seen.contains(path)).count() as u64
}

#[cfg(test)]
mod tests {
    use atsplat_scene::FrameImage;

    use super::*;
    use crate::test_source::scene;

    #[test]
    fn counts_targets_that_show_a_context_image_under_another_number() {
        let mut scene = scene("s", 9, 0);
        for (number, frame) in scene.frames.iter_mut().enumerate() {
            frame.image = FrameImage::File(format!("{number}.png").into());
        }
        // Frames 3 and 4 repeat context frames, 5 repeats a target.
        for (number, repeated) in [(3, 6), (4, 2), (5, 7)] {
            scene.frames[number].image = scene.frames[repeated].image.clone();
        }
        let entry = |target: &[usize]| IndexEntry { context: vec![2, 6], target: target.to_vec(), overlap: None };
        let found =
            [vec![3, 4, 7], vec![5, 7, 8], vec![2, 6], vec![2, 3]].map(|target| leaked_images(&scene, &entry(&target)));
        assert_eq!(found, [2, 0, 0, 1]);
    }
}
