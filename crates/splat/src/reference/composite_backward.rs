use glam::{DVec2, DVec3};

use super::composite::hits;
use super::project::Splat;
use crate::RenderOptions;
use crate::constants::ClampedGradient;
use crate::rendering::PixelGradient;

/// Gradient of the loss with respect to a [`Splat`].
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct SplatGradient {
    pub(crate) centre: DVec2,
    pub(crate) conic: DVec3,
    /// Moments `uu, uv, vv` of the gradient of the exponent over [`Splat::whitened`] offsets: what the conic has, without cancellation
    /// far from the centre.
    pub(crate) moments: DVec3,
    pub(crate) opacity: f64,
    pub(crate) rgb: DVec3,
    pub(crate) depth: f64,
    pub(crate) scalar: f64,
}

/// Adds one pixel's contribution to the gradients of its splats; returns that of the background.
///
/// With weights `wᵢ = αᵢ Tᵢ`, an image `Σ wᵢ fᵢ + T b` has the derivative `Tᵢ fᵢ − (Σ_{j>i} wⱼ fⱼ + T b) / (1 − αᵢ)`
/// with respect to `αᵢ`.
pub(super) fn composite_backward(
    splats: &[Splat],
    at: [u32; 2],
    options: &RenderOptions,
    image: &PixelGradient<f64>,
    d_splats: &mut [SplatGradient],
) -> [f64; 3] {
    let (hits, last) = hits(splats, at, options);
    let d_rgb = DVec3::from_array(image.rgb);
    let background = DVec3::from_array(options.background);
    // Everything behind the current splat, weighted by the image gradients; alpha's background is −1.
    let mut behind = last * (background.dot(d_rgb) - image.alpha);
    for hit in hits.iter().rev() {
        let (splat, sum) = (&splats[hit.splat], &mut d_splats[hit.splat]);
        let weight = hit.alpha * hit.transmittance;
        sum.rgb += weight * d_rgb;
        sum.depth += weight * image.depth;
        sum.scalar += weight * image.scalar;
        let mut d_weight = splat.rgb.dot(d_rgb) + splat.depth * image.depth;
        if !options.gradients.scalar_stops {
            d_weight += splat.scalar * image.scalar;
        }
        let d_alpha = hit.transmittance * d_weight - behind / (1.0 - hit.alpha);
        behind += weight * d_weight;

        if hit.saturated && options.constants.clamped_gradient == ClampedGradient::Exact {
            continue;
        }
        let d_exponent = -splat.opacity * hit.falloff * d_alpha;
        let DVec2 { x: dx, y: dy } = hit.offset;
        sum.opacity += hit.falloff * d_alpha;
        sum.conic += d_exponent * DVec3::new(0.5 * dx * dx, dx * dy, 0.5 * dy * dy);
        let (DVec2 { x: u, y: v }, whitener) = (splat.whitened(hit.offset), splat.whitener);
        sum.moments += d_exponent * DVec3::new(u * u, u * v, v * v);
        sum.centre -= d_exponent * DVec2::new(whitener.x * u, whitener.y * u + whitener.z * v);
    }
    (d_rgb * last).to_array()
}
