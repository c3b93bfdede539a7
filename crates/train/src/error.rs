use std::path::{Path, PathBuf};

use atsplat_camera::CameraError;
use atsplat_files::{FileError, LockError, Malformed};
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
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// A configuration, checkpoint or log is malformed.
    #[error(transparent)]
    Malformed(#[from] Malformed),
    /// Another process trains in the folder of the run.
    #[error(
        "{} is being written by {by}: wait until that process ends, or train into another folder", folder.display()
    )]
    InUse {
        /// The folder.
        folder: PathBuf,
        /// Which process, on which machine, since when.
        by: String,
    },
    /// Too many steps in a row failed.
    #[error("{0}")]
    Stopped(Box<Diagnosis>),
    /// None of a run's steps could be used.
    #[error(
        "none of the run's {steps} steps so far could be used, so that its weights are not trained; the last: {last}"
    )]
    Untrained {
        /// Number of steps done.
        steps: u64,
        /// Why the last one could not be used.
        last: String,
    },
    /// A source gave no sample.
    #[error("{}: {source_name}: {attempts} draws gave no sample; the last: {reason}", purpose.data())]
    NoSample {
        /// What the sample was for.
        purpose: Purpose,
        /// Which source.
        source_name: String,
        /// How many draws were tried.
        attempts: u32,
        /// Why the last one failed.
        reason: String,
    },
    /// Weights have grown beyond the range of a weights file.
    #[error(
        "training diverged by step {step}: {tensor} contains {value}, and weights are written as f16, up to 65504; start another run \
         with a lower schedule.learning-rate or clip; {}", remaining(*last_checkpoint)
    )]
    Diverged {
        /// Number of steps done.
        step: u64,
        /// The first parameter with such a value.
        tensor: String,
        /// The value.
        value: f32,
        /// Number of steps before the run's last checkpoint, if there is one.
        last_checkpoint: Option<u64>,
    },
    /// Error of the network, its configuration or weights.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A file of tensors cannot be read or written.
    #[error(transparent)]
    Tensors(#[from] atsplat_model::weights::TensorError),
    /// Error of a camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Error of an image.
    #[error(transparent)]
    Pixels(#[from] PixelError),
    /// Error of a protocol or trial.
    #[error(transparent)]
    Protocol(#[from] ProtocolError),
    /// Error of a simulated scene.
    #[error(transparent)]
    Rooms(#[from] RoomsError),
    /// Error of a dataset.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Error of the renderer.
    #[error("rendering: {0}")]
    Splat(#[from] SplatError),
    /// Error of an evaluation's metric.
    #[error("evaluation: {0}")]
    Metric(#[from] MetricError),
    /// Error of a Parquet log.
    #[error("log: {0}")]
    Columns(#[from] polars::error::PolarsError),
    /// Another error, with the field of the configuration that names what caused it.
    #[error("{field}: {source}")]
    InField {
        /// The path of the field.
        field: String,
        /// The error.
        source: Box<TrainError>,
    },
    /// Another error, with the file that caused it.
    #[error("{source} ({})", path.display())]
    InFile {
        /// The file.
        path: PathBuf,
        /// The error.
        source: Box<TrainError>,
    },
}

/// What samples are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Steps of the run.
    Training,
    /// Its evaluations.
    Evaluation,
}

impl Purpose {
    /// What messages call the data.
    pub(crate) const fn data(self) -> &'static str {
        match self {
            Self::Training => "training data",
            Self::Evaluation => "evaluation data",
        }
    }
}

/// Which checkpoints a diverged run has.
fn remaining(last_checkpoint: Option<u64>) -> String {
    last_checkpoint
        .map_or_else(|| "no checkpoint was written".to_owned(), |step| format!("checkpoints up to step {step} remain"))
}

impl From<LockError> for TrainError {
    fn from(error: LockError) -> Self {
        match error {
            LockError::Io(error) => Self::Io(error),
            LockError::InUse { folder, by } => Self::InUse { folder, by },
        }
    }
}

impl TrainError {
    pub(crate) fn malformed(
        what: &'static str,
        location: impl Into<String>,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        Malformed::new(what, location, expected, found).into()
    }

    /// The same error, of a source that is for evaluations.
    pub(crate) fn of_evaluation(self) -> Self {
        match self {
            Self::NoSample { source_name, attempts, reason, .. } => {
                Self::NoSample { purpose: Purpose::Evaluation, source_name, attempts, reason }
            }
            Self::Malformed(malformed) if malformed.what == Purpose::Training.data() => {
                Self::Malformed(Malformed { what: Purpose::Evaluation.data(), ..malformed })
            }
            other => other,
        }
    }

    /// The same error with its file, in front of the field if it names one.
    pub(crate) fn in_file(self, path: &Path) -> Self {
        match self {
            Self::Malformed(malformed) => {
                let location = format!("{}, field {}", path.display(), malformed.location);
                Self::Malformed(Malformed { location, ..malformed })
            }
            other => Self::InFile { path: path.to_owned(), source: Box::new(other) },
        }
    }

    /// The same error with the field of the configuration that names what caused it. What is malformed names its place already.
    pub(crate) fn in_field(self, field: impl Into<String>) -> Self {
        match self {
            named @ (Self::Malformed(_) | Self::InField { .. }) => named,
            other => Self::InField { field: field.into(), source: Box::new(other) },
        }
    }

    /// The same error with its field, if it has one, as part of the `parent` field.
    pub(crate) fn below(self, parent: &str) -> Self {
        match self {
            Self::InField { field, source } => Self::InField { field: format!("{parent}.{field}"), source },
            other => other,
        }
    }

    /// The same error with the file of the configuration, if it names one of its fields.
    #[must_use]
    pub fn in_configuration(self, path: &Path) -> Self {
        match self {
            Self::InField { .. } => self.in_file(path),
            other => other,
        }
    }

    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Self {
        FileError::during(action, path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_of_an_evaluation_are_called_so() {
        let malformed = |what| TrainError::malformed(what, "a folder", "a scene", "none").of_evaluation().to_string();
        assert_eq!(malformed(Purpose::Training.data()), "evaluation data: a folder: expected a scene, found none");
        assert_eq!(malformed("index"), "index: a folder: expected a scene, found none");
    }

    #[test]
    fn errors_of_a_field_name_it_and_the_configuration() {
        let closed = || TrainError::io("opening", "a folder")(std::io::ErrorKind::NotFound.into());
        let shown = |error: TrainError| error.below("data[1]").in_configuration(Path::new("run.toml")).to_string();
        assert_eq!(shown(closed()), closed().to_string(), "no field");
        assert_eq!(shown(closed().in_field("path")), format!("data[1].path: {} (run.toml)", closed()));
        let malformed = TrainError::malformed("index", "line 2", "a scene", "none");
        assert_eq!(shown(malformed.in_field("path")), "index: line 2: expected a scene, found none");
    }
}
