//! Compositing: block by block, with everything about the block's pixels in registers.

use pulp::{Simd, WithSimd};

use super::Paint;
use super::batch::{BATCH, BLOCK, BLOCKS, Batch, Cell, LANES, Record};
use super::bins::Entry;
use super::elementary::Exp2;
use super::splat::Splat;
use crate::RendererConstants;

/// What is kept of a pixel: transmittance, red, green, blue; and where asked for, depth, scalar, median depth.
///
/// Transmittance has its sign turned where the pixel is finished: no later splat passes the test on it.
pub(super) const fn kept(extra: bool) -> usize {
    if extra { 7 } else { 4 }
}

/// The most vectors that hold a block.
pub(super) const MOST_VECTORS: usize = 4;

/// Composites one cell into `pixels`: block by block, of each what [`kept`] names, 16 pixels of one at a time.
pub(super) struct Composite<'a> {
    pub(super) paint: &'a Paint<'a>,
    /// Places in `list`, or among all splats where there is none.
    pub(super) order: &'a [Entry],
    pub(super) list: Option<&'a [u32]>,
    pub(super) splats: &'a [Splat],
    pub(super) cell: Cell,
    pub(super) batch: &'a mut Batch,
    pub(super) pixels: &'a mut [f32],
}

impl WithSimd for Composite<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // The common case pays nothing for images that nobody asked for.
        if self.paint.extra {
            composite::<S, true, 7>(simd, self);
        } else {
            composite::<S, false, 4>(simd, self);
        }
    }
}

#[inline(always)]
fn composite<S: Simd, const EXTRA: bool, const KEPT: usize>(simd: S, task: Composite<'_>) {
    let Composite { paint, order, list, splats, cell, batch, pixels } = task;
    let grid = Grid::<S>::new(simd);
    let limits = Limits::<S>::new(simd, &paint.options.constants);
    let exp2 = Exp2::new(simd);
    let mut open = clear(pixels, KEPT, cell, paint);
    for entries in order.chunks(BATCH) {
        batch.fill(simd, cell, open, entries, list, splats);
        for (block, pixels) in pixels.chunks_exact_mut(KEPT * LANES).enumerate().take(BLOCKS) {
            let list = batch.list(block);
            if list.is_empty() {
                continue;
            }
            let done = one_block::<S, EXTRA, KEPT>(simd, (&grid, &limits, &exp2), batch, list, cell.at(block), pixels);
            if done {
                open &= !(1 << block);
            }
        }
        if open == 0 {
            break;
        }
    }
}

impl Cell {
    /// Column and row of a block's first pixel, from the cell's.
    #[inline(always)]
    pub(super) const fn at(self, block: usize) -> [usize; 2] {
        [block % self.across * BLOCK, block / self.across * BLOCK]
    }
}

/// Returns whether no pixel lets anything through any more.
#[inline(always)]
fn one_block<S: Simd, const EXTRA: bool, const KEPT: usize>(
    simd: S,
    (grid, limits, exp2): (&Grid<S>, &Limits<S>, &Exp2<S>),
    batch: &Batch,
    list: &[u8],
    at: [usize; 2],
    pixels: &mut [f32],
) -> bool {
    let vectors = vectors::<S>();
    let (zero, half) = (simd.splat_f32s(0.0), simd.splat_f32s(0.5));
    let (stored, _) = S::as_mut_simd_f32s(pixels);
    let mut kept = [[zero; MOST_VECTORS]; KEPT];
    for (values, stored) in kept.iter_mut().zip(stored.chunks_exact(vectors)) {
        for (value, stored) in values.iter_mut().zip(stored) {
            *value = *stored;
        }
    }
    let (x, y) = grid.at(simd, at);
    for number in list {
        let record = batch.record(*number);
        let splat = |value: f32| simd.splat_f32s(value);
        let ellipse = Ellipse::new(simd, record, x);
        let opacity = splat(record.opacity);
        for v in 0..vectors {
            let power = ellipse.power(simd, y[v]).0;
            let alpha = simd.min_f32s(limits.max_alpha, simd.mul_f32s(opacity, exp2.of_negative(simd, power)));
            let before = kept[0][v];
            let Passed { weight, after, hit } = limits.pass(simd, alpha, before);
            if EXTRA {
                let depth = splat(record.depth);
                kept[KEPT - 3][v] = simd.mul_add_e_f32s(weight, depth, kept[KEPT - 3][v]);
                kept[KEPT - 2][v] = simd.mul_add_e_f32s(weight, splat(record.scalar), kept[KEPT - 2][v]);
                let from_above = simd.greater_than_f32s(before, half);
                let to_below = simd.greater_than_or_equal_f32s(half, after);
                let crosses = simd.and_m32s(hit, simd.and_m32s(from_above, to_below));
                kept[KEPT - 1][v] = simd.select_f32s(crosses, depth, kept[KEPT - 1][v]);
            }
            kept[0][v] = after;
            for (channel, value) in record.rgb.iter().enumerate() {
                kept[1 + channel][v] = simd.mul_add_e_f32s(weight, splat(*value), kept[1 + channel][v]);
            }
        }
    }
    for (values, stored) in kept.iter().zip(stored.chunks_exact_mut(vectors)) {
        for (value, stored) in values.iter().zip(stored) {
            *stored = *value;
        }
    }
    let mut most = kept[0][0];
    for value in kept[0].iter().take(vectors).skip(1) {
        most = simd.max_f32s(most, *value);
    }
    simd.reduce_max_f32s(most) <= 0.0
}

/// Vectors that hold a block.
#[inline(always)]
pub(super) const fn vectors<S: Simd>() -> usize {
    LANES / S::F32_LANES
}

