use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use atsplat_protocol::EvaluationIndex;
use atsplat_scene::{Picture, Scene, SceneError, SceneSource, Warnings};

/// A dataset without the frames whose pictures are listed and not there.
pub(super) struct Present<'a> {
    source: &'a dyn SceneSource,
    /// Of scenes with such frames: where the others are listed.
    listed: Mutex<BTreeMap<String, Vec<usize>>>,
}

impl<'a> Present<'a> {
    pub(super) const fn new(source: &'a dyn SceneSource) -> Self {
        Self { source, listed: Mutex::new(BTreeMap::new()) }
    }

    /// An index of this dataset, with frames counted as the whole one lists them.
    pub(super) fn as_listed(&self, mut index: EvaluationIndex) -> EvaluationIndex {
        let listed = self.listed.lock().unwrap_or_else(PoisonError::into_inner);
        for (key, entries) in &mut index.scenes {
            let Some(positions) = listed.get(key) else { continue };
            for frame in entries.iter_mut().flat_map(|entry| entry.context.iter_mut().chain(&mut entry.target)) {
                *frame = positions.get(*frame).copied().unwrap_or(*frame);
            }
        }
        index
    }
}

impl SceneSource for Present<'_> {
    fn keys(&self) -> &[String] {
        self.source.keys()
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let Scene { key, url, frames } = self.source.load(key, warnings)?;
        let all = frames.len();
        let there = frames.into_iter().enumerate().filter(|(_, frame)| !matches!(frame.picture, Picture::Missing(_)));
        let (positions, frames): (Vec<usize>, Vec<_>) = there.unzip();
        if positions.len() < all {
            self.listed.lock().unwrap_or_else(PoisonError::into_inner).insert(key.clone(), positions);
        }
        Ok(Scene { key, url, frames })
    }
}
