use std::fmt;
use std::path::PathBuf;

use atsplat_camera::CameraError;
use atsplat_files::FileError;
use atsplat_splat::gpu::GpuError;
use atsplat_splat::{GaussianCounts, SplatError};
use thiserror::Error;

/// What can go wrong in an optimisation.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FitError {
    /// A setting is out of range.
    #[error("{name}: expected {expected}, found {found}")]
    Setting {
        /// The setting.
        name: &'static str,
        /// Its range.
        expected: String,
        /// Its value.
        found: String,
    },
    /// A training view cannot be used.
    #[error("view {name}: expected {expected}, found {found}")]
    View {
        /// The view's name.
        name: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// No initial Gaussian can be optimised.
    #[error("initial Gaussians: expected {expected}, found {found}")]
    Start {
        /// What was expected.
        expected: &'static str,
        /// What was found.
        found: String,
    },
    /// A step cannot be used, or density control failed after it.
    #[error("{0}")]
    Stopped(Box<Diagnosis>),
    /// A checkpoint does not belong to this run, or is damaged.
    #[error("checkpoint: {field}: expected {expected}, found {found} ({})", path.display())]
    Checkpoint {
        /// The tensor or metadata entry.
        field: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
        /// The file.
        path: PathBuf,
    },
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// Error of a camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Error of the renderer.
    #[error(transparent)]
    Splat(#[from] SplatError),
}

impl FitError {
    /// Whether the graphics adapter failed, which may be unusable from then on.
    pub fn is_device_error(&self) -> bool {
        match self {
            Self::Stopped(diagnosis) => matches!(diagnosis.reason, StopReason::Device(_)),
            Self::Splat(error) => matches!(error, SplatError::Gpu(_)),
            _ => false,
        }
    }
}

/// Where an optimisation stopped, and why.
///
/// The scene that is left is that of the step before, unless the failure came after the optimiser's update: in density control
/// ([`StopReason::TooManyGaussians`], [`StopReason::NoGaussians`]), or in the 3D filter if no camera sees a Gaussian any more
/// ([`StopReason::NothingVisible`]; that no view of an epoch shows one is found before the update). Then the update stays, and the step
/// counts as done in [`crate::Fit::step_count`].
#[derive(Clone, Debug, PartialEq)]
pub struct Diagnosis {
    /// The step that failed, counted from 1.
    pub step: u64,
    /// Name of the training view of this step.
    pub view: String,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// What went wrong.
    pub reason: StopReason,
}

/// Why an optimisation stopped.
#[derive(Clone, Debug, PartialEq)]
pub enum StopReason {
    /// The loss is NaN or infinite.
    NonFiniteLoss {
        /// Mean absolute error.
        l1: f64,
        /// `1 − SSIM`.
        d_ssim: f64,
    },
    /// Gradients are NaN or infinite.
    NonFiniteGradients {
        /// The parameter.
        parameter: &'static str,
        /// Number of values.
        count: usize,
    },
    /// Density control would exceed the limit.
    TooManyGaussians {
        /// Gaussians that density control asks for.
        wanted: usize,
        /// The limit.
        limit: usize,
    },
    /// Every Gaussian was pruned.
    NoGaussians,
    /// No training camera sees any Gaussian.
    NothingVisible {
        /// Depth of the near plane, in the unit of length of the views.
        near: f64,
        /// Gaussians by why the view of the step does not show them; for a filter, by why no view does. Zeros if that is not known.
        counts: GaussianCounts,
    },
    /// The graphics adapter failed.
    Device(GpuError),
}

impl fmt::Display for StopReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NonFiniteLoss { l1, d_ssim } => write!(f, "the loss is not finite: L1 {l1}, D-SSIM {d_ssim}"),
            Self::NonFiniteGradients { parameter, count } => {
                write!(f, "{count} gradients of {parameter} are NaN or infinite")
            }
            Self::TooManyGaussians { wanted, limit } => {
                write!(f, "density control asks for {wanted} Gaussians, more than the limit of {limit}")
            }
            Self::NoGaussians => f.write_str("density control pruned every Gaussian"),
            Self::NothingVisible { near, counts } => {
                write!(f, "no training camera sees any Gaussian: {}", why_unseen(*near, *counts))
            }
            Self::Device(error) => error.fmt(f),
        }
    }
}

/// The reason of the most Gaussians, the first of several.
fn why_unseen(near: f64, counts: GaussianCounts) -> String {
    let GaussianCounts { drawn: _, invalid, outside_depth, faint, outside_image } = counts;
    let most = [outside_depth, outside_image, faint, invalid].into_iter().max().unwrap_or(0);
    if most == 0 {
        return format!("is the scene in front of the near plane, at a depth of {near}?");
    }
    let reason = if most == outside_depth {
        format!("nearer than the near plane or beyond the far plane; the near plane is at a depth of {near}")
    } else if most == outside_image {
        "outside the image".to_owned()
    } else if most == faint {
        "too faint everywhere (by default, an opacity below 1/255 is not drawn)".to_owned()
    } else {
        "not finite, or too large".to_owned()
    };
    format!("{most} of {} are {reason}", counts.total())
}

impl fmt::Display for Diagnosis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { step, view, gaussians, reason } = self;
        write!(f, "stopped at step {step} (view {view}, {gaussians} Gaussians): {reason}")
    }
}
