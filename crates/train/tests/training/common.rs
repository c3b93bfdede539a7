//! A network so small that a step takes milliseconds, and samples without simulation.

use std::path::Path;

use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
use atsplat_model::ImageSize;
use atsplat_numeric::SplitMix64;
use atsplat_train::samples::{PosedImages, Sample, SampleId, Source};
use atsplat_train::{Start, TrainConfig, TrainError, Trainer};
use glam::{DMat3, DVec3};

pub(crate) const SIZE: ImageSize = ImageSize::new(32, 32);

/// The smallest run; `more` is added to its TOML.
pub(crate) fn config(more: &str) -> TrainConfig {
    let text = format!(
        r#"
title = "tiny"
seed = 3
steps = 12
batch = 2
{more}

[model]
base = "nano"

[model.changes]
resolution = [32, 32]
transformer = {{ dim = 32, head-dim = 16 }}
coarse.layers = 1
fine.layers = 1
head.scale = {{ kind = "exp-clamped", shift = -2.0, max = 0.5 }}

[[data]]
[data.source.rooms]
scenes-of = "rooms"
scenes = 2
size = [32, 32]
samples = 1
stride = 10
cache-mib = 4
views = {{ context = [2, 2], targets = 2, gaps = {{ min = 3, max = 4 }} }}

[schedule]
learning-rate = 1e-3
warm-up-steps = 3

[checkpoints]
every = 4
keep = 2
"#
    );
    TrainConfig::from_toml(&text).unwrap()
}

/// A camera near the origin that looks along +z.
pub(crate) fn camera(x: f64) -> Camera {
    let pose = WorldFromCamera::new(DMat3::from_rotation_y(-0.1 * x), DVec3::new(x, 0.1 * x, 0.0)).unwrap();
    Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.9, 0.9, 0.48, 0.5).unwrap())
}

/// Two context views and two targets of noise, a function of the draw.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Noise {
    /// Changes a sample.
    pub(crate) corrupt: fn(u64, &mut Sample),
}

impl Noise {
    pub(crate) const CLEAN: Self = Self { corrupt: |_, _| () };
}

pub(crate) fn sample(number: u64) -> Sample {
    let posed = |name: &str, places: [f64; 2]| {
        let mut random = SplitMix64::for_scene(number, name);
        let count = 2 * SIZE.height * SIZE.width * 3;
        let images = (0..count).map(|_| random.unit_f32()).collect();
        PosedImages { size: SIZE, images, cameras: places.map(camera).to_vec() }
    };
    Sample {
        name: format!("noise {number}"),
        context: posed("context", [-1.0, 1.0]),
        targets: posed("targets", [-0.3, 0.4]),
        distances: None,
    }
}

impl Source for Noise {
    fn name(&self) -> String {
        "noise".to_owned()
    }

    fn sample(&self, id: SampleId) -> Result<Sample, TrainError> {
        let mut sample = sample(id.number);
        (self.corrupt)(id.number, &mut sample);
        Ok(sample)
    }
}

pub(crate) fn trainer(config: TrainConfig, folder: &Path, start: &Start, source: Noise) -> Trainer {
    Trainer::with_samples(config, Box::new(source), folder, start).unwrap()
}

/// Weights as bits.
pub(crate) fn bits(trainer: &Trainer) -> Vec<Vec<u32>> {
    trainer
        .state()
        .parameters
        .values()
        .iter()
        .map(|values| values.iter().map(|value| value.to_bits()).collect())
        .collect()
}
