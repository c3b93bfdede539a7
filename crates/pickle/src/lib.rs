//! Reads `torch.save` files without Python: checkpoints, and the chunks of pixelSplat's datasets.
//!
//! Files are memory-mapped. The pickle is interpreted with an allow-list of opcodes and names, so that it can build lists,
//! dicts and tensors and nothing else; tensors are ranges of the mapped file. Any bytes give a value or a [`TorchError`],
//! in memory bounded by the length of the pickle.
//!
//! A mapped file must not be truncated while it is in use: the operating system would terminate the process (`SIGBUS`).
//! Replacing a file by renaming is safe.

mod container;
mod error;
mod globals;
mod graph;
mod interpreter;
mod legacy_container;
mod shared_bytes;
mod tensor;
mod value;
mod zip_container;

use std::fs::File;
use std::io::{Error, ErrorKind, Result as IoResult};
use std::path::Path;
use std::sync::Arc;

pub use error::{TorchError, shortened};
pub use shared_bytes::SharedBytes;
pub use tensor::{DType, Tensor};
pub use value::{Dict, Key, Value};

use container::Container;
use zip_container::ZipDirectory;

/// Maximum nesting of containers. Real files stay below ten; with the limit a [`Value`] can be dropped and traversed
/// recursively.
pub const MAX_DEPTH: usize = 100;

/// Whether bytes start like a `torch.save` file, in the zip format (PyTorch 1.6 and later) or the legacy one.
pub fn recognises(file: &[u8]) -> bool {
    ZipDirectory::recognises(file) || legacy_container::recognises(file)
}

/// As `is_lfs_pointer` of `atsplat-files`: this crate uses no other of the workspace.
fn is_lfs_pointer(file: &[u8]) -> bool {
    file.starts_with(b"version https://git-lfs.github.com/spec/")
}

/// Parses a `torch.save` file in either format.
///
/// The elements of tensors are not read before [`Tensor::to_bytes`] and the like are called. What is read from a zip file is
/// compared with its CRC-32, if the file has CRCs.
///
/// # Errors
/// [`TorchError`] if the bytes do not consist of tensors and plain containers.
pub fn parse(file: SharedBytes) -> Result<Value, TorchError> {
    if ZipDirectory::recognises(&file) {
        let directory = ZipDirectory::parse(file)?;
        let bytes = directory.pickle()?;
        let parsed = interpreter::parse(&bytes, 0)?;
        return parsed.graph.into_value(parsed.root, &Arc::new(Container::Zip(directory)));
    }
    if legacy_container::recognises(&file) {
        return legacy_container::parse(&file);
    }
    if is_lfs_pointer(&file) {
        return Err(TorchError::LfsPointer);
    }
    let start: Vec<String> = file.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
    let found = if start.is_empty() { "an empty file".to_owned() } else { start.join(" ") };
    Err(TorchError::malformed("byte 0", "a zip file or torch.save's magic number", found))
}

/// Parses a bare pickle without storages.
///
/// # Errors
/// [`TorchError`] if the pickle is malformed or contains anything but plain containers.
pub fn parse_pickle(bytes: &[u8]) -> Result<Value, TorchError> {
    legacy_container::plain(interpreter::parse(bytes, 0)?)
}

/// Maps a regular file into memory, read-only.
///
/// # Errors
/// If it is something else, such as a pipe, whose opening would wait for whoever writes to it, or cannot be opened or mapped.
pub fn map(path: &Path) -> IoResult<SharedBytes> {
    if !std::fs::metadata(path)?.is_file() {
        let found = "expected a regular file, found a folder, a pipe, a socket or a device";
        return Err(Error::new(ErrorKind::InvalidInput, found));
    }
    let file = File::open(path)?;
    // SAFETY: the map is read-only and its bytes are only read as bytes. If another process truncates the file, this one
    // is terminated by SIGBUS, as documented by the crate.
    #[expect(unsafe_code, reason = "files of 100 MB and more are mapped, so that unused parts are never read")]
    let map = unsafe { memmap2::Mmap::map(&file) };
    map.map(SharedBytes::new)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pipe would wait, and a device has no length.
    #[test]
    fn only_regular_files_are_mapped() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
        assert!(map(&folder.join("Cargo.toml")).unwrap().starts_with(b"[package]"));
        for other in [folder, Path::new(if cfg!(unix) { "/dev/zero" } else { "NUL" })] {
            let error = map(other).map(drop).unwrap_err().to_string();
            assert!(error.starts_with("expected a regular file, found"), "{}: {error}", other.display());
        }
    }

    #[test]
    fn a_git_lfs_pointer_error_names_the_remedy() {
        let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
        let error = parse(SharedBytes::new(pointer.to_vec())).unwrap_err();
        assert!(error == TorchError::LfsPointer && error.to_string().contains("git lfs pull"), "{error}");
    }
}
