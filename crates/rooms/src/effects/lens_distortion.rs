//! Radial distortion in OpenCV's model.

use atsplat_camera::Distortion;

use super::{Conditions, Effect, EffectKind, SceneContext};

#[derive(Debug)]
pub(super) struct LensDistortion {
    lens: Distortion,
}

/// Largest displacement of the corner of an image 256 pixels wide that counts as no distortion, in pixels.
const STRAIGHT: f64 = 0.05;

pub(super) fn needed_by(case: &SceneContext<'_>) -> Option<String> {
    let [k1, k2] = case.conditions.lens;
    let k = case.shots.first()?.camera.intrinsics;
    let squared = (0.5 / k.fx).powi(2) + (0.5 / k.fy).powi(2);
    let moved = (k1 * squared + k2 * squared * squared).abs() * squared.sqrt() * k.fx * 256.0;
    (moved > STRAIGHT)
        .then(|| format!("k1 = {k1:.3}, k2 = {k2:.3} move a corner by {:.1} % of the image width", moved / 2.56))
}

impl LensDistortion {
    pub(super) fn new(conditions: &Conditions) -> Self {
        let [k1, k2] = conditions.lens;
        let straight = k1.abs() + k2.abs() <= 0.0;
        let bent = Distortion::OpenCv { k1, k2, k3: 0.0, p1: 0.0, p2: 0.0 };
        Self { lens: if straight { Distortion::None } else { bent } }
    }
}

impl Effect for LensDistortion {
    fn kind(&self) -> EffectKind {
        EffectKind::LensDistortion
    }

    fn lens(&self) -> Option<Distortion> {
        Some(self.lens)
    }
}
