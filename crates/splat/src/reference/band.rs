//! Where a picture is discontinuous: pixels at which an opacity lies so close to a cut-off that an error within a given
//! size takes it across, and how far they may jump then.

use super::composite::{falloff, pixel_centres};
use super::prepare;
use crate::{Gaussians, RenderOptions, RendererConstants, SplatError, View};

/// How far a pixel may jump.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Jump {
    /// As a share of the spread of what is composited: of alpha 1, of colour the range of the Gaussians' channels and
    /// the background.
    pub share: f64,
    /// Whether the Gaussian that blocks half of the light may be another.
    pub median: bool,
}

/// The jumps of all pixels, row by row, where opacities may be off by a share `relative` of themselves.
///
/// A Gaussian that appears or vanishes at `min_alpha` changes a value by at most its weight times the spread; a pixel
/// that finishes earlier or later, by the transmittance that it had.
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
    // Those that are just too faint belong to it.
    let min_alpha = options.constants.min_alpha * (1.0 - relative);
    let constants = RendererConstants { min_alpha, ..options.constants.clone() };
    let (splats, _) = prepare(gaussians, view, &RenderOptions { constants, ..options.clone() })?;
    let limits = &options.constants;
    let is_near = |value: f64, limit: f64, relative: f64| (value - limit).abs() <= relative * limit;
    let of_pixel = |at| {
        let mut jump = Jump::default();
        // How far off the transmittance may be, as a share of itself.
        let (mut transmittance, mut off) = (1.0, 0.0);
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
            off += error / (1.0 - alpha);
            if is_edge {
                jump.share += alpha * transmittance * (1.0 + off);
            }
            if is_near(next, limits.min_transmittance, off) {
                jump.share += transmittance;
                jump.median |= transmittance > 0.5;
                break;
            }
            if next <= limits.min_transmittance {
                break;
            }
            jump.median |= is_near(next, 0.5, off);
            transmittance = next;
        }
        jump
    };
    Ok(pixel_centres(view).map(of_pixel).collect())
}
