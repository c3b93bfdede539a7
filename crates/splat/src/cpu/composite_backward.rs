//! Backward pass of compositing: traverses each cell front to back again, starting from the final pixel values.

use pulp::{Simd, WithSimd};

use super::RasterParams;
use super::batch::{BLOCK, Batch, Cell, LANES, Record};
use super::bins::Entry;
use super::composite::{Blended, Ellipse, Grid, MOST_VECTORS, Thresholds, masked, plane_count, vectors};
use super::math::Exp2;
use super::project::{Splat, is_slanted};
use crate::ImageGradients;
use crate::constants::ClampedGradient;

/// Splats per batch: their sums stay in the L1 cache.
const BATCH: usize = 96;

/// Lanes of the accumulators: each block's 16 pixels are added in pairs two rows apart, so that instruction sets with
/// 4, 8 and 16 lanes add in the same order.
const SUM_LANES: usize = 8;

/// Number of sums over a cell's pixels per splat: the moments `e, ex, ey, exx, exy, eyy`, with `x` and `y` in pixels
/// from the splat's base and `e` the gradient with respect to the exponent `½ dᵀ Σ⁻¹ d`; then the gradients with
/// respect to red, green, blue, depth and scalar. For a splat that [`is_slanted`], the whitened coordinate `u` takes the place
/// of `x`: the moments `eu, euu, euy`.
pub(super) const SUMS: usize = 11;

type Lanes = [[f32; SUM_LANES]; SUMS];

/// The image gradients of a cell, block by block; of each block one plane of 16 pixels after the other: the value of
/// everything behind the current splat, weighted by the gradients; the transmittance; then the gradients of red, green,
/// blue, depth and scalar.
#[derive(Debug)]
pub(super) struct CellGradient {
    values: Vec<f32>,
    sums: Vec<Lanes>,
}

const PLANES: usize = 7;

impl Default for CellGradient {
    fn default() -> Self {
        let blocks = super::batch::BLOCKS;
        Self { values: vec![0.0; blocks * LANES * PLANES], sums: vec![[[0.0; SUM_LANES]; SUMS]; BATCH] }
    }
}

impl CellGradient {
    /// Loads the gradients of a cell's pixels from the images, and the composited values; returns the gradient of the
    /// background.
    pub(super) fn fill(
        &mut self,
        pixels: &[f32],
        extra: bool,
        cell: Cell,
        params: &RasterParams<'_>,
        images: &ImageGradients<f32>,
    ) -> [f64; 3] {
        let mut background = [0.0; 3];
        let (width, height) = (params.size.width as usize, params.size.height as usize);
        let scalar_passes = !params.options.gradients.scalar_stops;
        let blocks = self.values.chunks_exact_mut(PLANES * LANES).zip(pixels.chunks_exact(plane_count(extra) * LANES));
        for (block, (values, pixels)) in blocks.enumerate() {
            let [left, top] = cell.at(block);
            for lane in 0..LANES {
                let (column, row) = (cell.left + left + lane % BLOCK, cell.top + top + lane / BLOCK);
                let mut set = |plane: usize, value: f32| values[plane * LANES + lane] = value;
                if column >= width || row >= height {
                    (0..PLANES).for_each(|plane| set(plane, if plane == 1 { -1.0 } else { 0.0 }));
                    continue;
                }
                let composited = |plane: usize| pixels[plane * LANES + lane];
                let gradient = images.at(row * width + column);
                let transmittance = composited(0).abs();
                let mut behind = -transmittance * gradient.alpha;
                if extra {
                    behind += composited(4) * gradient.depth;
                    behind += if scalar_passes { composited(5) * gradient.scalar } else { 0.0 };
                }
                for (channel, d_channel) in gradient.rgb.into_iter().enumerate() {
                    behind += d_channel * (composited(1 + channel) + transmittance * params.background[channel]);
                    background[channel] += f64::from(d_channel) * f64::from(transmittance);
                    set(2 + channel, d_channel);
                }
                set(0, behind);
                set(1, 1.0);
                set(5, gradient.depth);
                set(6, gradient.scalar);
            }
        }
        background
    }
}

/// Differentiates one cell; `order` holds indices into `list`, and `sums` is as long as `list`.
pub(super) struct CompositeBackward<'a> {
    pub(super) params: &'a RasterParams<'a>,
    pub(super) order: &'a [Entry],
    pub(super) list: &'a [u32],
    pub(super) splats: &'a [Splat],
    pub(super) cell: Cell,
    pub(super) batch: &'a mut Batch,
    pub(super) gradient: &'a mut CellGradient,
    pub(super) sums: &'a mut [[f32; SUMS]],
    /// Whether the last two sums are of absolute gradients with respect to the centre, see [`ABSOLUTE`]; there must be no
    /// extra channels.
    pub(super) absolute: bool,
}

/// Positions of the sums over pixels of the gradient's magnitude with respect to the centre, along `x` and `y`, divided by
/// [`ABSOLUTE_UNIT`]; in place of depth and scalar.
pub(super) const ABSOLUTE: [usize; 2] = [9, 10];

