//! How the number of Gaussians changes during an optimisation; one file per strategy.

mod adaptive;
mod growth_warning;
mod mcmc;

use atsplat_splat::{Gradients, SplatError};
use serde::{Deserialize, Serialize};

use crate::random::Purpose;
use crate::{OptimisedGaussians, Schedule, StopReason};

pub use adaptive::Adaptive;
pub use mcmc::{Mcmc, relocated};

/// A strategy of density control, called once per step.
pub trait DensityControl: std::fmt::Debug + Send {
    /// Adds the gradients of its regularisers; returns their sum.
    fn regularise(&self, _scene: &OptimisedGaussians, _gradients: &mut Gradients<f32>) -> f64 {
        0.0
    }

    /// Accumulates statistics of a step's gradients, which are finite.
    fn observe(&mut self, _view: &ViewGradients<'_>) {}

    /// Changes the scene after the optimiser's update of a step.
    ///
    /// # Errors
    /// [`DensityError`]; the number of Gaussians is then unchanged.
    fn after_step(&mut self, scene: &mut OptimisedGaussians, context: &StepContext) -> Result<Changes, DensityError>;

    /// What it remembers from step to step, by name, one value per Gaussian: part of a checkpoint.
    fn state(&self) -> Vec<(&'static str, Vec<f32>)> {
        Vec::new()
    }

    /// Restores [`Self::state`]: all of it, in the same order.
    fn restore_state(&mut self, _state: Vec<Vec<f32>>) {}
}

/// No density control: the initial Gaussians are refined.
#[derive(Clone, Copy, Debug)]
pub struct Fixed;

impl DensityControl for Fixed {
    fn after_step(&mut self, _scene: &mut OptimisedGaussians, _context: &StepContext) -> Result<Changes, DensityError> {
        Ok(Changes::default())
    }
}

/// The result of one view's backward pass for the Gaussians.
#[derive(Clone, Copy, Debug)]
pub struct ViewGradients<'a> {
    /// Indices of the Gaussians that are drawn.
    pub drawn: &'a [u32],
    /// Gradient of the loss with respect to the projected means, in pixels; or sums of its absolute values over pixels.
    pub means_2d: &'a [[f32; 2]],
    /// Width and height of the image in pixels.
    pub size: [f64; 2],
    /// Number of Gaussians.
    pub count: usize,
}

/// Which step it is, and what the strategies need to know of the run.
#[derive(Clone, Copy, Debug)]
pub struct StepContext {
    /// Counted from 1.
    pub step: u64,
    /// When things happen.
    pub schedule: Schedule,
    /// The scene's extent, in the unit of length of the views.
    pub extent: f64,
    /// Learning rate of the means in scene units.
    pub means_rate: f64,
    /// Whether the background is white.
    pub white: bool,
    /// Seed of the run.
    pub seed: u64,
    /// Largest number of Gaussians.
    pub limit: usize,
}

impl StepContext {
    fn stream(&self, purpose: Purpose) -> atsplat_numeric::SplitMix64 {
        crate::random::stream(self.seed, purpose, self.step)
    }
}

/// What a call changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Changes {
    /// Gaussians that were cloned.
    pub cloned: usize,
    /// Gaussians that were replaced by two smaller ones.
    pub split: usize,
    /// Gaussians that were removed.
    pub pruned: usize,
    /// Gaussians that were moved to others.
    pub relocated: usize,
    /// Gaussians that were added to others.
    pub added: usize,
    /// Whether the opacities were reset.
    pub reset: bool,
}

impl Changes {
    /// Whether Gaussians were added, removed or moved.
    pub const fn affect_gaussians(&self) -> bool {
        self.cloned + self.split + self.pruned + self.relocated + self.added > 0
    }
}

/// Why the density cannot change.
#[derive(Debug)]
pub enum DensityError {
    /// The result would be useless.
    Stop(StopReason),
    /// The Gaussians cannot be changed.
    Splat(SplatError),
}

impl From<SplatError> for DensityError {
    fn from(error: SplatError) -> Self {
        Self::Splat(error)
    }
}
