use atsplat_scene::{SceneSource, Warnings};
use indexmap::IndexMap;

use crate::EvaluationIndex;
use crate::loading::{in_parallel, load};

/// How many frames each scene of `index` has in `source`, read in parallel; `null`s are not looked up. A scene that
/// cannot be loaded is a warning and stays out. `progress` is called once a scene, from any thread.
pub fn scene_lengths(
    index: &EvaluationIndex,
    source: &dyn SceneSource,
    progress: &(dyn Fn() + Sync),
    warnings: &mut Warnings,
) -> IndexMap<String, usize> {
    let asked = index.scenes.iter().filter(|(_, entries)| !entries.is_empty());
    let keys: Vec<&String> = asked.map(|(key, _)| key).collect();
    let lengths = in_parallel(&keys, warnings, |key, warnings| {
        let length = load(source, key, warnings).ok().map(|scene| scene.frames.len());
        progress();
        length
    });
    keys.into_iter().cloned().zip(lengths).filter_map(|(key, length)| Some((key, length?))).collect()
}