/// The exponent is `ln 2` times a sum of two squares.
pub(super) const ABSOLUTE_UNIT: f64 = 2.0 * std::f64::consts::LN_2;

impl WithSimd for CompositeBackward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        if self.params.extra {
            composite_backward::<S, true, false>(simd, self);
        } else if self.absolute {
            composite_backward::<S, false, true>(simd, self);
        } else {
            composite_backward::<S, false, false>(simd, self);
        }
    }
}

#[inline(always)]
fn composite_backward<S: Simd, const EXTRA: bool, const ABSOLUTE: bool>(simd: S, task: CompositeBackward<'_>) {
    let CompositeBackward { params, order, list, splats, cell, batch, gradient, sums, .. } = task;
    let CellGradient { values, sums: lanes } = gradient;
    let backward = BlockBackward::<S> {
        grid: Grid::new(simd),
        thresholds: Thresholds::new(simd, &params.options.constants),
        exp2: Exp2::new(simd),
        clamp_stops: params.options.constants.clamped_gradient == ClampedGradient::Exact,
        scalar_passes: !params.options.gradients.scalar_stops,
    };
    let blocks = cell.across * cell.across;
    let mut open = if blocks == 64 { u64::MAX } else { (1 << blocks) - 1 };
    for entries in order.chunks(BATCH) {
        batch.fill(simd, cell, open, entries, Some(list), splats);
        let used = batch.records().len();
        for lanes in lanes.iter_mut().take(used) {
            *lanes = [[0.0; SUM_LANES]; SUMS];
        }
        for (block, values) in values.chunks_exact_mut(PLANES * LANES).enumerate().take(blocks) {
            let list = batch.list(block);
            if !list.is_empty() && backward.block::<EXTRA, ABSOLUTE>(simd, batch, list, cell.at(block), values, lanes) {
                open &= !(1 << block);
            }
        }
        for (record, lanes) in batch.records().iter().zip(lanes.iter()) {
            for (sum, [a, b, c, d, e, f, g, h]) in sums[record.index as usize].iter_mut().zip(lanes) {
                *sum += ((a + e) + (c + g)) + ((b + f) + (d + h));
            }
        }
        if open == 0 {
            break;
        }
    }
}

/// State shared by all blocks.
struct BlockBackward<S: Simd> {
    grid: Grid<S>,
    thresholds: Thresholds<S>,
    exp2: Exp2<S>,
    clamp_stops: bool,
    scalar_passes: bool,
}

impl<S: Simd> BlockBackward<S> {
    /// Returns whether every pixel of the block is finished.
    #[inline(always)]
    fn block<const EXTRA: bool, const ABSOLUTE: bool>(
        &self,
        simd: S,
        batch: &Batch,
        list: &[u8],
        at: [usize; 2],
        values: &mut [f32],
        lanes: &mut [Lanes],
    ) -> bool {
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let vectors = vectors::<S>();
        let (stored, _) = S::as_mut_simd_f32s(values);
        let mut planes = [[zero; MOST_VECTORS]; PLANES];
        for (plane, stored) in planes.iter_mut().zip(stored.chunks_exact(vectors)) {
            for (value, stored) in plane.iter_mut().zip(stored) {
                *value = *stored;
            }
        }
        let (x, y) = self.grid.at(simd, at);
        for number in list {
            let record = batch.record(*number);
            let lanes = &mut lanes[usize::from(*number)];
            let ellipse = Ellipse::new(simd, record, x);
            let mut terms = [[zero; MOST_VECTORS]; SUMS];
            for v in 0..vectors {
                let (power, y) = ellipse.power(simd, y[v]);
                let full = simd.mul_f32s(simd.splat_f32s(record.opacity), self.exp2.of_negative(simd, power));
                let alpha = simd.min_f32s(self.thresholds.max_alpha, full);
                let before = planes[1][v];
                let Blended { weight, after, hit } = self.thresholds.blend(simd, alpha, before);
                let d_weight = self.d_weight::<EXTRA>(simd, record, &planes, v);
                planes[0][v] = simd.sub_f32s(planes[0][v], simd.mul_f32s(weight, d_weight));
                planes[1][v] = after;
                let one_minus_alpha = simd.sub_f32s(one, alpha);
                let d_alpha =
                    simd.sub_f32s(simd.mul_f32s(before, d_weight), simd.div_f32s(planes[0][v], one_minus_alpha));
                let e = simd.neg_f32s(simd.mul_f32s(full, d_alpha));
                let mut e = masked(simd, hit, e);
                if self.clamp_stops {
                    e = simd.select_f32s(simd.greater_than_f32s(full, self.thresholds.max_alpha), zero, e);
                }
                let ey = simd.mul_f32s(e, y);
                terms[0][v] = e;
                terms[2][v] = ey;
                terms[5][v] = simd.mul_f32s(ey, y);
                if ABSOLUTE {
                    let e = simd.abs_f32s(e);
                    for (sum, slope) in ellipse.slopes(simd, record, y).into_iter().enumerate() {
                        terms[9 + sum][v] = simd.mul_f32s(e, simd.abs_f32s(slope));
                    }
                }
                for channel in 0..if EXTRA { 5 } else { 3 } {
                    terms[6 + channel][v] = simd.mul_f32s(weight, planes[2 + channel][v]);
                }
            }
            if is_slanted(record.whitener) {
                for v in 0..vectors {
                    let e = terms[0][v];
                    let [u, y] = ellipse.along(simd, y[v]);
                    // Where nothing is drawn, `u` may be infinite.
                    let u = simd.select_f32s(simd.equal_f32s(e, zero), zero, u);
                    let eu = simd.mul_f32s(e, u);
                    (terms[1][v], terms[3][v], terms[4][v]) = (eu, simd.mul_f32s(eu, u), simd.mul_f32s(eu, y));
                }
                add_terms::<S>(simd, EXTRA || ABSOLUTE, &terms, None, lanes);
            } else {
                add_terms::<S>(simd, EXTRA || ABSOLUTE, &terms, Some(ellipse.x), lanes);
            }
        }
        for (plane, stored) in planes.iter().take(2).zip(stored.chunks_exact_mut(vectors)) {
            for (value, stored) in plane.iter().zip(stored) {
                *stored = *value;
            }
        }
        let mut max_transmittance = planes[1][0];
        for value in planes[1].iter().take(vectors).skip(1) {
            max_transmittance = simd.max_f32s(max_transmittance, *value);
        }
        simd.reduce_max_f32s(max_transmittance) <= 0.0
    }

