//! Automatic exposure: a slow oscillation of the gain along the path.

use atsplat_numeric::unit_of_bits;
use glam::Vec3;

use super::{Conditions, SceneContext};
use crate::path::Shot;
use crate::rng::mix;

#[derive(Debug)]
pub(super) struct ExposureDrift {
    stops: f64,
    phase: f64,
    per_second: f64,
}

pub(super) fn needed_by(scene: &SceneContext<'_>) -> Option<String> {
    let stops = scene.conditions.drift;
    (stops > 0.0).then(|| format!("the exposure swings by ±{stops:.2} stops"))
}

impl ExposureDrift {
    pub(super) fn new(conditions: &Conditions) -> Self {
        let draw = |salt: u64| unit_of_bits(mix(conditions.seed ^ salt));
        Self { stops: conditions.drift, phase: draw(21) * std::f64::consts::TAU, per_second: 0.5 + draw(22) }
    }

    /// Light at the exposure of a shot.
    #[expect(clippy::cast_possible_truncation, reason = "a gain near 1")]
    pub(super) fn exposed(&self, shot: &Shot, light: Vec3) -> Vec3 {
        let seconds = shot.timestamp_micros as f64 * 1e-6;
        light * (self.stops * (self.phase + self.per_second * seconds).sin()).exp2() as f32
    }
}
