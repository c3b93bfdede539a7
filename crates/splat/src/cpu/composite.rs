//! Front-to-back compositing, block by block, with the block's pixels in registers.

use pulp::{Simd, WithSimd};

use super::RasterParams;
use super::batch::{BATCH, BLOCK, BLOCKS, Batch, Cell, LANES, Record};
use super::bins::Entry;
use super::math::Exp2;
use super::project::Splat;
use crate::RendererConstants;

/// The plane of a block with each pixel's transmittance; that of a finished pixel is negated, so that no later splat passes the
/// threshold.
pub(super) const TRANSMITTANCE: usize = 0;
/// The plane of red; then of green and blue.
pub(super) const RGB: usize = 1;
pub(super) const DEPTH: usize = 4;
pub(super) const SCALAR: usize = 5;
pub(super) const MEDIAN_DEPTH: usize = 6;

/// Values per pixel: transmittance and colour; with extra channels also depth, scalar and median depth.
pub(super) const fn plane_count(extra: bool) -> usize {
    if extra { 7 } else { 4 }
}

/// Maximal number of vectors per block.
pub(super) const MAX_VECTORS: usize = 4;

/// Composites one cell into `pixels`: block by block, and within a block plane by plane (see [`plane_count`]) of 16
/// pixels.
pub(super) struct Composite<'a> {
    pub(super) params: &'a RasterParams<'a>,
    /// Indices into `list`, or into all splats if there is no list.
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
        // The common case does not pay for channels that were not requested.
        if self.params.extra {
            composite::<S, true, { plane_count(true) }>(simd, self);
        } else {
            composite::<S, false, { plane_count(false) }>(simd, self);
        }
    }
}

