use crate::{Scene, SceneError, Warnings};

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
