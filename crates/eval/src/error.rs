use std::fmt::Display;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// Why results cannot be made, kept or read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum EvalError {
    /// The file system refused.
    #[error("{action}: {source} ({})", path.display())]
    Io {
        /// What was being done.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file of a store does not hold what it should.
    #[error("{}: {location}: expected {expected}, found {found}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Column and row, or line and column.
        location: String,
        /// What should stand there.
        expected: String,
        /// What does.
        found: String,
    },
    /// A folder that holds no store.
    #[error("{} holds no results: expected the file {} in it", folder.display(), super::store::PROVENANCE)]
    NoStore {
        /// The folder.
        folder: PathBuf,
    },
    /// A store that a later atsplat wrote.
    #[error("{} was written with schema version {found}; this atsplat reads versions 1 to {newest}: a newer one is needed", path.display())]
    TooNew {
        /// Its provenance.
        path: PathBuf,
        /// Its version.
        found: u32,
        /// The latest that is known here.
        newest: u32,
    },
    /// A store that says its schema's version and has another schema.
    #[error("{}: schema version {version}: expected the hash {expected}, found {found}", path.display())]
    SchemaHash {
        /// Its provenance.
        path: PathBuf,
        /// Its version.
        version: u32,
        /// The committed schema's hash.
        expected: String,
        /// What the store says.
        found: String,
    },
    /// Two runs that do not belong into one store.
    #[error("{what} of the two runs differ: expected {expected}, found {found}{advice}")]
    Different {
        /// What differs.
        what: String,
        /// What the first has.
        expected: String,
        /// What the second has.
        found: String,
        /// What to do about it.
        advice: &'static str,
    },
    /// Two records of one run's parts that are not the same.
    #[error("{what} of the two runs differ: {differences}{advice}")]
    Differences {
        /// What differs.
        what: String,
        /// Each field with what the first has and what the second has.
        differences: String,
        /// What to do about it.
        advice: &'static str,
    },
    /// Two answers to one question that are not the same.
    #[error("two results of {key} differ in {field}: {first} and {second}")]
    Disagreement {
        /// Preset, method, scene and entry.
        key: String,
        /// The first column that differs.
        field: String,
        /// What the first result says.
        first: String,
        /// What the second says.
        second: String,
    },
    /// The protocol that a record holds as text is none.
    #[error("presets, {name}, toml: {source}")]
    Preset {
        /// Name of the preset in the rows.
        name: String,
        /// The field, what was expected and found.
        source: Box<atsplat_protocol::ProtocolError>,
    },
    /// Another process writes into the store.
    #[error(
        "{} is being written by {by}: wait until that run ends; or let each process write a part of the scenes into a \
         folder of its own, with --shard 1/2 and --shard 2/2, and put the parts together with `atsplat merge`",
        folder.display()
    )]
    InUse {
        /// The store.
        folder: PathBuf,
        /// Which process, on which machine, since when.
        by: String,
    },
    /// Results that a run would leave beside new ones were made from other data than there is now.
    #[error("{count} results were made from other data than there is now: {first}; {advice}, or choose another folder")]
    DataChanged {
        /// How many.
        count: usize,
        /// The first, and what became of its data.
        first: String,
        /// What to do about it.
        advice: &'static str,
    },
    /// A store holds rows of one trial that were made from different data.
    #[error(
        "results of one trial were made from different {what}: {first}, and {second}; a run of these methods into the same \
         folder computes again what is out of date"
    )]
    MixedData {
        /// What differs.
        what: &'static str,
        /// One result.
        first: String,
        /// Another.
        second: String,
    },
    /// A number that no row may hold.
    #[error("{key}: {field} is {value}, and only finite numbers are kept")]
    NotFinite {
        /// Preset, method, scene and entry.
        key: String,
        /// Which column.
        field: String,
        /// What it is.
        value: f64,
    },
    /// A word that names nothing.
    #[error("{what}: expected one of {}, found {found:?}", known.join(", "))]
    Unknown {
        /// What was named.
        what: &'static str,
        /// What was asked for.
        found: String,
        /// What there is.
        known: Vec<String>,
    },
    /// Settings that do not fit together.
    #[error("{what}: expected {expected}, found {found}")]
    Settings {
        /// Which setting.
        what: &'static str,
        /// What is allowed.
        expected: String,
        /// What was given.
        found: String,
    },
    /// The evaluation protocol cannot be run.
    #[error(transparent)]
    Protocol(#[from] atsplat_protocol::ProtocolError),
    /// A network cannot be run.
    #[error(transparent)]
    Model(#[from] atsplat_model::ModelError),
    /// Learned metrics cannot be loaded.
    #[error(transparent)]
    Metrics(#[from] atsplat_metrics::learned::LoadError),
}

impl EvalError {
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io { action, path: path.to_owned(), source }
    }

    pub(crate) fn malformed(
        path: &Path,
        location: impl Into<String>,
        expected: impl Into<String>,
        found: impl Display,
    ) -> Self {
        let found = found.to_string().chars().take(200).collect();
        Self::Malformed { path: path.to_owned(), location: location.into(), expected: expected.into(), found }
    }
}
