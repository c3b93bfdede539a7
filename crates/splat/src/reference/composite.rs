use glam::DVec2;

use super::project::Splat;
use crate::{RenderOptions, Rendering, View};

/// Columns and rows of all pixels, row-major.
pub(super) fn pixels(view: &View) -> impl Iterator<Item = [u32; 2]> {
    let (width, height) = (view.size.width, view.size.height);
    (0..height).flat_map(move |row| (0..width).map(move |column| [column, row]))
}

/// The contribution of one splat to one pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    /// Index of the splat.
    pub(super) splat: usize,
    /// From the projected centre to the pixel centre.
    pub(super) offset: DVec2,
    /// `exp(−½ dᵀ Σ⁻¹ d)`.
    pub(super) falloff: f64,
    pub(super) alpha: f64,
    /// Whether it was clamped to `max_alpha`.
    pub(super) saturated: bool,
    /// Transmittance in front of the splat.
    pub(super) transmittance: f64,
}

/// The splats composited at a pixel, nearest first, and the final transmittance.
pub(super) fn hits(splats: &[Splat], at: [u32; 2], options: &RenderOptions) -> (Vec<Hit>, f64) {
    let limits = options.constants.thresholds();
    let mut transmittance = 1.0;
    let mut hits = Vec::new();
    for (index, splat) in splats.iter().enumerate() {
        let Some((offset, falloff)) = falloff(splat, at) else { continue };
        let full = splat.opacity * falloff;
        let saturated = full > limits.max_alpha;
        let alpha = if saturated { limits.max_alpha } else { full };
        if !(alpha >= limits.min_alpha) {
            continue;
        }
        let next = transmittance * (1.0 - alpha);
        if next <= limits.min_transmittance {
            break;
        }
        hits.push(Hit { splat: index, offset, falloff, alpha, saturated, transmittance });
        transmittance = next;
    }
    (hits, transmittance)
}

/// Offset from a splat's centre to a pixel centre, and `exp(−½ dᵀ Σ⁻¹ d)`; `None` outside its reach.
pub(super) fn falloff(splat: &Splat, [column, row]: [u32; 2]) -> Option<(DVec2, f64)> {
    let [columns, rows] = splat.reach;
    if !(columns[0]..columns[1]).contains(&column) || !(rows[0]..rows[1]).contains(&row) {
        return None;
    }
    let offset = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5) - splat.centre;
    Some((offset, (-0.5 * splat.whitened(offset).length_squared()).exp()))
}

/// Composites one pixel into a rendering.
pub(super) fn composite(
    splats: &[Splat],
    at: [u32; 2],
    options: &RenderOptions,
    pixel: usize,
    rendering: &mut Rendering<f64>,
) {
    let (hits, transmittance) = hits(splats, at, options);
    let mut rgb = options.background.map(|channel| channel * transmittance);
    let (mut depth, mut scalar, mut median) = (0.0, 0.0, 0.0);
    for hit in hits {
        let splat = &splats[hit.splat];
        let weight = hit.alpha * hit.transmittance;
        for (sum, channel) in rgb.iter_mut().zip(splat.rgb.to_array()) {
            *sum += weight * channel;
        }
        depth += weight * splat.depth;
        scalar += weight * splat.scalar;
        if hit.transmittance > 0.5 && hit.transmittance * (1.0 - hit.alpha) <= 0.5 {
            median = splat.depth;
        }
    }
    rendering.rgb[pixel] = rgb;
    rendering.alpha[pixel] = 1.0 - transmittance;
    for (image, value) in
        [(&mut rendering.depth, depth), (&mut rendering.scalar, scalar), (&mut rendering.median_depth, median)]
    {
        if let Some(image) = image {
            image[pixel] = value;
        }
    }
}
