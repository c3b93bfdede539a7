use atsplat_files::FileError;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Why something in object storage cannot be read or written. Credentials are never part of it.
#[derive(Clone, Debug, PartialEq, Eq, Error, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum ObjectError {
    /// The program that opens connections is missing.
    #[error(
        "{url}: expected the program atsplat-objects next to atsplat or on PATH, found none: install it with \
         `cargo install --path crates/objects --features object-storage`"
    )]
    NotInstalled { url: String },
    /// The program that the environment names cannot be started.
    #[error("{url}: the variable ATSPLAT_OBJECTS names {program:?}, which cannot be started: {detail}")]
    NotStarted { url: String, program: String, detail: String },
    /// A URL or its configuration is invalid.
    #[error("{url}: expected s3://BUCKET/FOLDER, gs://BUCKET/FOLDER or az://CONTAINER/FOLDER: {detail}")]
    Invalid { url: String, detail: String },
    /// No object has this URL, or a URL below it.
    #[error("{url}: expected an object or a folder of objects, found none")]
    NotFound { url: String },
    /// Credentials are missing, wrong, or do not suffice.
    #[error("{url}: access denied: {detail}")]
    Denied { url: String, detail: String },
    /// An object is not the one that was listed.
    #[error("{url}: changed while it was being read: expected {expected}, found {found}; start again")]
    Changed { url: String, expected: String, found: String },
    /// An object's name cannot be that of a file.
    #[error("{url}: expected a valid file name, found {name:?}")]
    Name { url: String, name: String },
    /// Another process writes to a results store.
    #[error("{url}: also written by {by}: results that were finished before are kept, and a later run resumes them")]
    TakenOver { url: String, by: String },
    /// A request failed, also when it was repeated.
    #[error("{url}: {action}: {detail}")]
    Request { url: String, action: String, detail: String },
    /// A local copy cannot be read or written.
    #[error("{0}")]
    Io(String),
}

/// As text, because it is passed on to another process.
impl From<FileError> for ObjectError {
    fn from(error: FileError) -> Self {
        Self::Io(error.to_string())
    }
}
