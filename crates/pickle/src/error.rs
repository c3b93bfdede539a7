use thiserror::Error;

/// Why a `torch.save` file cannot be read. The caller adds the path.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum TorchError {
    /// The bytes violate their format.
    #[error("{location}: expected {expected}, found {found}")]
    Malformed {
        /// Byte offset, zip entry, or field of a scene.
        location: String,
        expected: String,
        /// What the file contains, shortened.
        found: String,
    },
    /// The pickle has an opcode that `torch.save` does not write.
    #[error("pickle byte {offset}: expected an opcode that torch.save writes, found 0x{opcode:02x}")]
    ForbiddenOpcode {
        /// Byte offset in the pickle.
        offset: usize,
        /// The opcode.
        opcode: u8,
    },
    /// The pickle refers to a Python object other than tensors and containers, as an attack would.
    #[error("pickle byte {offset}: global {global:?} is not on the allow-list of tensors and containers")]
    ForbiddenGlobal {
        /// Byte offset in the pickle.
        offset: usize,
        /// `module name`, shortened.
        global: String,
    },
    /// The file is a Git LFS pointer: the content was not fetched.
    #[error("expected a file of torch.save, found a Git LFS pointer to it: run `git lfs pull` in its repository")]
    LfsPointer,
    /// Valid, but not supported.
    #[error("{location}: {feature} is not supported")]
    Unsupported {
        /// Byte offset, zip entry, or object.
        location: String,
        feature: String,
    },
}

impl TorchError {
    /// [`TorchError::Malformed`], also for users of a [`crate::Value`] with unexpected content.
    pub fn malformed(location: impl Into<String>, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Malformed { location: location.into(), expected: expected.into(), found: found.into() }
    }

    /// [`TorchError::Unsupported`].
    pub fn unsupported(location: impl Into<String>, feature: impl Into<String>) -> Self {
        Self::Unsupported { location: location.into(), feature: feature.into() }
    }
}

/// At most 80 characters of untrusted text, for a message.
pub fn shortened(text: &str) -> String {
    match text.char_indices().nth(80) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}
