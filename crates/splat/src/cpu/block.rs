//! What compositing and its derivative share: blocks of pixels, one vector each.

use std::ops::Range;

use pulp::Simd;

use super::narrowed;
use super::project::Splat;
use crate::RendererConstants;

/// Splats that are read at a time: 4 KiB.
pub(super) const BATCH: usize = 64;

/// Columns and rows of the block of pixels that one vector holds.
#[inline(always)]
pub(super) const fn block_size<S: Simd>() -> [usize; 2] {
    if S::F32_LANES >= 8 { [4, S::F32_LANES / 4] } else { [S::F32_LANES, 1] }
}

/// Copies a batch of splats: its loads wait for memory together, not one after the other.
#[inline(always)]
pub(super) fn read_batch<'a>(batch: &'a mut [Splat; BATCH], indices: &[u32], splats: &[Splat]) -> &'a [Splat] {
    for (slot, index) in batch.iter_mut().zip(indices) {
        *slot = splats.get(*index as usize).copied().unwrap_or_default();
    }
    batch.get(..indices.len()).unwrap_or_default()
}

/// Where the blocks of a tile lie.
pub(super) struct Grid<S: Simd> {
    side: usize,
    block: [usize; 2],
    left: usize,
    top: usize,
    /// Blocks in a row of them.
    pub(super) across: usize,
    lane_x: S::f32s,
    lane_y: S::f32s,
}

impl<S: Simd> Grid<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, side: usize, at: (usize, usize)) -> Self {
        let block = block_size::<S>();
        let lanes = |of: fn(usize, usize) -> usize| {
            let mut values = [0.0f32; 64];
            for (lane, value) in values.iter_mut().take(S::F32_LANES).enumerate() {
                *value = of(lane, block[0]) as f32;
            }
            first::<S>(&values, simd)
        };
        Self {
            side,
            block,
            left: at.0 * side,
            top: at.1 * side,
            across: side / block[0],
            lane_x: lanes(|lane, width| lane % width),
            lane_y: lanes(|lane, width| lane / width),
        }
    }

    /// Block columns and rows that a splat may reach.
    #[inline(always)]
    pub(super) fn blocks_of(&self, splat: &Splat) -> (Range<usize>, Range<usize>) {
        let along = |[from, past]: [u16; 2], start: usize, length: usize| {
            let from = usize::from(from).saturating_sub(start);
            let past = usize::from(past).saturating_sub(start);
            from / length..(if past < self.side { past } else { self.side }).div_ceil(length)
        };
        (along(splat.reach[0], self.left, self.block[0]), along(splat.reach[1], self.top, self.block[1]))
    }
}

/// A splat's shape in every lane.
pub(super) struct Ellipse<S: Simd> {
    whitener: [S::f32s; 3],
    offset: [S::f32s; 2],
    base: [i32; 2],
    pub(super) opacity: S::f32s,
}

/// What the pixels of a block row share.
pub(super) struct Row<S: Simd> {
    pub(super) dy: S::f32s,
    shear: S::f32s,
    across: S::f32s,
}

impl<S: Simd> Ellipse<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, splat: &Splat) -> Self {
        Self {
            whitener: splat.whitener.map(|value| simd.splat_f32s(value)),
            offset: splat.offset.map(|value| simd.splat_f32s(value)),
            base: splat.base,
            opacity: simd.splat_f32s(splat.opacity),
        }
    }

    #[inline(always)]
    pub(super) fn row(&self, simd: S, grid: &Grid<S>, block_row: usize) -> Row<S> {
        let row = simd.splat_f32s(distance(grid.top + block_row * grid.block[1], self.base[1]));
        let dy = simd.add_f32s(simd.add_f32s(row, grid.lane_y), self.offset[1]);
        let across = simd.mul_f32s(self.whitener[2], dy);
        Row { dy, shear: simd.mul_f32s(self.whitener[1], dy), across: simd.mul_f32s(across, across) }
    }

    /// Distance along x from the centre, and `exp(−½ dᵀ Σ⁻¹ d)`, of a block's pixels.
    #[inline(always)]
    pub(super) fn at(
        &self,
        simd: S,
        grid: &Grid<S>,
        exp2: &Exp2<S>,
        row: &Row<S>,
        block_column: usize,
    ) -> (S::f32s, S::f32s) {
        let column = simd.splat_f32s(distance(grid.left + block_column * grid.block[0], self.base[0]));
        let dx = simd.add_f32s(simd.add_f32s(column, grid.lane_x), self.offset[0]);
        let along = simd.mul_add_e_f32s(self.whitener[0], dx, row.shear);
        (dx, exp2.of_negative(simd, simd.mul_add_e_f32s(along, along, row.across)))
    }
}

