use std::path::{Path, PathBuf};

use atsplat_camera::CameraError;
use atsplat_metrics::MetricError;
use atsplat_model::ModelError;
use atsplat_pixels::PixelError;
use atsplat_protocol::ProtocolError;
use atsplat_rooms::RoomsError;
use atsplat_scene::SceneError;
use atsplat_splat::SplatError;
use thiserror::Error;

use crate::Diagnosis;

/// What can go wrong in training.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TrainError {
    /// The operating system refused.
    #[error("{action}: {source} ({})", path.display())]
    Io {
        /// What was being done.
        action: &'static str,
        /// To which file.
        path: PathBuf,
        /// The operating system's words.
        source: std::io::Error,
    },
    /// A configuration, checkpoint or log is not what it should be.
    #[error("{what}: {location}: expected {expected}, found {found}")]
    Malformed {
        /// What was being read, e.g. "training configuration".
        what: &'static str,
        /// File, line, field or tensor.
        location: String,
        /// What should stand there.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// Steps went wrong one after the other.
    #[error("{0}")]
    Stopped(Box<Diagnosis>),
    /// No sample could be made.
    #[error("training data: {source_name}: {attempts} draws gave no sample; the last: {reason}")]
    NoSample {
        /// Which source.
        source_name: String,
        /// How many draws were tried.
        attempts: u32,
        /// Why the last one failed.
        reason: String,
    },
    /// The network, its configuration or weights.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Cameras.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Pictures.
    #[error(transparent)]
    Pixels(#[from] PixelError),
    /// Protocols and trials.
    #[error(transparent)]
    Protocol(#[from] ProtocolError),
    /// Simulated scenes.
    #[error(transparent)]
    Rooms(#[from] RoomsError),
    /// Datasets.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Rendering.
    #[error("rendering: {0}")]
    Splat(#[from] SplatError),
    /// Scores of an evaluation.
    #[error("evaluation: {0}")]
    Metric(#[from] MetricError),
    /// Parquet.
    #[error("log: {0}")]
    Columns(#[from] polars::error::PolarsError),
}

impl TrainError {
    #[expect(clippy::needless_pass_by_value, reason = "callers give numbers and fresh text as often as borrowed ones")]
    pub(crate) fn malformed(
        what: &'static str,
        location: impl Into<String>,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        let found = found.to_string();
        Self::Malformed { what, location: location.into(), expected: expected.into(), found }
    }

    /// What is wrong with a field of a file, with the file.
    pub(crate) fn in_file(self, path: &Path) -> Self {
        match self {
            Self::Malformed { what, location, expected, found } => {
                Self::Malformed { what, location: format!("{}, field {location}", path.display()), expected, found }
            }
            other => other,
        }
    }

    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { action, path, source }
    }
}
