//! Where splats are in the image, computed in chunks.

use bytemuck::Zeroable;
use pulp::Simd;

use super::math::log2;
use super::project::Screen;
use super::to_f32;
use super::wide::{CHUNK, Row, Row32, Wide, load2, load3, store2};
use crate::reach::FARTHEST;
use crate::{RendererConstants, View};

/// Image positions of the Gaussians of a [`Screen`].
#[derive(Debug, Zeroable)]
pub(super) struct Footprints {
    /// `log₂(opacity / min_alpha)`.
    pub(super) cut: Row32,
    /// [`super::project::Splat::base`] and [`super::project::Splat::shift`].
    pub(super) base: [Row; 2],
    pub(super) shift: [Row; 2],
    /// Half-open ranges of columns, then of rows; integers.
    ranges: [[Row; 2]; 2],
    squared_radius: Row,
}

impl Footprints {
    #[inline(always)]
    pub(super) fn compute<S: Simd>(&mut self, simd: S, screen: &Screen, view: &View, constants: &RendererConstants) {
        let mut ratios = [0.0f32; CHUNK];
        let per = constants.min_alpha.recip();
        for (ratio, opacity) in ratios.iter_mut().zip(&screen.opacity) {
            *ratio = to_f32(opacity * per);
        }
        for (cut, ratio) in S::as_mut_simd_f32s(&mut self.cut).0.iter_mut().zip(S::as_simd_f32s(&ratios).0) {
            *cut = log2(simd, *ratio);
        }
        for (squared, cut) in self.squared_radius.iter_mut().zip(&self.cut) {
            *squared = 2.0 * std::f64::consts::LN_2 * f64::from(*cut);
        }
        for vector in 0..CHUNK / S::F64_LANES {
            self.reach(simd, screen, view, constants, vector);
            self.base_pixel(simd, screen, view, vector);
        }
    }

    /// The pixels in the bounding box of the ellipse on which alpha falls to `min_alpha`.
    #[inline(always)]
    fn reach<S: Simd>(&mut self, simd: S, screen: &Screen, view: &View, constants: &RendererConstants, vector: usize) {
        // Much larger than any rounding error of the threshold.
        const MARGIN: f64 = 0.01;
        let splat = |value| Wide::splat(simd, value);
        let (zero, half) = (splat(0.0), splat(0.5));
        let squared = Wide::load(simd, &self.squared_radius, vector).clamp(zero, splat(f64::MAX));
        let [columns, rows] = &mut self.ranges;
        let axes = [(0, 0, view.size.width, columns), (1, 2, view.size.height, rows)];
        for (axis, variance, length, range) in axes {
            let length = splat(f64::from(length));
            let centre = Wide::load(simd, &screen.centre[axis], vector);
            let variance = Wide::load(simd, &screen.cov2d[variance], vector) + splat(constants.blur);
            let radius = (variance * squared).sqrt() * splat(1.0 + MARGIN) + splat(MARGIN);
            let first = (centre - radius - half).clamp(zero, length);
            let past = (centre + radius + half).clamp(zero, length);
            store2([-(-first).floor(), past.floor()], range, vector);
        }
    }

    /// The pixel containing the centre, or the nearest one at the image's edge: distances from it to all image pixels are exact in
    /// f32, and small. And the whitened vector to it, computed in f64, which is small too if the Gaussian reaches the image.
    #[inline(always)]
    fn base_pixel<S: Simd>(&mut self, simd: S, screen: &Screen, view: &View, vector: usize) {
        let splat = |value| Wide::splat(simd, value);
        let [across, shear, down] = load3(simd, &screen.whitener, vector);
        let centre = load2(simd, &screen.centre, vector);
        let base = |centre: Wide<S>, length: u32| centre.clamp(splat(0.0), splat(f64::from(length))).floor();
        let base = [base(centre[0], view.size.width), base(centre[1], view.size.height)];
        let x = base[0] + splat(0.5) - centre[0];
        let y = base[1] + splat(0.5) - centre[1];
        store2(base, &mut self.base, vector);
        store2([across * x + shear * y, down * y], &mut self.shift, vector);
    }

    /// Half-open range of columns, then rows, that a Gaussian may reach.
    #[inline(always)]
    pub(super) fn range(&self, screen: &Screen, lane: usize) -> Option<[[u16; 2]; 2]> {
        let lane = lane % CHUNK;
        let near = |centres: &Row| centres[lane].abs() <= FARTHEST;
        if !(near(&screen.centre[0]) & near(&screen.centre[1])) {
            return None;
        }
        let [columns, rows] = &self.ranges;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most the image side")]
        let truncate = |[first, past]: &[Row; 2]| [first[lane] as u16, past[lane] as u16];
        let (columns, rows) = (truncate(columns), truncate(rows));
        (columns[0] < columns[1] && rows[0] < rows[1]).then_some([columns, rows])
    }
}
