use std::collections::HashMap;
use std::path::{Path, PathBuf};

use atsplat_pickle::shortened;

use super::{ChunkScene, TorchError, Value};
use crate::{Scene, SceneError, SharedBytes, WarningKind, Warnings};

/// One `.torch` chunk: a pickled list of scenes, each a dict of `url`, `timestamps`, `cameras`, `images`
/// and `key` (`real_estate_10k_tools` `src/convert.py:65-152`).
///
/// Opening reads the list and no picture. Scenes are checked one by one when they are asked for, so a
/// broken one does not keep its neighbours from being used.
#[derive(Debug)]
pub struct Chunk {
    path: PathBuf,
    keys: Vec<String>,
    scenes: HashMap<String, Value>,
}

impl Chunk {
    /// Maps a chunk and finds its scenes. Entries without a key, or with one that was there before, are
    /// left out with a warning.
    ///
    /// # Errors
    /// [`SceneError::Io`] where the file cannot be mapped, [`SceneError::Torch`] where it is not a list
    /// that `torch.save` wrote.
    pub fn open(path: impl AsRef<Path>, warnings: &mut Warnings) -> Result<Self, SceneError> {
        let path = path.as_ref();
        Self::from_bytes(super::map(path)?, path, warnings)
    }

    /// [`Chunk::open`] for bytes that are already in memory; `path` only names them.
    ///
    /// # Errors
    /// [`SceneError::Torch`] where the bytes are not a list that `torch.save` wrote.
    pub fn from_bytes(bytes: SharedBytes, path: &Path, warnings: &mut Warnings) -> Result<Self, SceneError> {
        let root = super::parse(bytes).map_err(SceneError::torch(path))?;
        let Value::List(items) = &root else {
            let error = TorchError::malformed("chunk", "a list of scenes", root.to_string());
            return Err(SceneError::torch(path)(error));
        };
        let mut chunk = Self { path: path.to_owned(), keys: Vec::new(), scenes: HashMap::new() };
        for (position, item) in items.iter().enumerate() {
            let refused = match item.as_dict().and_then(|dict| dict.get("key")) {
                Some(Value::Str(key)) if !chunk.scenes.contains_key(&**key) => {
                    chunk.keys.push(key.to_string());
                    chunk.scenes.insert(key.to_string(), item.clone());
                    continue;
                }
                Some(Value::Str(key)) => format!("the key {:?} a second time", shortened(key)),
                Some(other) => other.to_string(),
                None => format!("{item} without one"),
            };
            let detail = format!("scene {position} of the chunk: expected a key of its own, found {refused}");
            warnings.push(WarningKind::UnreadableScene, path.display().to_string(), detail);
        }
        Ok(chunk)
    }

    /// Keys of the scenes, in the chunk's order.
    pub fn keys(&self) -> &[String] {
        &self.keys
    }

    /// One scene as it is stored.
    ///
    /// # Errors
    /// [`SceneError::UnknownScene`] for a key that is not in [`Chunk::keys`], [`SceneError::Torch`] where a
    /// field has the wrong type, shape or length.
    pub fn record(&self, key: &str) -> Result<ChunkScene, SceneError> {
        let unknown = || SceneError::UnknownScene { key: key.to_owned(), path: self.path.clone() };
        let dict = self.scenes.get(key).and_then(Value::as_dict).ok_or_else(unknown)?;
        ChunkScene::from_dict(key, dict).map_err(SceneError::torch(&self.path))
    }

    /// One scene with its cameras; its pictures stay in the map, undecoded.
    ///
    /// # Errors
    /// As [`Chunk::record`], and [`SceneError::Camera`] where a row is no camera.
    pub fn load(&self, key: &str) -> Result<Scene, SceneError> {
        self.record(key)?.to_scene(&self.path)
    }
}
