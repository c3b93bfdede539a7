use std::collections::HashMap;

use crate::zip_container::ZipDirectory;
use crate::{SharedBytes, TorchError, shortened};

/// The storages of a file, by their key in the pickle.
#[derive(Debug)]
pub(crate) enum Container {
    /// `torch.save` since 1.6: zip entries, whose local headers are not read before the storage is.
    Zip(ZipDirectory),
    /// The legacy format, which appends the storages to the pickle.
    Buffers(HashMap<String, SharedBytes>),
}

impl Container {
    /// Length of a storage in bytes; `None` if there is none with this key.
    pub(crate) fn len(&self, key: &str) -> Option<u64> {
        match self {
            Self::Zip(directory) => directory.len(&directory.storage_name(key)),
            Self::Buffers(buffers) => buffers.get(key).map(|buffer| buffer.len() as u64),
        }
    }

    /// The bytes of a storage, shared with the mapped file.
    pub(crate) fn bytes(&self, key: &str) -> Result<SharedBytes, TorchError> {
        match self {
            Self::Zip(directory) => directory.bytes(&directory.storage_name(key)),
            Self::Buffers(buffers) => buffers
                .get(key)
                .cloned()
                .ok_or_else(|| TorchError::malformed("storages", format!("one named {:?}", shortened(key)), "none")),
        }
    }
}
