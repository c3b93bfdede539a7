use glam::{DVec2, DVec3};

use super::composite::hits;
use super::project::Splat;
use crate::RenderOptions;
use crate::constants::ClampedGradient;
use crate::rendering::PixelGradient;

/// Derivatives of the loss by what a [`Splat`] is made of.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SplatGradient {
    pub(crate) centre: DVec2,
    pub(crate) conic: DVec3,
    pub(crate) opacity: f64,
    pub(crate) rgb: DVec3,
    pub(crate) depth: f64,
    pub(crate) scalar: f64,
}

/// Adds one pixel's derivatives to its splats'; returns those by the background.
///
/// With weights `wᵢ = αᵢ Tᵢ`, an image `Σ wᵢ fᵢ + T b` changes with `αᵢ` by `Tᵢ fᵢ − (Σ_{j>i} wⱼ fⱼ + T b) / (1 − αᵢ)`.
pub(super) fn composite(
    splats: &[Splat],
    at: [u32; 2],
    options: &RenderOptions,
    image: &PixelGradient<f64>,
    of_splats: &mut [SplatGradient],
) -> [f64; 3] {
    let (hits, last) = hits(splats, at, options);
    let by_rgb = DVec3::from_array(image.rgb);
    let background = DVec3::from_array(options.background);
    // What lies behind the current splat, weighted by the images' derivatives; alpha's background is −1.
    let mut behind = last * (background.dot(by_rgb) - image.alpha);
    for hit in hits.iter().rev() {
        let (Some(splat), Some(sum)) = (splats.get(hit.splat), of_splats.get_mut(hit.splat)) else { continue };
        let weight = hit.alpha * hit.transmittance;
        sum.rgb += weight * by_rgb;
        sum.depth += weight * image.depth;
        sum.scalar += weight * image.scalar;
        let mut seen = splat.rgb.dot(by_rgb) + splat.depth * image.depth;
        if !options.gradients.scalar_stops {
            seen += splat.scalar * image.scalar;
        }
        let by_alpha = hit.transmittance * seen - behind / (1.0 - hit.alpha);
        behind += weight * seen;

        if hit.saturated && options.constants.clamped_gradient == ClampedGradient::Exact {
            continue;
        }
        let by_exponent = -splat.opacity * hit.falloff * by_alpha;
        let DVec2 { x: dx, y: dy } = hit.offset;
        sum.opacity += hit.falloff * by_alpha;
        sum.conic += by_exponent * DVec3::new(0.5 * dx * dx, dx * dy, 0.5 * dy * dy);
        let slope = DVec2::new(splat.conic.x * dx + splat.conic.y * dy, splat.conic.y * dx + splat.conic.z * dy);
        sum.centre -= by_exponent * slope;
    }
    (by_rgb * last).to_array()
}