    /// Gradient with respect to the splat's compositing weight at a vector of pixels.
    #[inline(always)]
    fn d_weight<const EXTRA: bool>(
        &self,
        simd: S,
        record: &Record,
        planes: &[[S::f32s; MOST_VECTORS]; PLANES],
        v: usize,
    ) -> S::f32s {
        let [r, g, b] = record.rgb;
        let mut d_weight = simd.mul_f32s(simd.splat_f32s(r), planes[2][v]);
        d_weight = simd.mul_add_e_f32s(simd.splat_f32s(g), planes[3][v], d_weight);
        d_weight = simd.mul_add_e_f32s(simd.splat_f32s(b), planes[4][v], d_weight);
        if EXTRA {
            d_weight = simd.mul_add_e_f32s(simd.splat_f32s(record.depth), planes[5][v], d_weight);
            if self.scalar_passes {
                d_weight = simd.mul_add_e_f32s(simd.splat_f32s(record.scalar), planes[6][v], d_weight);
            }
        }
        d_weight
    }
}

/// Adds a block's terms to the accumulators. The terms along `x`, if it is given, are computed here, because every vector has
/// the same pixel columns.
#[inline(always)]
fn add_terms<S: Simd>(
    simd: S,
    extra: bool,
    terms: &[[S::f32s; MOST_VECTORS]; SUMS],
    x: Option<S::f32s>,
    lanes: &mut Lanes,
) {
    if S::F32_LANES > SUM_LANES {
        let mut folded = [[0.0f32; SUM_LANES]; SUMS];
        for (folded, terms) in folded.iter_mut().zip(terms) {
            let mut flat = [0.0f32; LANES];
            S::as_mut_simd_f32s(&mut flat).0.iter_mut().for_each(|slot| *slot = terms[0]);
            let (low, high) = flat.split_at(SUM_LANES);
            for ((slot, low), high) in folded.iter_mut().zip(low).zip(high) {
                *slot = low + high;
            }
        }
        if let Some(x) = x {
            let mut columns = [0.0f32; LANES];
            S::as_mut_simd_f32s(&mut columns).0.iter_mut().for_each(|slot| *slot = x);
            for (lane, x) in columns.iter().enumerate().take(SUM_LANES) {
                folded[1][lane] = folded[0][lane] * x;
                folded[3][lane] = folded[1][lane] * x;
                folded[4][lane] = folded[2][lane] * x;
            }
        }
        for (sum, folded) in lanes.iter_mut().zip(folded).take(if extra { SUMS } else { 9 }) {
            for (sum, value) in sum.iter_mut().zip(folded) {
                *sum += value;
            }
        }
        return;
    }
    let halves = SUM_LANES / S::F32_LANES;
    for half in 0..halves {
        let fold = |of: usize| simd.add_f32s(terms[of][half], terms[of][half + halves]);
        let (e, ey) = (fold(0), fold(2));
        let (ex, exx, exy) = if let Some(x) = x {
            let ex = simd.mul_f32s(e, x);
            (ex, simd.mul_f32s(ex, x), simd.mul_f32s(ey, x))
        } else {
            (fold(1), fold(3), fold(4))
        };
        let mut folded = [e, ex, ey, exx, exy, fold(5), fold(6), fold(7), fold(8), e, e];
        if extra {
            (folded[9], folded[10]) = (fold(9), fold(10));
        }
        for (sum, value) in lanes.iter_mut().zip(folded).take(if extra { SUMS } else { 9 }) {
            let slot = &mut S::as_mut_simd_f32s(sum).0[half];
            *slot = simd.add_f32s(*slot, value);
        }
    }
}
