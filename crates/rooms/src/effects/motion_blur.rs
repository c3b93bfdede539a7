//! Samples of one pixel are taken at different times while the shutter is open.

use super::{Case, Conditions, Effect, EffectKind};

#[derive(Debug)]
pub(super) struct MotionBlur {
    shutter: f64,
}

/// Smear below which a picture 256 pixels wide counts as still, in pixels.
const STILL: f64 = 0.1;

pub(super) fn called_for(case: &Case<'_>) -> Option<String> {
    let smears = case.shots.windows(2).map(|pair| match pair {
        [a, b] => {
            let (from, to) = (a.camera.camera_from_world.inverse(), b.camera.camera_from_world.inverse());
            let turn = from.forward().angle_between(to.forward());
            // Half a metre is as near as a camera comes to anything.
            let parallax = (to.centre() - from.centre()).cross(from.forward()).length() / 0.5;
            (turn + parallax) * a.camera.intrinsics.fx * 256.0 * case.conditions.shutter
        }
        _ => 0.0,
    });
    let largest = smears.fold(0.0, |held: f64, smear| if smear > held { smear } else { held });
    (largest > STILL).then(|| format!("up to {largest:.1} of 256 pixels while the shutter is open"))
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
