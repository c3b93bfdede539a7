use std::time::Instant;

use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
use atsplat_model::budget::Budget;
use atsplat_model::network::{Device, Network, StageSeconds, Views};
use atsplat_model::{ImageSize, ModelConfig, ModelError};
use glam::{DMat3, DVec3};

use crate::timing::memory;

/// The measurements of a run.
#[derive(Debug)]
pub struct MeasuredBudget {
    /// Counts of tokens and Gaussians.
    pub budget: Budget,
    /// Seconds of each stage.
    pub seconds: StageSeconds,
    /// Seconds of building the network and the input views, which are not part of `seconds`.
    pub build_secs: f64,
    /// Peak memory of the process in bytes, if known.
    pub peak_bytes: Option<u64>,
}

/// Runs networks, and keeps the last one: many rows of a table differ only in their views.
#[derive(Debug)]
pub struct BudgetMeasurer {
    network: Option<Network>,
    device: Device,
}

impl BudgetMeasurer {
    /// Runs networks on this device.
    pub const fn new(device: Device) -> Self {
        Self { network: None, device }
    }

    /// Runs the network with random weights: the counts are real, the quality is not.
    ///
    /// # Errors
    /// [`ModelError`] if the input does not fit the configuration.
    pub fn run(&mut self, config: &ModelConfig, views: usize, size: ImageSize) -> Result<MeasuredBudget, ModelError> {
        let start = Instant::now();
        let kept = self.network.take().filter(|network| network.config() == config);
        let is_peak_reset = memory::reset_peak();
        let network = match kept {
            Some(network) => network,
            None => Network::new(config, &self.device)?,
        };
        let views = synthetic(views, size)?;
        let build_secs = start.elapsed().as_secs_f64();
        let made = network.reconstruct(&views, 0)?;
        self.network = Some(network);
        let peak_bytes = memory::peak_bytes().filter(|_| is_peak_reset);
        Ok(MeasuredBudget { budget: made.budget, seconds: made.seconds, build_secs, peak_bytes })
    }
}

/// A smooth pattern, seen by cameras along a line.
fn synthetic(count: usize, size: ImageSize) -> Result<Views, ModelError> {
    const RGB: usize = 3;
    const PERIOD: usize = 251;
    let samples = count.saturating_mul(size.height).saturating_mul(size.width).saturating_mul(RGB);
    let images = (0..samples).map(|at| (at % PERIOD) as f32 / PERIOD as f32).collect();
    Views::new(size, images, (0..count).map(camera_on_a_line).collect())
}

#[expect(clippy::expect_used, reason = "the identity rotation and intrinsics of 58 degrees are valid")]
fn camera_on_a_line(view: usize) -> Camera {
    let centre = DVec3::new(0.2 * view as f64, 0.0, 0.0);
    let pose = WorldFromCamera::new(DMat3::IDENTITY, centre).expect("an identity rotation");
    let intrinsics = NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).expect("positive focal lengths");
    Camera::pinhole(pose.inverse(), intrinsics)
}
