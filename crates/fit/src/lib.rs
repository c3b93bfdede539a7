//! Optimises Gaussians for one scene by gradient descent on its posed images: 3DGS' adaptive density control (Kerbl et
//! al. 2023), Mip-Splatting (Yu et al. 2024), MCMC (Kheradmand et al. 2024), and refinement of given Gaussians.
//!
//! A [`Fit`] has the scene and takes one step at a time. A step depends on the configuration and the step number alone,
//! so a run that resumes from a [checkpoint](Fit::checkpoint) ends bit for bit like an uninterrupted one, on any number of
//! threads, and with the same [history](History).
//!
//! The optimised parameters are those of [`atsplat_splat::Gaussians`]: means, quaternions of any norm, logarithms of
//! scales, logits of opacities, spherical harmonics. Constants are those of the published code unless a comment says
//! otherwise; schedules scale with the number of steps.

#![expect(
    clippy::inline_always,
    reason = "only code inlined into the dispatched function gets its vector instructions"
)]

mod adam;
mod budget;
mod checkpoint;
mod config;
mod corrections;
pub mod density;
mod device;
mod error;
pub mod filter_3d;
mod fit;
mod history;
pub mod loss;
mod memory;
mod optimised_gaussians;
mod random;
mod record;
mod schedule;
mod score;
pub mod start;
mod time;
mod view;

pub use adam::Adam;
pub use budget::{Budget, Deadline};
pub use config::{Background, FitConfig, Rates, Strategy};
pub use device::FitDevice;
pub use error::{Diagnosis, FitError, StopReason};
pub use fit::Fit;
pub use history::{History, LastSteps, StepRecord};
pub use optimised_gaussians::OptimisedGaussians;
pub use record::{Correction, FitInputs, FitRecord, FitReport};
pub use schedule::Schedule;
pub use score::{Evaluation, MeanScore, ScaleEvaluation, Score, nearest_view_psnr};
pub use time::Elapsed;
pub use view::{TrainingView, TrainingViews, camera_extent};
