use std::collections::HashMap;

use super::TorchError;
use super::error::shortened;
use super::zip_container::ZipDirectory;
use crate::SharedBytes;

/// Where the storages of a file are, by the key that the pickle names them by.
#[derive(Debug)]
pub(super) enum Container {
    /// `torch.save` since 1.6: an entry each, whose local header is not touched before the storage is.
    Zip(ZipDirectory),
    /// Known ranges: the older format, which appends the storages to the pickle.
    Buffers(HashMap<String, SharedBytes>),
}

impl Container {
    /// Length of a storage in bytes; `None` where there is none under this key.
    pub(super) fn len(&self, key: &str) -> Option<u64> {
        match self {
            Self::Zip(directory) => directory.len(&directory.storage_name(key)),
            Self::Buffers(buffers) => buffers.get(key).map(|buffer| buffer.len() as u64),
        }
    }

    /// The bytes of a storage, shared with the file's map.
    pub(super) fn bytes(&self, key: &str) -> Result<SharedBytes, TorchError> {
        match self {
            Self::Zip(directory) => directory.bytes(&directory.storage_name(key)),
            Self::Buffers(buffers) => buffers
                .get(key)
                .cloned()
                .ok_or_else(|| TorchError::malformed("storages", format!("one named {:?}", shortened(key)), "none")),
        }
    }
}
