use std::fmt::Display;
use std::path::{Path, PathBuf};

use atsplat_files::{FileError, LockError, Malformed};
use thiserror::Error;

/// Why results cannot be stored, read, or joined with others.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
#[non_exhaustive]
pub enum ResultsError {
    /// A file operation failed.
    #[error(transparent)]
    Io(#[from] FileError),
    /// A file of a store has invalid content.
    #[error(transparent)]
    Malformed(#[from] Malformed),
    /// A folder without a store.
    #[error("{} contains no results: expected the file {} in it", folder.display(), super::store::PROVENANCE)]
    NoStore { folder: PathBuf },
    /// A new store in a folder that already contains one, or rows of one.
    #[error("{}: expected a folder without results, found {found}; choose another folder", folder.display())]
    HasResults { folder: PathBuf, found: String },
    /// A store written by a newer atsplat.
    #[error(
        "{} was written with schema version {found}; this atsplat reads versions 1 to {newest}: a newer atsplat is needed",
        path.display()
    )]
    TooNew { path: PathBuf, found: u32, newest: u32 },
    /// A store whose schema hash does not match its schema version.
    #[error("{}: schema version {version}: expected the hash {expected}, found {found}", path.display())]
    SchemaHash { path: PathBuf, version: u32, expected: String, found: String },
    /// Another process is writing to the store.
    #[error(
        "{} is being written by {by}: wait until that run ends; or let each process write a part of the scenes into \
         another folder, with --shard 1/2 and --shard 2/2, and merge the parts with `atsplat merge`",
        folder.display()
    )]
    InUse {
        folder: PathBuf,
        /// The process, its machine and since when.
        by: String,
    },
    /// Two runs that cannot share a store.
    #[error("{what} of the two runs differ: expected {expected}, found {found}{advice}")]
    Different { what: &'static str, expected: String, found: String, advice: &'static str },
    /// Two records that must be equal within one run.
    #[error("{what}{} of the two runs differ: {differences}{advice}", name.as_ref().map_or_else(String::new, |name| format!(" {name}")))]
    Differences {
        what: &'static str,
        /// Which of them, if there are several.
        name: Option<String>,
        /// Each differing field with the first and the second value.
        differences: String,
        advice: &'static str,
    },
    /// Two different results for one trial.
    #[error("two results of {key} differ in {field}: {first} and {second}")]
    Disagreement { key: String, field: String, first: String, second: String },
    /// Rows of one trial were computed from different data.
    #[error(
        "results of one trial were computed from different {what}: {first}, and {second}; a run of these methods into the \
         same folder recomputes what is outdated"
    )]
    MixedData { what: &'static str, first: String, second: String },
    /// A record's protocol text cannot be parsed.
    #[error("presets, {name}, toml: {source}")]
    Preset { name: String, source: Box<atsplat_protocol::ProtocolError> },
    /// A non-finite number in a row.
    #[error("{key}: {field}: expected a finite number, found {value}")]
    NotFinite { key: String, field: String, value: f64 },
    /// An impossible value in a row, such as an SSIM above 1.
    #[error("{key}: {field}: expected {expected}, found {found}")]
    Impossible { key: String, field: String, expected: String, found: String },
    /// Rows that no store can contain, or none to merge.
    #[error("{what}: expected {expected}, found {found}")]
    Invalid { what: &'static str, expected: String, found: String },
    /// The digests of image files cannot be read or written.
    #[error(transparent)]
    Digests(#[from] atsplat_protocol::ProtocolError),
}

impl From<LockError> for ResultsError {
    fn from(error: LockError) -> Self {
        match error {
            LockError::Io(error) => Self::Io(error),
            LockError::InUse { folder, by } => Self::InUse { folder, by },
        }
    }
}

impl ResultsError {
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        FileError::during(action, path)
    }

    pub(crate) fn malformed(
        path: &Path,
        location: impl Into<String>,
        expected: impl Into<String>,
        found: impl Display,
    ) -> Self {
        Malformed::new("results", location, expected, found).in_file(path).into()
    }
}
