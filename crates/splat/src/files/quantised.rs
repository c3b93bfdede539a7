//! Colours and opacities out of bytes.

use crate::sh::C0;

/// The logit of an opacity in [0, 1]; infinite at its ends, which import clamps.
#[expect(clippy::cast_possible_truncation, reason = "logits are stored as f32")]
pub(super) fn logit(opacity: f64) -> f32 {
    (opacity / (1.0 - opacity)).ln() as f32
}

/// The constant coefficient that shows a colour.
#[expect(clippy::cast_possible_truncation, reason = "coefficients are stored as f32")]
pub(super) fn dc(colour: f64) -> f32 {
    ((colour - 0.5) / C0) as f32
}
