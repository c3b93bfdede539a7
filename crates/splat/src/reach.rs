use atsplat_camera::ImageSize;
use glam::DVec2;

use crate::RendererConstants;
use crate::constants::Extent;

/// Largest distance in pixels from the image corner to a drawn centre, where f64 rounds a centre to a millionth of a pixel.
pub(crate) const FARTHEST: f64 = 1e10;

/// Half-open range of columns, then rows, that a Gaussian may reach; `None` if it misses the image. `[xx, xy, yy]` is
/// its 2D covariance, blur included.
///
/// For [`Extent::Exact`] these are the pixels with centres in the bounding box of the ellipse on which alpha falls to
/// `min_alpha`; compositing still tests each pixel, so the box may be slightly too large but never too small.
///
/// A centre beyond [`FARTHEST`] reaches no pixel.
#[inline(always)]
pub(crate) fn reach(
    centre: DVec2,
    [xx, xy, yy]: [f64; 3],
    opacity: f64,
    size: ImageSize,
    constants: &RendererConstants,
) -> Option<[[u32; 2]; 2]> {
    const TILE: f64 = 16.0;
    // Much larger than any rounding error of the threshold.
    const MARGIN: f64 = 0.01;
    if !(centre.abs().max_element() <= FARTHEST) {
        return None;
    }
    let (first, past) = match constants.extent {
        Extent::Exact => {
            let cut = 2.0 * (opacity / constants.min_alpha).ln();
            let half = DVec2::new((xx * cut).sqrt(), (yy * cut).sqrt()) * (1.0 + MARGIN) + MARGIN;
            ((centre - half - 0.5).ceil(), (centre + half - 0.5).floor() + 1.0)
        }
        Extent::ThreeSigmaTiles => {
            let middle = 0.5 * (xx + yy);
            let gap = middle * middle - (xx * yy - xy * xy);
            let longest = middle + (if gap > 0.1 { gap } else { 0.1 }).sqrt();
            let radius = (3.0 * longest.sqrt()).ceil();
            // There, integer pixel coordinates are pixel centres.
            let tiles = |value: DVec2| (value / TILE).trunc() * TILE;
            (tiles(centre - 0.5 - radius), tiles(centre - 0.5 + radius + (TILE - 1.0)))
        }
    };
    let span = |first: f64, past: f64, length: u32| {
        let length = f64::from(length);
        let (from, to) = (first.clamp(0.0, length), past.clamp(0.0, length));
        (from < to).then(|| [truncate(from), truncate(to)])
    };
    Some([span(first.x, past.x, size.width)?, span(first.y, past.y, size.height)?])
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the image side, a u32")]
const fn truncate(value: f64) -> u32 {
    value as u32
}