/// Starts all pixels: those beyond the picture are finished. Returns a bit for each block that has others.
#[inline(always)]
pub(super) fn clear(pixels: &mut [f32], kept: usize, cell: Cell, paint: &Paint<'_>) -> u64 {
    let inside = |start: usize, length: u32| (length as usize).saturating_sub(start);
    let (width, height) = (inside(cell.left, paint.size.width), inside(cell.top, paint.size.height));
    let mut open = 0;
    for (block, pixels) in pixels.chunks_exact_mut(kept * LANES).enumerate().take(cell.across * cell.across) {
        pixels.fill(0.0);
        let [column, row] = cell.at(block);
        for (lane, transmittance) in pixels.iter_mut().take(LANES).enumerate() {
            let within = column + lane % BLOCK < width && row + lane / BLOCK < height;
            *transmittance = if within { 1.0 } else { -1.0 };
        }
        if column < width && row < height {
            open |= 1 << block;
        }
    }
    open
}

/// Where the pixels of a block lie.
pub(super) struct Grid<S: Simd> {
    x: S::f32s,
    y: [S::f32s; MOST_VECTORS],
}

impl<S: Simd> Grid<S> {
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        let lanes = |of: fn(usize) -> usize| {
            let mut values = [0.0f32; LANES];
            for (lane, value) in values.iter_mut().enumerate() {
                *value = of(lane) as f32;
            }
            let mut vectors = [simd.splat_f32s(0.0); MOST_VECTORS];
            for (vector, values) in vectors.iter_mut().zip(S::as_simd_f32s(&values).0) {
                *vector = *values;
            }
            vectors
        };
        Self { x: lanes(|lane| lane % BLOCK)[0], y: lanes(|lane| lane / BLOCK) }
    }

    /// Of the pixels of a block, from the cell's first.
    #[inline(always)]
    pub(super) fn at(&self, simd: S, [column, row]: [usize; 2]) -> (S::f32s, [S::f32s; MOST_VECTORS]) {
        let row = simd.splat_f32s(row as f32);
        (simd.add_f32s(self.x, simd.splat_f32s(column as f32)), self.y.map(|y| simd.add_f32s(y, row)))
    }
}

/// A splat's shape at a column of pixels.
pub(super) struct Ellipse<S: Simd> {
    /// From the base.
    pub(super) x: S::f32s,
    u: S::f32s,
    whitener: [S::f32s; 2],
    shift: S::f32s,
    from_base: S::f32s,
}

impl<S: Simd> Ellipse<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, record: &Record, x: S::f32s) -> Self {
        let splat = |value: f32| simd.splat_f32s(value);
        let [along, shear, down] = record.whitener;
        let x = simd.add_f32s(x, splat(record.from_base[0]));
        Self {
            x,
            u: simd.mul_add_e_f32s(splat(along), x, splat(record.shift[0])),
            whitener: [splat(shear), splat(down)],
            shift: splat(record.shift[1]),
            from_base: splat(record.from_base[1]),
        }
    }

    /// `½ dᵀ Σ⁻¹ d · log₂e`, and the rows from the base.
    #[inline(always)]
    pub(super) fn power(&self, simd: S, y: S::f32s) -> (S::f32s, S::f32s) {
        let y = simd.add_f32s(y, self.from_base);
        let u = simd.mul_add_e_f32s(self.whitener[0], y, self.u);
        let v = simd.mul_add_e_f32s(self.whitener[1], y, self.shift);
        (simd.mul_add_e_f32s(u, u, simd.mul_f32s(v, v)), y)
    }
}

/// The thresholds of compositing in every lane.
pub(super) struct Limits<S: Simd> {
    pub(super) max_alpha: S::f32s,
    min_alpha: S::f32s,
    min_transmittance: S::f32s,
    sign: S::f32s,
}

/// What a splat does to pixels.
pub(super) struct Passed<S: Simd> {
    /// `α·T` where it is drawn, 0 elsewhere.
    pub(super) weight: S::f32s,
    /// Transmittance behind the splat; with its sign turned where the splat would finish the pixel.
    pub(super) after: S::f32s,
    /// Where it is drawn: opaque enough, and the pixel neither finished nor to be.
    pub(super) hit: S::m32s,
}

impl<S: Simd> Limits<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, constants: &RendererConstants) -> Self {
        let [max_alpha, min_alpha, min_transmittance] =
            [constants.max_alpha, constants.min_alpha, constants.min_transmittance]
                .map(|value| simd.splat_f32s(super::narrowed(value)));
        Self { max_alpha, min_alpha, min_transmittance, sign: simd.splat_f32s(-0.0) }
    }

    /// Where nothing is seen, alpha counts as 0: transmittance stays, and stays above its least where it was.
    #[inline(always)]
    pub(super) fn pass(&self, simd: S, alpha: S::f32s, before: S::f32s) -> Passed<S> {
        let seen = simd.greater_than_or_equal_f32s(alpha, self.min_alpha);
        let weight = simd.mul_f32s(only(simd, seen, alpha), before);
        let after = simd.sub_f32s(before, weight);
        let open = simd.greater_than_f32s(after, self.min_transmittance);
        let closed = simd.or_f32s(before, self.sign);
        Passed {
            weight: only(simd, open, weight),
            after: simd.select_f32s(open, after, closed),
            hit: simd.and_m32s(seen, open),
        }
    }
}

/// `value` where the mask is set, 0 elsewhere.
#[inline(always)]
pub(super) fn only<S: Simd>(simd: S, mask: S::m32s, value: S::f32s) -> S::f32s {
    simd.select_f32s(mask, value, simd.splat_f32s(0.0))
}
