use std::collections::BTreeSet;

use atsplat_scene::{Frame, Scene, SceneSource, Warnings};
use indexmap::IndexMap;

use crate::EvaluationIndex;
use crate::loading::{in_parallel, load};

/// The frames of a scene among which a split chooses.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SceneFrames {
    /// Number of frames.
    pub length: usize,
    /// Numbers of those without an image file or a usable pose, which give no trial.
    pub missing: BTreeSet<usize>,
}

impl From<usize> for SceneFrames {
    /// So many frames, all of them usable.
    fn from(length: usize) -> Self {
        Self { length, missing: BTreeSet::new() }
    }
}

impl SceneFrames {
    /// The frames of a scene. In a source without images, all are usable.
    pub fn of(scene: &Scene) -> Self {
        let frames = scene.frames.iter().enumerate();
        let is_missing = |frame: &Frame| frame.image.is_missing() || !frame.has_pose();
        let missing = frames.filter(|(_, frame)| is_missing(frame)).map(|(number, _)| number).collect();
        Self { length: scene.frames.len(), missing }
    }
}

/// The frames of each scene of `index` in `source`, read in parallel; `null` scenes are skipped. A scene that cannot be loaded is
/// omitted with a warning. `progress` is called once per scene, from any thread.
pub fn scene_frames(
    index: &EvaluationIndex,
    source: &dyn SceneSource,
    progress: &(dyn Fn() + Sync),
    warnings: &mut Warnings,
) -> IndexMap<String, SceneFrames> {
    let with_entries = index.scenes.iter().filter(|(_, entries)| !entries.is_empty());
    let keys: Vec<&String> = with_entries.map(|(key, _)| key).collect();
    let frames = in_parallel(&keys, warnings, |key, warnings| {
        let frames = load(source, key, warnings).ok().map(|scene| SceneFrames::of(&scene));
        progress();
        frames
    });
    keys.into_iter().cloned().zip(frames).filter_map(|(key, frames)| Some((key, frames?))).collect()
}

/// The number of frames of each scene, as in [`scene_frames`]. A protocol's split of a published index depends on nothing else, so that
/// it is the same whichever images are there.
pub fn scene_lengths(
    index: &EvaluationIndex,
    source: &dyn SceneSource,
    progress: &(dyn Fn() + Sync),
    warnings: &mut Warnings,
) -> IndexMap<String, usize> {
    let frames = scene_frames(index, source, progress, warnings);
    frames.into_iter().map(|(key, frames)| (key, frames.length)).collect()
}
