use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use atsplat_files::FileError;
use rayon::prelude::*;

use crate::nerfstudio::AppliedTransform;
use crate::{Scene, SceneError, TimestampSource, WarningKind, Warnings};

/// A dataset whose scenes are loaded one at a time, by key.
///
/// Scenes may be loaded from many threads at once. A loaded scene has its cameras and the places of its images; images
/// are read when they are decoded.
pub trait SceneSource: Send + Sync {
    /// Scene keys in a reproducible order.
    fn keys(&self) -> &[String];

    /// Reads one scene's cameras and locates its images. The sources of this crate's formats also check what they read, however they
    /// were opened: suspicious cameras are warnings, each of them once.
    ///
    /// # Errors
    /// [`SceneError::UnknownScene`] for a key that is not in [`SceneSource::keys`], [`SceneError::NoPose`] from a format's source if
    /// no frame has a usable pose, other [`SceneError`]s if the scene's files are unusable. Problems that leave the scene usable go
    /// to `warnings`.
    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError>;

    /// The source whose scenes this one changes as it loads them, if it does: by default, the methods below then say what that one says.
    fn inner(&self) -> Option<&dyn SceneSource> {
        None
    }

    /// What [`crate::Frame::timestamp_micros`] is in this dataset.
    fn times(&self) -> TimestampSource {
        self.inner().map_or(TimestampSource::Given, SceneSource::times)
    }

    /// Files and folders that [`SceneSource::load`] reads for a scene, except the images of its frames; none if scenes
    /// are not read from files. Each of this crate's formats states its own.
    ///
    /// # Errors
    /// [`SceneError::UnknownScene`], [`SceneError::Io`].
    fn files(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
        self.inner().map_or_else(|| Ok(Vec::new()), |inner| inner.files(key))
    }

    /// Images whose size [`SceneSource::load`] reads, found by reading [`SceneSource::files`].
    ///
    /// # Errors
    /// As [`SceneSource::load`].
    fn images_for_sizes(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
        self.inner().map_or_else(|| Ok(Vec::new()), |inner| inner.images_for_sizes(key))
    }

    /// Fails if files of a scene could not be fetched: scenes that could not be loaded may be fine. To be asked before a result
    /// that takes what could be loaded for the dataset is written.
    ///
    /// # Errors
    /// Why fetching failed first.
    fn check_fetched(&self) -> Result<(), FileError> {
        self.inner().map_or(Ok(()), SceneSource::check_fetched)
    }

    /// How a scene's cameras were moved away from the world of structure from motion, if its files say so: COLMAP's
    /// points of the same capture have to be moved along.
    ///
    /// # Errors
    /// As [`SceneSource::load`]; [`SceneError::Camera`] for a transform that is not rigid.
    fn applied_transform(&self, key: &str) -> Result<Option<AppliedTransform>, SceneError> {
        self.inner().map_or(Ok(None), |inner| inner.applied_transform(key))
    }
}

/// A dataset of one scene that is already loaded.
#[derive(Clone, Debug)]
pub struct OneScene {
    keys: [String; 1],
    scene: Scene,
}

impl OneScene {
    /// The scene under its key.
    pub fn new(scene: Scene) -> Self {
        Self { keys: [scene.key.clone()], scene }
    }
}

impl SceneSource for OneScene {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn load(&self, key: &str, _warnings: &mut Warnings) -> Result<Scene, SceneError> {
        if key == self.scene.key {
            return Ok(self.scene.clone());
        }
        Err(SceneError::unknown_scene(key, Path::new(&format!("the loaded scene {}", self.scene.key))))
    }
}

/// Loads scenes in parallel and returns them in the order of `keys`.
///
/// A scene that cannot be read is skipped with a [`WarningKind::UnreadableScene`] that has the error's text. The result
/// does not depend on the number of threads. `progress` is called after each scene, from any thread, with the number of
/// scenes done. All scenes are in memory at once: pass [`SceneSource::keys`] in chunks if there are many.
pub fn load_scenes(
    source: &dyn SceneSource,
    keys: &[String],
    warnings: &mut Warnings,
    progress: &(dyn Fn(usize) + Sync),
) -> Vec<Scene> {
    let done = AtomicUsize::new(0);
    let load = |key: &String| {
        let mut of_scene = Warnings::new();
        let scene = source.load(key, &mut of_scene);
        progress(done.fetch_add(1, Ordering::Relaxed) + 1);
        (scene, of_scene)
    };
    let loaded: Vec<_> = keys.par_iter().map(load).collect();
    let mut scenes = Vec::with_capacity(loaded.len());
    for (key, (scene, of_scene)) in keys.iter().zip(loaded) {
        warnings.merge(of_scene);
        match scene {
            Ok(scene) => scenes.push(scene),
            Err(error) => warnings.push(WarningKind::UnreadableScene, key, error.to_string()),
        }
    }
    scenes
}

/// The item that belongs to `key`, where `items` are parallel to the sorted `keys` of the dataset at `path`.
pub(crate) fn find_by_key<'a, T>(keys: &[String], items: &'a [T], key: &str, path: &Path) -> Result<&'a T, SceneError> {
    let at = keys.binary_search_by(|found| found.as_str().cmp(key)).ok();
    at.and_then(|at| items.get(at)).ok_or_else(|| SceneError::unknown_scene(key, path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_scene_has_no_other_key() {
        let source = OneScene::new(Scene { key: "garden".to_owned(), url: None, frames: Vec::new() });
        let load = |key: &str| source.load(key, &mut Warnings::new());
        assert_eq!(load(&source.keys()[0]).unwrap().key, "garden");
        let error = load("kitchen").unwrap_err();
        assert!(matches!(error, SceneError::UnknownScene { .. }), "{error}");
        assert_eq!(error.to_string(), "no scene \"kitchen\" in the dataset (the loaded scene garden)");
    }
}
