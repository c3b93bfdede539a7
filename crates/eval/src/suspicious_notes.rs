//! How the notes of trials begin whose scores are probably those of a mistake, and what tables say about such trials.

use atsplat_splat::files::{SUSPICIOUS_COLOURS, SUSPICIOUS_LOG_SCALES, SUSPICIOUS_OPACITIES};

pub use crate::method::{BROKEN, DRAWN_CLASSIC};

/// Renders are grey.
pub const NO_COLOUR: &str = "renders without colour: ";
/// A change would bring most renders far closer to the ground truth.
pub const RESEMBLES: &str = "renders would be closer to the truth ";
/// All imported images are equal.
pub const REPEATED: &str = "one image for all targets: ";
/// No render is better than one colour.
pub const FLAT: &str = "no better than one flat colour: ";

/// How a suspicious note begins, and what to say of the trials that have it, before "in 2 of 4 trials".
pub const SUSPICIOUS_NOTES: [(&str, &str); 9] = [
    (BROKEN, "broken Gaussians were repaired or not drawn"),
    (DRAWN_CLASSIC, "Gaussians of antialiased training or with 3D filters were drawn in the classic mode"),
    (SUSPICIOUS_OPACITIES, "opacities were read as logits that may be none"),
    (SUSPICIOUS_LOG_SCALES, "scales were read as logarithms that may be none"),
    (SUSPICIOUS_COLOURS, "colours were read as coefficients that may be none"),
    (NO_COLOUR, "renders have no colour"),
    (
        RESEMBLES,
        "renders seem to have other channels, another encoding, other sides or another order than the ground truth",
    ),
    (REPEATED, "all targets have the same image"),
    (FLAT, "no render is better than one flat colour"),
];
