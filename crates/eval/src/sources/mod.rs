//! Scene sources other than plain files: simulated, already cropped, or without the frames whose pictures are missing.

mod cropped;
mod simulated;

use std::sync::Arc;

use atsplat_scene::{Scene, SceneError, SceneSource, Warnings};

pub use cropped::AlreadyCropped;
pub use simulated::simulated;

/// A dataset without frames whose pictures are missing, for sampling an index. Published indices count all frames of a scene,
/// so this must not be used with them.
#[derive(Clone)]
pub struct PresentFrames(Arc<dyn SceneSource>);

impl PresentFrames {
    /// Wraps a dataset.
    pub fn new(source: Arc<dyn SceneSource>) -> Self {
        Self(source)
    }
}

impl SceneSource for PresentFrames {
    fn keys(&self) -> &[String] {
        self.0.keys()
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let mut scene = self.0.load(key, warnings)?;
        scene.frames.retain(|frame| frame.picture.is_available());
        Ok(scene)
    }
}

impl std::fmt::Debug for PresentFrames {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "PresentFrames({} scenes)", self.keys().len())
    }
}
