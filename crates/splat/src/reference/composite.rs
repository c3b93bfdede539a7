use glam::DVec2;

use super::project::Splat;
use crate::{RenderOptions, Rendering, View};

/// Centres of all pixels, row by row.
pub(super) fn pixel_centres(view: &View) -> impl Iterator<Item = [u32; 2]> {
    let (width, height) = (view.size.width, view.size.height);
    (0..height).flat_map(move |row| (0..width).map(move |column| [column, row]))
}

/// What one splat does at one pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    /// Among the splats.
    pub(super) splat: usize,
    /// From the projected centre to the pixel's.
    pub(super) offset: DVec2,
    /// `exp(−½ dᵀ Σ⁻¹ d)`.
    pub(super) falloff: f64,
    pub(super) alpha: f64,
    /// Whether `max_alpha` cut it.
    pub(super) saturated: bool,
    /// What came through everything in front.
    pub(super) transmittance: f64,
}

/// The splats that a pixel shows, nearest first, and the transmittance behind the last.
pub(super) fn hits(splats: &[Splat], at: [u32; 2], options: &RenderOptions) -> (Vec<Hit>, f64) {
    let constants = &options.constants;
    let mut transmittance = 1.0;
    let mut hits = Vec::new();
    for (index, splat) in splats.iter().enumerate() {
        let Some((offset, falloff)) = falloff(splat, at) else { continue };
        let full = splat.opacity * falloff;
        let saturated = full > constants.max_alpha;
        let alpha = if saturated { constants.max_alpha } else { full };
        if !(alpha >= constants.min_alpha) {
            continue;
        }
        let next = transmittance * (1.0 - alpha);
        if next <= constants.min_transmittance {
            break;
        }
        hits.push(Hit { splat: index, offset, falloff, alpha, saturated, transmittance });
        transmittance = next;
    }
    (hits, transmittance)
}

/// From a splat's centre to a pixel's, and `exp(−½ dᵀ Σ⁻¹ d)`; `None` beyond its reach.
pub(super) fn falloff(splat: &Splat, [column, row]: [u32; 2]) -> Option<(DVec2, f64)> {
    let [columns, rows] = splat.reach;
    if !(columns[0]..columns[1]).contains(&column) || !(rows[0]..rows[1]).contains(&row) {
        return None;
    }
    let offset = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5) - splat.centre;
    let exponent = 0.5 * (splat.conic.x * offset.x * offset.x + splat.conic.z * offset.y * offset.y)
        + splat.conic.y * offset.x * offset.y;
    // Never negative but for rounding.
    let exponent = if exponent < 0.0 { 0.0 } else { exponent };
    Some((offset, (-exponent).exp()))
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
        let Some(splat) = splats.get(hit.splat) else { continue };
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
    let put = |image: &mut [f64], value| image.get_mut(pixel).into_iter().for_each(|slot| *slot = value);
    rendering.rgb.get_mut(pixel).into_iter().for_each(|slot| *slot = rgb);
    put(&mut rendering.alpha, 1.0 - transmittance);
    for (image, value) in
        [(&mut rendering.depth, depth), (&mut rendering.scalar, scalar), (&mut rendering.median_depth, median)]
    {
        if let Some(image) = image {
            put(image, value);
        }
    }
}
