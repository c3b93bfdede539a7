use thiserror::Error;

/// Why bytes are not a file of `torch.save` that this reader takes. Whoever knows the path adds it.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum TorchError {
    /// The bytes break their format.
    #[error("{location}: expected {expected}, found {found}")]
    Malformed {
        /// Byte offset, zip entry, or field of a scene.
        location: String,
        /// What the format asks for.
        expected: String,
        /// What stands there, shortened.
        found: String,
    },
    /// The pickle holds an opcode that `torch.save` does not write.
    #[error("pickle byte {offset}: expected an opcode that torch.save writes, found 0x{opcode:02x}")]
    ForbiddenOpcode {
        /// Byte offset in the pickle.
        offset: usize,
        /// The opcode.
        opcode: u8,
    },
    /// The pickle asks for a Python object other than tensors and containers: what an attack would do.
    #[error("pickle byte {offset}: global {global:?} is not on the allow-list of tensors and containers")]
    ForbiddenGlobal {
        /// Byte offset in the pickle.
        offset: usize,
        /// `module name`, shortened.
        global: String,
    },
    /// The file is what Git LFS leaves in the place of one that was not fetched.
    #[error(
        "expected a file of torch.save, found a Git LFS pointer to it: run `git lfs pull` in the repository that it came \
         from"
    )]
    LfsPointer,
    /// Valid, but not read by this toolkit.
    #[error("{location}: {feature} is not supported")]
    Unsupported {
        /// Where.
        location: String,
        /// What.
        feature: String,
    },
}

impl TorchError {
    /// [`TorchError::Malformed`]; for whoever reads a [`crate::Value`] and finds something else in it.
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
    const SHOWN: usize = 80;
    match text.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}…", text.get(..end).unwrap_or_default()),
        None => text.to_owned(),
    }
}
