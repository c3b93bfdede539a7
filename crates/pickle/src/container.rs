use std::collections::HashMap;

use crate::SharedBytes;
use crate::TorchError;
use crate::shortened;
use crate::zip_container::ZipDirectory;

/// Where the storages of a file are, by the key that the pickle names them by.
#[derive(Debug)]
pub(crate) enum Container {
    /// `torch.save` since 1.6: an entry each, whose local header is not touched before the storage is.
    Zip(ZipDirectory),
    /// Known ranges: the older format, which appends the storages to the pickle.
    Buffers(HashMap<String, SharedBytes>),
}

impl Container {
    /// Length of a storage in bytes; `None` where there is none under this key.
    pub(crate) fn len(&self, key: &str) -> Option<u64> {
        match self {
            Self::Zip(directory) => directory.len(&directory.storage_name(key)),
            Self::Buffers(buffers) => buffers.get(key).map(|buffer| buffer.len() as u64),
        }
    }

    /// The bytes of a storage, shared with the file's map.
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
