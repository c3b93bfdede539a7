//! Where splats lie in the picture, many side by side.

use pulp::Simd;

use super::elementary::log2;
use super::narrowed;
use super::project::Screen;
use super::wide::{Row, Row32, SIDE_BY_SIDE, Wide, load2, load3, store2};
use crate::reach::FARTHEST;
use crate::{RendererConstants, View};

/// Where each of the Gaussians on a [`Screen`] lies in one picture.
#[derive(Debug)]
pub(super) struct Places {
    /// `log₂(opacity / min_alpha)`.
    pub(super) cut: Row32,
    /// [`super::splat::Splat::base`] and [`super::splat::Splat::shift`].
    pub(super) base: [Row; 2],
    pub(super) shift: [Row; 2],
    /// First and one past the last, of columns and then rows: whole numbers.
    ranges: [[Row; 2]; 2],
    squared_radius: Row,
}

impl Default for Places {
    fn default() -> Self {
        const ZERO: Row = [0.0; SIDE_BY_SIDE];
        let cut = [0.0; SIDE_BY_SIDE];
        Self { cut, base: [ZERO; 2], shift: [ZERO; 2], ranges: [[ZERO; 2]; 2], squared_radius: ZERO }
    }
}

impl Places {
    #[inline(always)]
    pub(super) fn find<S: Simd>(&mut self, simd: S, screen: &Screen, view: &View, constants: &RendererConstants) {
        let mut ratios = [0.0f32; SIDE_BY_SIDE];
        let per = constants.min_alpha.recip();
        for (ratio, opacity) in ratios.iter_mut().zip(&screen.opacity) {
            *ratio = narrowed(opacity * per);
        }
        for (cut, ratio) in S::as_mut_simd_f32s(&mut self.cut).0.iter_mut().zip(S::as_simd_f32s(&ratios).0) {
            *cut = log2(simd, *ratio);
        }
        for (squared, cut) in self.squared_radius.iter_mut().zip(&self.cut) {
            *squared = 2.0 * std::f64::consts::LN_2 * f64::from(*cut);
        }
        for at in 0..SIDE_BY_SIDE / S::F64_LANES {
            self.reach(simd, screen, view, constants, at);
            self.rest(simd, screen, at);
        }
    }

    /// The pixels in the box around the ellipse on which opacity falls to `min_alpha`.
    #[inline(always)]
    fn reach<S: Simd>(&mut self, simd: S, screen: &Screen, view: &View, constants: &RendererConstants, at: usize) {
        // Wider than the cut-off by far more than what rounding may move it.
        const SPARE: f64 = 0.01;
        let splat = |value| Wide::splat(simd, value);
        let (zero, half) = (splat(0.0), splat(0.5));
        let squared = Wide::load(simd, &self.squared_radius, at).clamp(zero, splat(f64::MAX));
        let [columns, rows] = &mut self.ranges;
        let axes = [(0, 0, view.size.width, columns), (1, 2, view.size.height, rows)];
        for (axis, variance, length, range) in axes {
            let length = splat(f64::from(length));
            let centre = Wide::load(simd, &screen.centre[axis], at);
            let variance = Wide::load(simd, &screen.sharp[variance], at) + splat(constants.blur);
            let radius = (variance * squared).sqrt() * splat(1.0 + SPARE) + splat(SPARE);
            let first = (centre - radius - half).clamp(zero, length);
            let past = (centre + radius + half).clamp(zero, length);
            store2([-(-first).floor(), past.floor()], range, at);
        }
    }

    /// The pixel that a centre lies in, or one within f32's whole numbers of every picture; and the way there.
    #[inline(always)]
    fn rest<S: Simd>(&mut self, simd: S, screen: &Screen, at: usize) {
        const FAR: f64 = (1 << 22) as f64;
        let splat = |value| Wide::splat(simd, value);
        let [across, shear, down] = load3(simd, &screen.whitener, at);
        let centre = load2(simd, &screen.centre, at);
        let base = |centre: Wide<S>| centre.clamp(splat(-FAR), splat(FAR)).floor();
        let base = [base(centre[0]), base(centre[1])];
        let x = base[0] + splat(0.5) - centre[0];
        let y = base[1] + splat(0.5) - centre[1];
        store2(base, &mut self.base, at);
        store2([across * x + shear * y, down * y], &mut self.shift, at);
    }

    /// First and one past the last column, then row, that a Gaussian may reach.
    #[inline(always)]
    pub(super) fn range(&self, screen: &Screen, lane: usize) -> Option<[[u16; 2]; 2]> {
        let lane = lane % SIDE_BY_SIDE;
        let near = |centres: &Row| centres[lane].abs() <= FARTHEST;
        if !(near(&screen.centre[0]) & near(&screen.centre[1])) {
            return None;
        }
        let [columns, rows] = &self.ranges;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within a picture's side")]
        let whole = |[first, past]: &[Row; 2]| [first[lane] as u16, past[lane] as u16];
        let (columns, rows) = (whole(columns), whole(rows));
        (columns[0] < columns[1] && rows[0] < rows[1]).then_some([columns, rows])
    }
}
