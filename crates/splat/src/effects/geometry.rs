//! What a change of shapes, places and opacities on the screen can change in a picture.
//!
//! With every opacity multiplied by `1 ± ε`, a composited value moves by at most `ε/(1 − ε)` times the spread of what
//! is composited: along the way its derivative is `Σ Tᵢ αᵢ εᵢ (cᵢ − behindᵢ)`, and `Σ Tᵢ αᵢ ≤ 1`. That holds while no
//! opacity crosses a cut-off, at which a pixel jumps by up to `min_alpha` whatever ε is. So ε must stay within
//! [`ROUNDING`], where the cut-offs of any two backends differ too.

use atsplat_numeric::Extremes as _;
use glam::DVec2;
use rayon::prelude::*;

use super::Request;
use crate::constants::Extent;
use crate::reference::project::{Outcome, Splat, project};
use crate::view::Optics;
use crate::{Gaussians, RendererConstants};

/// Relative change of an opacity that f32 makes in an exponent of up to `ln 255` anyway.
pub(super) const ROUNDING: f64 = 1.0 / (1 << 18) as f64;

/// Largest change of a picture where Gaussians are projected as for `after` instead of `before`.
///
/// # Errors
/// Why it is more than `budget`, or cannot be told, in words.
pub(super) fn change(gaussians: &Gaussians, before: &Request, after: &Request, budget: f64) -> Result<f64, String> {
    let optics = |request: &Request| request.view.optics(&request.options.constants);
    let (Ok(optics_before), Ok(optics_after)) = (optics(before), optics(after)) else {
        return Err("the view cannot be rendered, which rendering tells".to_owned());
    };
    let pair = Pair { gaussians, before: (before, &optics_before), after: (after, &optics_after) };
    let background = before.options.background;
    let mut relative = 0.0;
    let mut span = background
        .into_iter()
        .fold([0.0; 2], |[low, high], channel| [low.minimum_of(channel), high.maximum_of(channel)]);
    for positions in growing(gaussians.len()) {
        let apart: Vec<Apart> = positions.clone().into_par_iter().map(|position| pair.apart(position)).collect();
        for (position, apart) in positions.zip(apart) {
            match apart {
                Apart::Same => {}
                Apart::Culled => return Err("without it other Gaussians are culled, or for other reasons".to_owned()),
                Apart::By { opacity, brightest } if opacity <= ROUNDING => {
                    relative = opacity.maximum_of(relative);
                    span[1] = brightest.maximum_of(span[1]);
                }
                Apart::By { opacity, .. } => {
                    return Err(format!(
                        "it changes opacities, Gaussian {position}'s by up to {:.2} %",
                        100.0 * opacity
                    ));
                }
            }
        }
    }
    let spread = (span[1] - span[0]) * before.gain();
    let bound = relative / (1.0 - relative) * spread.maximum_of(1.0);
    if bound <= budget { Ok(bound) } else { Err(format!("it may change a pixel by {bound:.2e}")) }
}

/// All positions in ever larger steps: an objection is mostly found at once.
fn growing(count: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
    const FIRST: usize = 256;
    let mut past = 0;
    std::iter::from_fn(move || {
        let from = past;
        past = (from + if from == 0 { FIRST } else { from }).min(count);
        (from < past).then_some(from..past)
    })
}

/// The same Gaussians, projected in two ways.
struct Pair<'a> {
    gaussians: &'a Gaussians,
    before: (&'a Request, &'a Optics),
    after: (&'a Request, &'a Optics),
}

/// How the two projections of a Gaussian differ.
enum Apart {
    Same,
    /// One of them is not drawn, both for other reasons, or what they may reach differs by tiles.
    Culled,
    By {
        /// Relative change of its opacity at any pixel that shows it.
        opacity: f64,
        /// Its largest channel.
        brightest: f64,
    },
}

impl Pair<'_> {
    fn apart(&self, position: usize) -> Apart {
        let [before, after] = [self.before, self.after]
            .map(|(request, optics)| project(self.gaussians, position, optics, request.view.size, &request.options));
        let constants = &self.before.0.options.constants;
        match (&before, &after) {
            (Outcome::Drawn(a), Outcome::Drawn(b)) if constants.extent == Extent::Exact || a.reach == b.reach => {
                Apart::By { opacity: relative_change(a, b, constants), brightest: a.rgb.max_element() }
            }
            (Outcome::Drawn(_), _) | (_, Outcome::Drawn(_)) => Apart::Culled,
            _ if std::mem::discriminant(&before) == std::mem::discriminant(&after) => Apart::Same,
            _ => Apart::Culled,
        }
    }
}

/// Relative change of opacity over the pixels where either splat passes `min_alpha`.
fn relative_change(a: &Splat, b: &Splat, constants: &RendererConstants) -> f64 {
    // What the pixels that only `b` passes lie beyond `a`'s own, while the two differ by less than this.
    const MARGIN: f64 = 1e-3;
    let offset = b.centre - a.centre;
    let shift = norm(a, offset);
    // The largest eigenvalue of C⁻¹(C' − C): how much the quadratic form changes.
    let change = b.conic - a.conic;
    let determinant = a.conic.x * a.conic.z - a.conic.y * a.conic.y;
    let trace = (a.conic.z * change.x + a.conic.x * change.z - 2.0 * a.conic.y * change.y) / determinant;
    let product = (change.x * change.z - change.y * change.y) / determinant;
    let stretch = 0.5 * trace.abs() + (0.25 * trace * trace - product).maximum_of(0.0).sqrt();
    if !(shift <= MARGIN && stretch <= MARGIN) {
        return f64::INFINITY;
    }
    let cut = |splat: &Splat| (2.0 * (splat.opacity / constants.min_alpha).ln()).maximum_of(0.0).sqrt();
    let farthest = cut(a).maximum_of(cut(b)) * (1.0 + MARGIN) + MARGIN;
    let exponent = 0.5 * (farthest * farthest * stretch + (2.0 * farthest + shift) * shift * (1.0 + stretch));
    let ratio = (b.opacity / a.opacity).maximum_of(a.opacity / b.opacity);
    ratio * exponent.exp() - 1.0
}

/// Length in standard deviations.
fn norm(splat: &Splat, offset: DVec2) -> f64 {
    let DVec2 { x, y } = offset;
    (splat.conic.x * x * x + 2.0 * splat.conic.y * x * y + splat.conic.z * y * y).maximum_of(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_cover_everything_once() {
        for count in [0, 1, 255, 256, 257, 5000] {
            let positions: Vec<usize> = growing(count).flatten().collect();
            assert_eq!(positions, (0..count).collect::<Vec<_>>());
        }
    }
}
