use atsplat_camera::ImageSize;
use glam::DVec2;

use crate::RendererConstants;
use crate::constants::Extent;

/// Pixels from the picture's corner to the farthest centre that is drawn. Second moments over pixels are sums of
/// squares of such distances times colours of up to [`crate::LARGEST_CHANNEL`], and have to fit into f32.
const FARTHEST: f64 = 1e10;

/// First and one past the last column, then row, that a Gaussian may reach; `None` where the picture has none of
/// them. `[xx, xy, yy]` is its covariance on the screen, blur included.
///
/// For [`Extent::Exact`] these are the pixels whose centres lie in the box around the ellipse on which opacity
/// falls to `min_alpha`, and whoever composites them still tests each: nothing is lost, little is visited in vain.
///
/// A centre beyond [`FARTHEST`] reaches nothing.
#[inline(always)]
pub(crate) fn reach(
    centre: DVec2,
    [xx, xy, yy]: [f64; 3],
    opacity: f64,
    size: ImageSize,
    constants: &RendererConstants,
) -> Option<[[u32; 2]; 2]> {
    const TILE: f64 = 16.0;
    // Wider than the cut-off by far more than what rounding may move it.
    const SPARE: f64 = 0.01;
    if !(centre.abs().max_element() <= FARTHEST) {
        return None;
    }
    let (first, past) = match constants.extent {
        Extent::Exact => {
            let cut = 2.0 * (opacity / constants.min_alpha).ln();
            let half = DVec2::new((xx * cut).sqrt(), (yy * cut).sqrt()) * (1.0 + SPARE) + SPARE;
            ((centre - half - 0.5).ceil(), (centre + half - 0.5).floor() + 1.0)
        }
        Extent::ThreeSigmaTiles => {
            let middle = 0.5 * (xx + yy);
            let gap = middle * middle - (xx * yy - xy * xy);
            let longest = middle + (if gap > 0.1 { gap } else { 0.1 }).sqrt();
            let radius = (3.0 * longest.sqrt()).ceil();
            // Pixel indices there count from pixel centres.
            let tiles = |value: DVec2| (value / TILE).trunc() * TILE;
            (tiles(centre - 0.5 - radius), tiles(centre - 0.5 + radius + (TILE - 1.0)))
        }
    };
    let span = |first: f64, past: f64, length: u32| {
        let length = f64::from(length);
        let (from, to) = (first.clamp(0.0, length), past.clamp(0.0, length));
        (from < to).then(|| [whole(from), whole(to)])
    };
    Some([span(first.x, past.x, size.width)?, span(first.y, past.y, size.height)?])
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a picture's side, a u32")]
const fn whole(value: f64) -> u32 {
    value as u32
}
