//! Files of `torch.save` as [`atsplat_pickle`] reads them, and the chunks of pixelSplat's datasets among them.
//!
//! A mapped file must not be made shorter while it is in use: the operating system then ends the process
//! (`SIGBUS`). Replacing a file by renaming, as [`ChunkWriter`] does, is safe.

mod chunk;
mod chunks;
mod pickle_writer;
mod record;
mod writer;

use std::path::Path;

pub use atsplat_pickle::{DType, Dict, Key, MAX_DEPTH, Tensor, TorchError, Value, parse, parse_pickle};
pub use chunk::Chunk;
pub use chunks::TorchChunks;
pub use record::ChunkScene;
pub use writer::{ChunkWriter, ChunksWritten};

use crate::{SceneError, SharedBytes};

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

fn map(path: &Path) -> Result<SharedBytes, SceneError> {
    atsplat_pickle::map(path).map_err(SceneError::io("mapping a torch file", path))
}
