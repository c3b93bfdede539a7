use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::{Scene, SceneError, WarningKind, Warnings};

/// A dataset on disk whose scenes are loaded one at a time, by key.
///
/// Loading is independent per scene and safe from many threads; a scene costs its camera table until a
/// picture is decoded.
pub trait SceneSource: Send + Sync {
    /// Scene keys in a reproducible order.
    fn keys(&self) -> &[String];

    /// Reads one scene's cameras and finds its pictures.
    ///
    /// # Errors
    /// [`SceneError::UnknownScene`] for a key that is not in [`SceneSource::keys`], other [`SceneError`]s
    /// where the scene's files are unusable. What is wrong but bearable goes to `warnings`.
    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError>;
}

/// Loads scenes on all of rayon's threads, in the order of `keys`.
///
/// A scene that cannot be read is left out and counted as [`WarningKind::UnreadableScene`] with its
/// error's text; whether that is bearable is the caller's to decide. Scenes and warnings come out the same
/// for any number of threads. `progress` is called after each scene, from any thread, with how many are
/// done. Memory holds all scenes asked for: hand in [`SceneSource::keys`] in pieces where they are many.
pub fn load_scenes(
    source: &dyn SceneSource,
    keys: &[String],
    warnings: &mut Warnings,
    progress: &(dyn Fn(usize) + Sync),
) -> Vec<Scene> {
    let done = AtomicUsize::new(0);
    let load = |key: &String| {
        let mut own = Warnings::new();
        let scene = source.load(key, &mut own);
        progress(done.fetch_add(1, Ordering::Relaxed) + 1);
        (scene, own)
    };
    let loaded: Vec<_> = keys.par_iter().map(load).collect();
    let mut scenes = Vec::with_capacity(loaded.len());
    for (key, (scene, own)) in keys.iter().zip(loaded) {
        warnings.merge(own);
        match scene {
            Ok(scene) => scenes.push(scene),
            Err(error) => warnings.push(WarningKind::UnreadableScene, key, error.to_string()),
        }
    }
    scenes
}
