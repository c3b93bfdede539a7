//! Discontinuities of an image: pixels where an alpha or transmittance is so close to a threshold that an error of a
//! given size may cross it, and how far these pixels may then jump.

use super::composite::{falloff, pixels};
use super::prepare;
use crate::{Gaussians, RenderOptions, RendererConstants, SplatError, View};

/// How far a pixel may jump.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Jump {
    /// Relative to the range of the composited values: 1 for alpha; for colour, the range of the Gaussians' channels
    /// and the background.
    pub share: f64,
    /// Whether the Gaussian at which the transmittance crosses one half may change.
    pub median: bool,
}

/// The jumps of all pixels, row-major, if alphas have a relative error of up to `relative`.
///
/// A Gaussian that appears or vanishes at `min_alpha` changes a value by at most its weight times the range; a pixel
/// that stops earlier or later, by its transmittance times the range.
///
/// # Errors
/// As [`super::render`].
pub fn jumps(
    gaussians: &Gaussians,
    view: &View,
    options: &RenderOptions,
    relative: f64,
) -> Result<Vec<Jump>, SplatError> {
    options.check()?;
    // Includes Gaussians just below the threshold.
    let min_alpha = options.constants.min_alpha * (1.0 - relative);
    let constants = RendererConstants { min_alpha, ..options.constants.clone() };
    let (splats, _) = prepare(gaussians, view, &RenderOptions { constants, ..options.clone() })?;
    let limits = options.constants.thresholds();
    let is_near = |value: f64, limit: f64, relative: f64| (value - limit).abs() <= relative * limit;
    let of_pixel = |at| {
        let mut jump = Jump::default();
        // The transmittance and its relative error.
        let (mut transmittance, mut relative_error) = (1.0, 0.0);
        for splat in &splats {
            let Some((_, falloff)) = falloff(splat, at) else { continue };
            let full = splat.opacity * falloff;
            let alpha = if full > limits.max_alpha { limits.max_alpha } else { full };
            let is_edge = is_near(alpha, limits.min_alpha, relative);
            if !is_edge && !(alpha >= limits.min_alpha) {
                continue;
            }
            let next = transmittance * (1.0 - alpha);
            let error = if is_edge { alpha } else { alpha * relative };
            relative_error += error / (1.0 - alpha);
            if is_edge {
                jump.share += alpha * transmittance * (1.0 + relative_error);
            }
            if is_near(next, limits.min_transmittance, relative_error) {
                jump.share += transmittance;
                jump.median |= transmittance > 0.5;
                break;
            }
            if next <= limits.min_transmittance {
                break;
            }
            jump.median |= is_near(next, 0.5, relative_error);
            transmittance = next;
        }
        jump
    };
    Ok(pixels(view).map(of_pixel).collect())
}
