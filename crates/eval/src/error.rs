use std::path::{Path, PathBuf};

use atsplat_files::{FileError, Malformed};
use atsplat_numeric::counted;
use atsplat_results::ResultsError;
use thiserror::Error;

/// Why methods cannot be evaluated.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "the message explains the fields")]
#[non_exhaustive]
pub enum EvalError {
    /// A file operation failed.
    #[error(transparent)]
    Io(#[from] FileError),
    /// A file has invalid content.
    #[error(transparent)]
    Malformed(#[from] Malformed),
    /// Results cannot be stored or read.
    #[error(transparent)]
    Results(#[from] ResultsError),
    /// Data without an index next to it.
    #[error("no evaluation index in {}: {}", data.display(), ways_to_an_index(accepted, sampler.as_deref()))]
    NoIndex {
        data: PathBuf,
        /// Names of the protocol's published indices.
        accepted: Vec<String>,
        /// Name of the rule that chooses frames as the protocol does.
        sampler: Option<String>,
    },
    /// A folder without the protocol's published index.
    #[error("evaluation index: expected {expected}, found {found}")]
    NoPublishedIndex { expected: String, found: String },
    /// A command that does not start a method.
    #[error("method exec: the command {command:?}: {why}")]
    NoMethod { command: String, why: String },
    /// The caller stopped the run.
    #[error("the run was stopped; the same command with the same folder resumes it")]
    Stopped,
    /// Existing results that a run would keep were computed from data that has changed since.
    #[error("the data of {} has changed: {first}; {advice}, or choose another folder", counted(*count as u64, "result"))]
    DataChanged { count: usize, first: String, advice: &'static str },
    /// An unknown name.
    #[error("{what}: expected one of {}, found {found:?}", known.join(", "))]
    Unknown { what: &'static str, found: String, known: Vec<String> },
    /// An invalid or inconsistent setting.
    #[error("{what}: expected {expected}, found {found}")]
    Settings { what: &'static str, expected: String, found: String },
    /// An error of the evaluation protocol.
    #[error(transparent)]
    Protocol(#[from] atsplat_protocol::ProtocolError),
    /// An error of the network.
    #[error(transparent)]
    Model(#[from] atsplat_model::ModelError),
    /// A file of tensors cannot be read or written.
    #[error(transparent)]
    Tensors(#[from] atsplat_model::weights::TensorError),
    /// A learned metric cannot be loaded.
    #[error(transparent)]
    Metrics(#[from] atsplat_metrics::learned::LoadError),
}

fn ways_to_an_index(accepted: &[String], sampler: Option<&str>) -> String {
    let file = match accepted {
        [] => "an index".to_owned(),
        names => format!("the file of {}", names.join(" or ")),
    };
    let rule = sampler.map_or_else(String::new, |name| format!(" {name}"));
    format!("give {file} (--index), or a sampling rule for data without an index (--sampler{rule})")
}

impl EvalError {
    /// Adds the label of the sweep's setting that the error is about.
    pub(crate) fn in_setting(self, label: &str) -> Self {
        match self {
            Self::Settings { what, expected, found } => {
                Self::Settings { what: "settings", expected: format!("{label:?}, {what}: {expected}"), found }
            }
            other => other,
        }
    }

    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        FileError::during(action, path)
    }
}
