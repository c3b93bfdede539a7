//! Runs a network and measures whether it keeps to its budget.

use std::time::Instant;

use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
use atsplat_model::budget::Budget;
use atsplat_model::network::{Device, Network, StageSeconds, Views};
use atsplat_model::{ImageSize, ModelConfig};
use glam::{DMat3, DVec3};

use crate::process;

/// The measurements of a run.
#[derive(Debug)]
pub(super) struct Measured {
    pub(super) budget: Budget,
    pub(super) seconds: StageSeconds,
    /// Seconds of building the network, which are not part of `seconds`.
    pub(super) making_secs: f64,
    pub(super) peak_bytes: Option<u64>,
}

/// Keeps the last network: many rows of a table differ only in their views.
pub(super) struct Measurer {
    network: Option<Network>,
    device: Device,
}

impl Measurer {
    pub(super) const fn new(device: Device) -> Self {
        Self { network: None, device }
    }

    /// Runs the network with random weights: the counts are real, the quality is not.
    pub(super) fn run(&mut self, config: &ModelConfig, views: usize, size: ImageSize) -> anyhow::Result<Measured> {
        let start = Instant::now();
        let kept = self.network.take().filter(|network| network.config() == config);
        process::forget_peak();
        let network = match kept {
            Some(network) => network,
            None => Network::new(config, &self.device)?,
        };
        let views = synthetic(views, size)?;
        let making_secs = start.elapsed().as_secs_f64();
        let made = network.reconstruct(&views, 0)?;
        self.network = Some(network);
        Ok(Measured { budget: made.budget, seconds: made.seconds, making_secs, peak_bytes: process::peak_bytes() })
    }
}

/// A smooth pattern, seen by cameras along a line.
fn synthetic(count: usize, size: ImageSize) -> anyhow::Result<Views> {
    const RGB: usize = 3;
    const PERIOD: usize = 251;
    let samples = count.saturating_mul(size.height).saturating_mul(size.width).saturating_mul(RGB);
    let pictures = (0..samples).map(|at| (at % PERIOD) as f32 / PERIOD as f32).collect();
    let camera = |view: usize| -> anyhow::Result<Camera> {
        let pose = WorldFromCamera::new(DMat3::IDENTITY, DVec3::new(0.2 * view as f64, 0.0, 0.0))?;
        Ok(Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5)?))
    };
    let cameras: anyhow::Result<Vec<Camera>> = (0..count).map(camera).collect();
    Ok(Views::new(size, pictures, cameras?)?)
}
