//! Reads `torch.save` files with [`atsplat_pickle`], and reads and writes the chunks of pixelSplat's datasets.
//!
//! A mapped file must not be truncated while it is in use: the operating system would terminate the process (`SIGBUS`).
//! Replacing a file by renaming, as [`ChunkWriter`] does, is safe.

mod chunk;
mod chunks;
mod open;
mod pickle_writer;
mod record;
mod rounding;
mod writer;

use std::path::Path;

pub use atsplat_pickle::{DType, Dict, Key, MAX_DEPTH, Tensor, TorchError, Value, parse, parse_pickle};
pub use chunk::Chunk;
pub use chunks::TorchChunks;
pub use record::ChunkScene;
pub use writer::{ChunkWriter, ChunksWritten, ExportedChunks, export_chunks};

pub(crate) use open::READER;

use crate::files::has_extension;
use crate::{SceneError, SharedBytes};

/// The folders of a dataset's splits in pixelSplat's layout, in the order in which chunks are looked for.
pub const STAGES: [&str; 2] = ["test", "train"];

/// The name of a folder's index from scene keys to chunks.
const INDEX: &str = "index.json";

/// Whether a file is named like a chunk.
fn is_named_chunk(path: &Path) -> bool {
    has_extension(path, "torch")
}

/// Reads a `torch.save` file, in the zip format (PyTorch 1.6 and later) or the legacy one.
///
/// Tensors stay in the mapped file until [`Tensor::to_bytes`] and the like are called.
///
/// # Errors
/// [`SceneError::Io`] if the file cannot be mapped, [`SceneError::Torch`] if it does not consist of tensors and plain
/// containers.
pub fn read(path: impl AsRef<Path>) -> Result<Value, SceneError> {
    let path = path.as_ref();
    parse(map(path)?).map_err(SceneError::torch(path))
}

fn map(path: &Path) -> Result<SharedBytes, SceneError> {
    atsplat_pickle::map(path).map_err(SceneError::io("mapping a torch file", path))
}
