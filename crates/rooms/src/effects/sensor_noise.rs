//! Sensor noise: photon noise, whose variance grows with light, over an electronic noise floor. At a light of x, where 1 is white, the
//! standard deviation is σ √(0.1 + x): σ at 0.9, and a little more at white.

use atsplat_numeric::unit_of_bits;
use glam::Vec3;

use super::{Conditions, SceneContext};
use crate::path::Shot;
use crate::rng::mix;

#[derive(Debug)]
pub(super) struct SensorNoise {
    sigma: f64,
    seed: u64,
}

pub(super) fn needed_by(scene: &SceneContext<'_>) -> Option<String> {
    let sigma = scene.conditions.noise;
    (sigma > 0.0).then(|| format!("σ = {sigma:.3} of white, at a light of 0.9"))
}

impl SensorNoise {
    pub(super) const fn new(conditions: &Conditions) -> Self {
        Self { sigma: conditions.noise, seed: mix(conditions.seed ^ 31) }
    }

    /// A pixel's exposed light with noise.
    #[expect(clippy::cast_possible_truncation, reason = "a deviation of a few per cent")]
    pub(super) fn measured(&self, shot: &Shot, pixel: u64, light: Vec3) -> Vec3 {
        let key = mix(self.seed ^ shot.timestamp_micros.cast_unsigned()) ^ pixel;
        // The sum of four uniform numbers is close to normal and has bounded tails.
        let normal = |channel: u64| {
            let draws = (0..4).map(|draw| unit_of_bits(mix(key ^ (channel << 60) ^ (draw << 56)))).sum::<f64>();
            ((draws - 2.0) * 3f64.sqrt() * self.sigma) as f32
        };
        let strength = |light: f32| (0.1 + light.clamp(0.0, f32::MAX)).sqrt();
        let noise = Vec3::new(normal(1), normal(2), normal(3));
        light + noise * Vec3::new(strength(light.x), strength(light.y), strength(light.z))
    }
}
