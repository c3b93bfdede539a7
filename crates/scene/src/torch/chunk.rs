use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use atsplat_pickle::shortened;

use super::{ChunkScene, Dict, TorchError, Value};
use crate::{Scene, SceneError, SharedBytes, WarningKind, Warnings};

/// One `.torch` chunk: a pickled list of scenes, each a dict of `url`, `timestamps`, `cameras`, `images`
/// and `key` (`real_estate_10k_tools` `src/convert.py:65-152`).
///
/// Opening reads the list, but no images. Each scene is checked when it is loaded, so an invalid one does not affect
/// the others.
#[derive(Debug)]
pub struct Chunk {
    path: PathBuf,
    keys: Vec<String>,
    scenes: HashMap<String, Value>,
}

impl Chunk {
    /// Maps a chunk and finds its scenes. Entries without a key are skipped with a warning, as are scenes with the key of an earlier
    /// one.
    ///
    /// # Errors
    /// [`SceneError::Io`] if the file cannot be mapped, [`SceneError::Torch`] if it is not a list written by
    /// `torch.save`.
    pub fn open(path: impl AsRef<Path>, warnings: &mut Warnings) -> Result<Self, SceneError> {
        let path = path.as_ref();
        Self::from_bytes(super::map(path)?, path, warnings)
    }

    /// [`Chunk::open`] for bytes in memory; `path` is for messages, also about images.
    ///
    /// # Errors
    /// [`SceneError::Torch`] if the bytes are not a list written by `torch.save`.
    pub fn from_bytes(bytes: SharedBytes, path: &Path, warnings: &mut Warnings) -> Result<Self, SceneError> {
        let root = super::parse(bytes.in_file(path)).map_err(SceneError::torch(path))?;
        let Value::List(items) = &root else {
            let error = TorchError::malformed("chunk", "a list of scenes", root.to_string());
            return Err(SceneError::torch(path)(error));
        };
        let mut chunk = Self { path: path.to_owned(), keys: Vec::new(), scenes: HashMap::new() };
        // References to one text are recognised by its address: hashing a long one for each would take time quadratic in the
        // file's size.
        let mut seen: HashMap<*const u8, *const Dict> = HashMap::new();
        for (position, item) in items.iter().enumerate() {
            let (kind, found) = match item.as_dict().and_then(|dict| Some((dict, dict.get("key")?))) {
                Some((dict, Value::Str(key))) => {
                    let address = Arc::as_ptr(key).cast::<u8>();
                    let listed = || chunk.scenes.get(&**key).and_then(Value::as_dict).map(std::ptr::from_ref);
                    let Some(first) = seen.get(&address).copied().or_else(listed) else {
                        seen.insert(address, std::ptr::from_ref(dict));
                        chunk.keys.push(key.to_string());
                        chunk.scenes.insert(key.to_string(), item.clone());
                        continue;
                    };
                    seen.insert(address, first);
                    // A reference to the first scene loses nothing, another scene with its key is lost.
                    let is_first = std::ptr::eq(first, dict);
                    let kind = if is_first { WarningKind::DuplicateScene } else { WarningKind::UnreadableScene };
                    (kind, format!("the key {:?} a second time", shortened(key)))
                }
                Some((_, other)) => (WarningKind::UnreadableScene, other.to_string()),
                None => (WarningKind::UnreadableScene, format!("{item} without a key")),
            };
            let detail = format!("scene {position} of the chunk: expected a unique key, found {found}");
            warnings.push(kind, path.display().to_string(), detail);
        }
        Ok(chunk)
    }

    /// Keys of the scenes, in the chunk's order.
    pub fn keys(&self) -> &[String] {
        &self.keys
    }

    /// One scene as stored.
    ///
    /// # Errors
    /// [`SceneError::UnknownScene`] for a key that is not in [`Chunk::keys`], [`SceneError::Torch`] if a field has the
    /// wrong type, shape or length.
    pub fn record(&self, key: &str) -> Result<ChunkScene, SceneError> {
        let unknown = || SceneError::unknown_scene(key, &self.path);
        let dict = self.scenes.get(key).and_then(Value::as_dict).ok_or_else(unknown)?;
        ChunkScene::from_dict(key, dict).map_err(SceneError::torch(&self.path))
    }

    /// One scene with its cameras; its encoded images stay in the mapped file.
    ///
    /// # Errors
    /// Those of [`Chunk::record`] and [`ChunkScene::to_scene`].
    pub fn load(&self, key: &str) -> Result<Scene, SceneError> {
        self.record(key)?.to_scene(&self.path)
    }
}
