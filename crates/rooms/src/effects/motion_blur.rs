//! Motion blur: samples of a pixel are taken at different times while the shutter is open.

use super::{Conditions, Effect, EffectKind, SceneContext};

#[derive(Debug)]
pub(super) struct MotionBlur {
    shutter: f64,
}

/// Largest motion in an image 256 pixels wide that counts as still, in pixels.
const STILL: f64 = 0.1;

pub(super) fn needed_by(case: &SceneContext<'_>) -> Option<String> {
    let smears = case.shots.windows(2).map(|pair| {
        let [from, to] = [&pair[0], &pair[1]].map(|shot| shot.camera.camera_from_world.inverse());
        let turn = from.forward().angle_between(to.forward());
        // A camera comes about half a metre close to objects.
        let parallax = (to.centre() - from.centre()).cross(from.forward()).length() / 0.5;
        (turn + parallax) * pair[0].camera.intrinsics.fx * 256.0 * case.conditions.shutter
    });
    let largest = smears.fold(0.0, |largest: f64, smear| if smear > largest { smear } else { largest });
    (largest > STILL).then(|| format!("up to {:.1} % of the image width while the shutter is open", largest / 2.56))
}

impl MotionBlur {
    pub(super) const fn new(conditions: &Conditions) -> Self {
        Self { shutter: conditions.shutter }
    }
}

impl Effect for MotionBlur {
    fn kind(&self) -> EffectKind {
        EffectKind::MotionBlur
    }

    fn shutter(&self) -> Option<f64> {
        Some(self.shutter)
    }
}