/// The thresholds of compositing in every lane.
pub(super) struct Limits<S: Simd> {
    pub(super) max_alpha: S::f32s,
    min_alpha: S::f32s,
    min_transmittance: S::f32s,
}

/// What a splat does to the pixels of a block.
pub(super) struct Passed<S: Simd> {
    /// `α·T`, of hits only where it is used.
    pub(super) weight: S::f32s,
    /// Transmittance behind the splat.
    pub(super) after: S::f32s,
    /// Opaque enough to be drawn.
    pub(super) seen: S::m32s,
    /// The pixel is not finished, and would not be by this.
    pub(super) open: S::m32s,
    /// Both.
    pub(super) hit: S::m32s,
}

impl<S: Simd> Limits<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, constants: &RendererConstants) -> Self {
        let [max_alpha, min_alpha, min_transmittance] =
            [constants.max_alpha, constants.min_alpha, constants.min_transmittance]
                .map(|value| simd.splat_f32s(narrowed(value)));
        Self { max_alpha, min_alpha, min_transmittance }
    }

    #[inline(always)]
    pub(super) fn pass(&self, simd: S, alpha: S::f32s, before: S::f32s) -> Passed<S> {
        let weight = simd.mul_f32s(alpha, before);
        let after = simd.sub_f32s(before, weight);
        let seen = simd.greater_than_or_equal_f32s(alpha, self.min_alpha);
        let open = simd.greater_than_f32s(after, self.min_transmittance);
        Passed { weight, after, seen, open, hit: simd.and_m32s(seen, open) }
    }
}

/// Transmittance after a splat; that of a pixel which the splat would finish is kept with its sign turned.
#[inline(always)]
pub(super) fn passed_on<S: Simd>(simd: S, seen: S::m32s, open: S::m32s, before: S::f32s, after: S::f32s) -> S::f32s {
    let closed = simd.neg_f32s(simd.abs_f32s(before));
    simd.select_f32s(seen, simd.select_f32s(open, after, closed), before)
}

/// Pixels from a splat's base to a pixel; both are below 2³¹.
#[inline(always)]
fn distance(pixel: usize, base: i32) -> f32 {
    (i32::try_from(pixel).unwrap_or(i32::MAX) - base) as f32
}

#[inline(always)]
fn first<S: Simd>(values: &[f32], simd: S) -> S::f32s {
    S::as_simd_f32s(values).0.first().copied().unwrap_or_else(|| simd.splat_f32s(0.0))
}

/// Whether no pixel lets anything through.
#[inline(always)]
pub(super) fn finished<S: Simd>(simd: S, transmittance: &[S::f32s]) -> bool {
    let mut most = simd.splat_f32s(-1.0);
    for value in transmittance {
        most = simd.max_f32s(most, *value);
    }
    simd.reduce_max_f32s(most) <= 0.0
}

/// `2^(−x)` for `x ≥ 0`, to 2 units in the last place down to `2^−20`, below which it is 0: far from denormals,
/// and no opacity that small is ever drawn.
pub(super) struct Exp2<S: Simd> {
    rounder: S::f32s,
    coefficients: [S::f32s; 6],
    one: S::f32s,
    limit: S::f32s,
    mantissa_bits: S::u32s,
}

impl<S: Simd> Exp2<S> {
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        // Minimax on [−½, ½]; the constant term is 1.
        const COEFFICIENTS: [f32; 6] =
            [1.535_336_6e-4, 1.339_887_5e-3, 9.618_437e-3, 5.550_332_5e-2, 2.402_264_8e-1, 6.931_472e-1];
        Self {
            rounder: simd.splat_f32s(12_582_912.0),
            coefficients: COEFFICIENTS.map(|value| simd.splat_f32s(value)),
            one: simd.splat_f32s(1.0),
            limit: simd.splat_f32s(20.0),
            mantissa_bits: simd.splat_u32s(23),
        }
    }

    #[inline(always)]
    fn of_negative(&self, simd: S, x: S::f32s) -> S::f32s {
        let x = simd.neg_f32s(simd.min_f32s(x, self.limit));
        // Adding 1.5·2²³ leaves the nearest integer in the low bits.
        let shifted = simd.add_f32s(x, self.rounder);
        let fraction = simd.sub_f32s(x, simd.sub_f32s(shifted, self.rounder));
        let [c6, c5, c4, c3, c2, c1] = self.coefficients;
        let mut value = simd.mul_add_e_f32s(c6, fraction, c5);
        for coefficient in [c4, c3, c2, c1, self.one] {
            value = simd.mul_add_e_f32s(value, fraction, coefficient);
        }
        let scale = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(shifted), self.mantissa_bits);
        simd.transmute_f32s_u32s(simd.add_u32s(simd.transmute_u32s_f32s(value), scale))
    }
}
