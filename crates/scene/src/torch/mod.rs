//! What `torch.save` wrote, without Python: the chunks of pixelSplat's datasets, and the value tree that
//! checkpoints are read from.
//!
//! A file is mapped, not read; its pickle is run by an allow-list of opcodes and names, so that it can
//! build lists, dicts and tensors and nothing else; tensors are ranges of the map. Any bytes give a value
//! or a [`TorchError`], in memory that the length of the pickle bounds.
//!
//! A mapped file must not be made shorter while it is in use: the operating system then ends the process
//! (`SIGBUS`). Replacing a file by renaming, as [`ChunkWriter`] does, is safe.

mod bytes;
mod chunk;
mod chunks;
mod container;
mod error;
mod globals;
mod graph;
mod legacy_container;
mod pickle;
mod pickle_writer;
mod record;
mod tensor;
mod value;
mod writer;
mod zip_container;

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

pub use chunk::Chunk;
pub use chunks::TorchChunks;
pub use error::TorchError;
pub use record::ChunkScene;
pub use tensor::{DType, Tensor};
pub use value::{Dict, Key, Value};
pub use writer::{ChunkWriter, ChunksWritten};

use crate::{SceneError, SharedBytes};
use container::Container;
use zip_container::ZipDirectory;

/// How many containers may hold each other. `torch.save` of anything sane stays below ten; the limit lets
/// a [`Value`] be dropped and walked by recursion.
pub const MAX_DEPTH: usize = 100;

/// Reads a file that `torch.save` wrote, in the zip format (PyTorch 1.6 and later) or the one before.
///
/// Tensors stay in the file until [`Tensor::to_bytes`] asks for them.
///
/// # Errors
/// [`SceneError::Io`] where the file cannot be mapped, [`SceneError::Torch`] where its bytes are not
/// tensors and plain containers.
pub fn read(path: impl AsRef<Path>) -> Result<Value, SceneError> {
    let path = path.as_ref();
    parse(map(path)?).map_err(SceneError::torch(path))
}

/// [`read`] for bytes that are already in memory.
///
/// # Errors
/// [`TorchError`] where the bytes are not tensors and plain containers.
pub fn parse(file: SharedBytes) -> Result<Value, TorchError> {
    if ZipDirectory::recognises(&file) {
        let directory = ZipDirectory::parse(file)?;
        let bytes = directory.pickle()?;
        let parsed = pickle::parse(&bytes, 0)?;
        return parsed.graph.into_value(parsed.root, &Arc::new(Container::Zip(directory)));
    }
    if legacy_container::recognises(&file) {
        return legacy_container::parse(&file);
    }
    let shown: Vec<String> = file.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
    let found = if shown.is_empty() { "an empty file".to_owned() } else { shown.join(" ") };
    Err(TorchError::malformed("byte 0", "a zip file or torch.save's magic number", found))
}

/// Runs a bare pickle, one that needs no storages.
///
/// # Errors
/// [`TorchError`] where the pickle is broken, asks for anything but plain containers, or holds tensors.
pub fn parse_pickle(bytes: &[u8]) -> Result<Value, TorchError> {
    legacy_container::plain(pickle::parse(bytes, 0)?)
}

fn map(path: &Path) -> Result<SharedBytes, SceneError> {
    let file = File::open(path).map_err(SceneError::io("opening a torch file", path))?;
    // SAFETY: the map is read-only and its bytes are only ever read as bytes. Another process that
    // truncates the file ends this one with SIGBUS, which the module documents.
    #[expect(unsafe_code, reason = "a chunk of 100 MB is mapped so that unused pictures are never read")]
    let map = unsafe { memmap2::Mmap::map(&file) };
    map.map(SharedBytes::new).map_err(SceneError::io("mapping a torch file", path))
}
