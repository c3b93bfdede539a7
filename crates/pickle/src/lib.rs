//! What `torch.save` wrote, without Python: checkpoints, and the chunks of pixelSplat's datasets.
//!
//! A file is mapped, not read; its pickle is run by an allow-list of opcodes and names, so that it can
//! build lists, dicts and tensors and nothing else; tensors are ranges of the map. Any bytes give a value
//! or a [`TorchError`], in memory that the length of the pickle bounds.
//!
//! A mapped file must not be made shorter while it is in use: the operating system then ends the process
//! (`SIGBUS`). Replacing a file by renaming is safe.

mod bytes;
mod container;
mod error;
mod globals;
mod graph;
mod legacy_container;
mod machine;
mod shared_bytes;
mod tensor;
mod value;
mod zip_container;

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

pub use error::{TorchError, shortened};
pub use shared_bytes::SharedBytes;
pub use tensor::{DType, Tensor};
pub use value::{Dict, Key, Value};

use container::Container;
use zip_container::ZipDirectory;

/// How many containers may hold each other. `torch.save` of anything sane stays below ten; the limit lets
/// a [`Value`] be dropped and walked by recursion.
pub const MAX_DEPTH: usize = 100;

/// Whether bytes begin as a file of `torch.save` does, in the zip format (PyTorch 1.6 and later) or the
/// one before.
pub fn recognises(file: &[u8]) -> bool {
    ZipDirectory::recognises(file) || legacy_container::recognises(file)
}

/// Whether bytes are what Git LFS leaves in the place of a file that was not fetched (git-lfs `docs/spec.md`).
pub fn is_lfs_pointer(file: &[u8]) -> bool {
    file.starts_with(b"version https://git-lfs.github.com/spec/")
}

/// Reads bytes that `torch.save` wrote, in either format.
///
/// Tensors stay where they are until [`Tensor::to_bytes`] asks for them.
///
/// # Errors
/// [`TorchError`] where the bytes are not tensors and plain containers.
pub fn parse(file: SharedBytes) -> Result<Value, TorchError> {
    if ZipDirectory::recognises(&file) {
        let directory = ZipDirectory::parse(file)?;
        let bytes = directory.pickle()?;
        let parsed = machine::parse(&bytes, 0)?;
        return parsed.graph.into_value(parsed.root, &Arc::new(Container::Zip(directory)));
    }
    if legacy_container::recognises(&file) {
        return legacy_container::parse(&file);
    }
    if is_lfs_pointer(&file) {
        return Err(TorchError::LfsPointer);
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
    legacy_container::plain(machine::parse(bytes, 0)?)
}

/// Maps a file into memory, read-only.
///
/// # Errors
/// Where the file cannot be opened or mapped.
pub fn map(path: &Path) -> std::io::Result<SharedBytes> {
    let file = File::open(path)?;
    // SAFETY: the map is read-only and its bytes are only ever read as bytes. Another process that
    // truncates the file ends this one with SIGBUS, which the crate documents.
    #[expect(unsafe_code, reason = "files of 100 MB and more are mapped so that what is not used is never read")]
    let map = unsafe { memmap2::Mmap::map(&file) };
    map.map(SharedBytes::new)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_git_lfs_pointer_says_what_to_do() {
        let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
        let error = parse(SharedBytes::new(pointer.to_vec())).unwrap_err();
        assert!(error == TorchError::LfsPointer && error.to_string().contains("git lfs pull"), "{error}");
    }
}