#[inline(always)]
fn composite<S: Simd, const EXTRA: bool, const PLANES: usize>(simd: S, task: Composite<'_>) {
    let Composite { params, order, list, splats, cell, batch, pixels } = task;
    let grid = Grid::<S>::new(simd);
    let thresholds = Thresholds::<S>::new(simd, &params.options.constants);
    let exp2 = Exp2::new(simd);
    let mut open = clear(pixels, PLANES, cell, params);
    for entries in order.chunks(BATCH) {
        batch.fill(simd, cell, open, entries, list, splats);
        for (block, pixels) in pixels.chunks_exact_mut(PLANES * LANES).enumerate().take(BLOCKS) {
            let list = batch.list(block);
            if list.is_empty() {
                continue;
            }
            let done = composite_block::<S, EXTRA, PLANES>(
                simd,
                (&grid, &thresholds, &exp2),
                batch,
                list,
                cell.corner(block),
                pixels,
            );
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
    /// Column and row of a block's first pixel, relative to the cell's.
    #[inline(always)]
    pub(super) const fn corner(self, block: usize) -> [usize; 2] {
        [block % self.across * BLOCK, block / self.across * BLOCK]
    }
}

/// Returns whether every pixel of the block is finished.
#[inline(always)]
fn composite_block<S: Simd, const EXTRA: bool, const PLANES: usize>(
    simd: S,
    (grid, thresholds, exp2): (&Grid<S>, &Thresholds<S>, &Exp2<S>),
    batch: &Batch,
    list: &[u8],
    corner: [usize; 2],
    pixels: &mut [f32],
) -> bool {
    let vectors = vectors::<S>();
    let (zero, half) = (simd.splat_f32s(0.0), simd.splat_f32s(0.5));
    let (stored, _) = S::as_mut_simd_f32s(pixels);
    let mut planes = [[zero; MAX_VECTORS]; PLANES];
    for (values, stored) in planes.iter_mut().zip(stored.chunks_exact(vectors)) {
        for (value, stored) in values.iter_mut().zip(stored) {
            *value = *stored;
        }
    }
    let (x, y) = grid.at(simd, corner);
    for number in list {
        let record = batch.record(*number);
        let splat = |value: f32| simd.splat_f32s(value);
        let ellipse = Ellipse::new(simd, record, x);
        let opacity = splat(record.opacity);
        for v in 0..vectors {
            let power = ellipse.power(simd, y[v]).0;
            let alpha = simd.min_f32s(thresholds.max_alpha, simd.mul_f32s(opacity, exp2.of_negative(simd, power)));
            let before = planes[TRANSMITTANCE][v];
            let Blended { weight, after, hit } = thresholds.blend(simd, alpha, before);
            if EXTRA {
                let depth = splat(record.depth);
                planes[DEPTH][v] = simd.mul_add_e_f32s(weight, depth, planes[DEPTH][v]);
                planes[SCALAR][v] = simd.mul_add_e_f32s(weight, splat(record.scalar), planes[SCALAR][v]);
                let from_above = simd.greater_than_f32s(before, half);
                let to_below = simd.greater_than_or_equal_f32s(half, after);
                let crosses = simd.and_m32s(hit, simd.and_m32s(from_above, to_below));
                planes[MEDIAN_DEPTH][v] = simd.select_f32s(crosses, depth, planes[MEDIAN_DEPTH][v]);
            }
            planes[TRANSMITTANCE][v] = after;
            for (channel, value) in record.rgb.iter().enumerate() {
                planes[RGB + channel][v] = simd.mul_add_e_f32s(weight, splat(*value), planes[RGB + channel][v]);
            }
        }
    }
    for (values, stored) in planes.iter().zip(stored.chunks_exact_mut(vectors)) {
        for (value, stored) in values.iter().zip(stored) {
            *stored = *value;
        }
    }
    are_finished(simd, &planes[TRANSMITTANCE])
}

/// Whether every pixel of a block is finished.
#[inline(always)]
pub(super) fn are_finished<S: Simd>(simd: S, transmittance: &[S::f32s; MAX_VECTORS]) -> bool {
    let mut largest = transmittance[0];
    for value in transmittance.iter().take(vectors::<S>()).skip(1) {
        largest = simd.max_f32s(largest, *value);
    }
    simd.reduce_max_f32s(largest) <= 0.0
}

/// Number of vectors per block.
#[inline(always)]
pub(super) const fn vectors<S: Simd>() -> usize {
    LANES / S::F32_LANES
}

/// Initialises all pixels, those outside the image as finished. Returns a bit for each block with unfinished pixels.
#[inline(always)]
pub(super) fn clear(pixels: &mut [f32], planes: usize, cell: Cell, params: &RasterParams<'_>) -> u64 {
    let inside = |start: usize, length: u32| (length as usize).saturating_sub(start);
    let (width, height) = (inside(cell.left, params.size.width), inside(cell.top, params.size.height));
    let mut open = 0;
    for (block, pixels) in pixels.chunks_exact_mut(planes * LANES).enumerate().take(cell.across * cell.across) {
        pixels.fill(0.0);
        let [column, row] = cell.corner(block);
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

/// Coordinates of the pixels of a block.
pub(super) struct Grid<S: Simd> {
    x: S::f32s,
    y: [S::f32s; MAX_VECTORS],
}

impl<S: Simd> Grid<S> {
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        let lanes = |coordinate: fn(usize) -> usize| {
            let mut values = [0.0f32; LANES];
            for (lane, value) in values.iter_mut().enumerate() {
                *value = coordinate(lane) as f32;
            }
            let mut vectors = [simd.splat_f32s(0.0); MAX_VECTORS];
            for (vector, values) in vectors.iter_mut().zip(S::as_simd_f32s(&values).0) {
                *vector = *values;
            }
            vectors
        };
        Self { x: lanes(|lane| lane % BLOCK)[0], y: lanes(|lane| lane / BLOCK) }
    }

    /// Coordinates of a block's pixels, relative to the cell's first.
    #[inline(always)]
    pub(super) fn at(&self, simd: S, [column, row]: [usize; 2]) -> (S::f32s, [S::f32s; MAX_VECTORS]) {
        let row = simd.splat_f32s(row as f32);
        (simd.add_f32s(self.x, simd.splat_f32s(column as f32)), self.y.map(|y| simd.add_f32s(y, row)))
    }
}

/// A splat's ellipse, evaluated along columns of pixels.
pub(super) struct Ellipse<S: Simd> {
    /// Columns from the base.
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

    /// The whitened coordinate `u` along columns, and the rows from the base.
    #[inline(always)]
    pub(super) fn along(&self, simd: S, y: S::f32s) -> [S::f32s; 2] {
        let y = simd.add_f32s(y, self.from_base);
        [simd.mul_add_e_f32s(self.whitener[0], y, self.u), y]
    }

    /// `½ dᵀ Σ⁻¹ d · log₂e`, and the rows from the base.
    #[inline(always)]
    pub(super) fn power(&self, simd: S, y: S::f32s) -> (S::f32s, S::f32s) {
        let [u, y] = self.along(simd, y);
        let v = simd.mul_add_e_f32s(self.whitener[1], y, self.shift);
        (simd.mul_add_e_f32s(u, u, simd.mul_f32s(v, v)), y)
    }

    /// Half the derivatives of the power with respect to columns and rows, at rows from the base.
    #[inline(always)]
    pub(super) fn slopes(&self, simd: S, record: &Record, y: S::f32s) -> [S::f32s; 2] {
        let u = simd.mul_add_e_f32s(self.whitener[0], y, self.u);
        let v = simd.mul_add_e_f32s(self.whitener[1], y, self.shift);
        let along = simd.mul_f32s(simd.splat_f32s(record.whitener[0]), u);
        [along, simd.mul_add_e_f32s(self.whitener[0], u, simd.mul_f32s(self.whitener[1], v))]
    }
}

/// The compositing thresholds, broadcast to every lane.
pub(super) struct Thresholds<S: Simd> {
    pub(super) max_alpha: S::f32s,
    min_alpha: S::f32s,
    min_transmittance: S::f32s,
    sign: S::f32s,
}

/// The effect of a splat on a vector of pixels.
pub(super) struct Blended<S: Simd> {
    /// Compositing weight `α·T` where the splat is drawn, 0 elsewhere.
    pub(super) weight: S::f32s,
    /// Transmittance after the splat; negated where the splat would finish the pixel.
    pub(super) after: S::f32s,
    /// Where the splat is drawn: alpha reaches the threshold, and the pixel is neither finished nor finished by it.
    pub(super) hit: S::m32s,
}

impl<S: Simd> Thresholds<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, constants: &RendererConstants) -> Self {
        let [max_alpha, min_alpha, min_transmittance] =
            [constants.max_alpha, constants.min_alpha, constants.min_transmittance]
                .map(|value| simd.splat_f32s(super::to_f32(value)));
        Self { max_alpha, min_alpha, min_transmittance, sign: simd.splat_f32s(-0.0) }
    }

    /// Below `min_alpha` alpha counts as 0, which leaves the transmittance unchanged.
    #[inline(always)]
    pub(super) fn blend(&self, simd: S, alpha: S::f32s, before: S::f32s) -> Blended<S> {
        let opaque = simd.greater_than_or_equal_f32s(alpha, self.min_alpha);
        let weight = simd.mul_f32s(masked(simd, opaque, alpha), before);
        let after = simd.sub_f32s(before, weight);
        let open = simd.greater_than_f32s(after, self.min_transmittance);
        let closed = simd.or_f32s(before, self.sign);
        Blended {
            weight: masked(simd, open, weight),
            after: simd.select_f32s(open, after, closed),
            hit: simd.and_m32s(opaque, open),
        }
    }
}

/// `value` where the mask is set, 0 elsewhere.
#[inline(always)]
pub(super) fn masked<S: Simd>(simd: S, mask: S::m32s, value: S::f32s) -> S::f32s {
    simd.select_f32s(mask, value, simd.splat_f32s(0.0))
}
