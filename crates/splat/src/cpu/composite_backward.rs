//! Backward pass of compositing: traverses each cell front to back again, starting from the final pixel values.

use pulp::{Simd, WithSimd};

use super::RasterParams;
use super::batch::{BLOCK, Batch, Cell, LANES, Record};
use super::bins::Entry;
use super::composite::{
    self, Blended, Ellipse, Grid, MAX_VECTORS, Thresholds, are_finished, masked, plane_count, vectors,
};
use super::math::Exp2;
use super::pixel_sums::{ABSOLUTE, DEPTH, E, EX, EXX, EXY, EY, EYY, RGB, SCALAR, SUMS, SUMS_OF_COLOUR};
use super::project::{Splat, is_slanted};
use crate::ImageGradients;
use crate::constants::ClampedGradient;

/// Splats per batch: their sums stay in the L1 cache.
const BATCH: usize = 96;

/// Lanes of the accumulators: each block's 16 pixels are added in pairs two rows apart, so that instruction sets with
/// 4, 8 and 16 lanes add in the same order.
const SUM_LANES: usize = 8;

/// A splat's accumulators.
type Lanes = [[f32; SUM_LANES]; SUMS];

/// The image gradients of a cell, block by block; of each block one plane of 16 pixels after the other.
#[derive(Debug)]
pub(super) struct CellGradient {
    values: Vec<f32>,
    sums: Vec<Lanes>,
}

/// The plane of the value of everything behind the current splat, weighted by the gradients.
const BEHIND: usize = 0;
const TRANSMITTANCE: usize = 1;
/// The plane of the gradient with respect to red; then to green and blue.
const D_RGB: usize = 2;
const D_DEPTH: usize = 5;
const D_SCALAR: usize = 6;
/// Number of planes.
const PLANES: usize = 7;

/// The planes of a block in registers.
type Planes<S> = [[<S as Simd>::f32s; MAX_VECTORS]; PLANES];

/// What a splat adds to its sums at the pixels of a block.
type Terms<S> = [[<S as Simd>::f32s; MAX_VECTORS]; SUMS];

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
            let [left, top] = cell.corner(block);
            for lane in 0..LANES {
                let (column, row) = (cell.left + left + lane % BLOCK, cell.top + top + lane / BLOCK);
                let mut set = |plane: usize, value: f32| values[plane * LANES + lane] = value;
                if column >= width || row >= height {
                    (0..PLANES).for_each(|plane| set(plane, if plane == TRANSMITTANCE { -1.0 } else { 0.0 }));
                    continue;
                }
                let composited = |plane: usize| pixels[plane * LANES + lane];
                let gradient = images.at(row * width + column);
                let transmittance = composited(composite::TRANSMITTANCE).abs();
                let mut behind = -transmittance * gradient.alpha;
                if extra {
                    behind += composited(composite::DEPTH) * gradient.depth;
                    behind += if scalar_passes { composited(composite::SCALAR) * gradient.scalar } else { 0.0 };
                }
                for (channel, d_channel) in gradient.rgb.into_iter().enumerate() {
                    let colour = composited(composite::RGB + channel) + transmittance * params.background[channel];
                    behind += d_channel * colour;
                    background[channel] += f64::from(d_channel) * f64::from(transmittance);
                    set(D_RGB + channel, d_channel);
                }
                set(BEHIND, behind);
                set(TRANSMITTANCE, 1.0);
                set(D_DEPTH, gradient.depth);
                set(D_SCALAR, gradient.scalar);
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
fn composite_backward<S: Simd, const EXTRA: bool, const WITH_ABSOLUTE: bool>(simd: S, task: CompositeBackward<'_>) {
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
            if list.is_empty() {
                continue;
            }
            if backward.block::<EXTRA, WITH_ABSOLUTE>(simd, batch, list, cell.corner(block), values, lanes) {
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
    /// Adds to the accumulators of the splats in `list`, and returns whether every pixel of the block is finished.
    #[inline(always)]
    fn block<const EXTRA: bool, const WITH_ABSOLUTE: bool>(
        &self,
        simd: S,
        batch: &Batch,
        list: &[u8],
        corner: [usize; 2],
        values: &mut [f32],
        lanes: &mut [Lanes],
    ) -> bool {
        let zero = simd.splat_f32s(0.0);
        let vectors = vectors::<S>();
        let (stored, _) = S::as_mut_simd_f32s(values);
        let mut planes = [[zero; MAX_VECTORS]; PLANES];
        for (plane, stored) in planes.iter_mut().zip(stored.chunks_exact(vectors)) {
            for (value, stored) in plane.iter_mut().zip(stored) {
                *value = *stored;
            }
        }
        let (x, y) = self.grid.at(simd, corner);
        for number in list {
            let record = batch.record(*number);
            let lanes = &mut lanes[usize::from(*number)];
            let ellipse = Ellipse::new(simd, record, x);
            let mut terms = [[zero; MAX_VECTORS]; SUMS];
            for v in 0..vectors {
                let splat = (record, &ellipse);
                self.pass_splat::<EXTRA, WITH_ABSOLUTE>(simd, splat, &y, v, &mut planes, &mut terms);
            }
            if is_slanted(record.whitener) {
                set_slanted_moments(simd, &ellipse, &y, &mut terms);
                add_terms::<S>(simd, EXTRA || WITH_ABSOLUTE, &terms, None, lanes);
            } else {
                add_terms::<S>(simd, EXTRA || WITH_ABSOLUTE, &terms, Some(ellipse.x), lanes);
            }
        }
        // The planes of gradients, which come last, do not change.
        for (plane, stored) in planes.iter().take(D_RGB).zip(stored.chunks_exact_mut(vectors)) {
            for (value, stored) in plane.iter().zip(stored) {
                *stored = *value;
            }
        }
        are_finished(simd, &planes[TRANSMITTANCE])
    }

    /// Takes vector `v` of the block's pixels past a splat, and sets its terms there, except the moments along columns.
    #[inline(always)]
    fn pass_splat<const EXTRA: bool, const WITH_ABSOLUTE: bool>(
        &self,
        simd: S,
        (record, ellipse): (&Record, &Ellipse<S>),
        y: &[S::f32s; MAX_VECTORS],
        v: usize,
        planes: &mut Planes<S>,
        terms: &mut Terms<S>,
    ) {
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let (power, y) = ellipse.power(simd, y[v]);
        let full = simd.mul_f32s(simd.splat_f32s(record.opacity), self.exp2.of_negative(simd, power));
        let alpha = simd.min_f32s(self.thresholds.max_alpha, full);
        let before = planes[TRANSMITTANCE][v];
        let Blended { weight, after, hit } = self.thresholds.blend(simd, alpha, before);
        let d_weight = self.d_weight::<EXTRA>(simd, record, planes, v);
        planes[BEHIND][v] = simd.sub_f32s(planes[BEHIND][v], simd.mul_f32s(weight, d_weight));
        planes[TRANSMITTANCE][v] = after;
        let one_minus_alpha = simd.sub_f32s(one, alpha);
        let d_alpha = simd.sub_f32s(simd.mul_f32s(before, d_weight), simd.div_f32s(planes[BEHIND][v], one_minus_alpha));
        let e = simd.neg_f32s(simd.mul_f32s(full, d_alpha));
        let mut e = masked(simd, hit, e);
        if self.clamp_stops {
            e = simd.select_f32s(simd.greater_than_f32s(full, self.thresholds.max_alpha), zero, e);
        }
        let ey = simd.mul_f32s(e, y);
        terms[E][v] = e;
        terms[EY][v] = ey;
        terms[EYY][v] = simd.mul_f32s(ey, y);
        if WITH_ABSOLUTE {
            let e = simd.abs_f32s(e);
            let [along_columns, along_rows] = ellipse.slopes(simd, record, y);
            terms[ABSOLUTE[0]][v] = simd.mul_f32s(e, simd.abs_f32s(along_columns));
            terms[ABSOLUTE[1]][v] = simd.mul_f32s(e, simd.abs_f32s(along_rows));
        }
        // Depth and scalar follow the colours in the sums as in the planes.
        for channel in 0..if EXTRA { 5 } else { 3 } {
            terms[RGB + channel][v] = simd.mul_f32s(weight, planes[D_RGB + channel][v]);
        }
    }

    /// Gradient with respect to the splat's compositing weight at a vector of pixels.
    #[inline(always)]
    fn d_weight<const EXTRA: bool>(&self, simd: S, record: &Record, planes: &Planes<S>, v: usize) -> S::f32s {
        let [r, g, b] = record.rgb;
        let mut d_weight = simd.mul_f32s(simd.splat_f32s(r), planes[D_RGB][v]);
        d_weight = simd.mul_add_e_f32s(simd.splat_f32s(g), planes[D_RGB + 1][v], d_weight);
        d_weight = simd.mul_add_e_f32s(simd.splat_f32s(b), planes[D_RGB + 2][v], d_weight);
        if EXTRA {
            d_weight = simd.mul_add_e_f32s(simd.splat_f32s(record.depth), planes[D_DEPTH][v], d_weight);
            if self.scalar_passes {
                d_weight = simd.mul_add_e_f32s(simd.splat_f32s(record.scalar), planes[D_SCALAR][v], d_weight);
            }
        }
        d_weight
    }
}

/// Sets a slanted splat's moments along the whitened coordinate `u`, which changes from row to row.
#[inline(always)]
fn set_slanted_moments<S: Simd>(simd: S, ellipse: &Ellipse<S>, y: &[S::f32s; MAX_VECTORS], terms: &mut Terms<S>) {
    for v in 0..vectors::<S>() {
        let e = terms[E][v];
        let [u, y] = ellipse.along(simd, y[v]);
        // Where nothing is drawn, `u` may be infinite.
        let u = simd.select_f32s(simd.equal_f32s(e, simd.splat_f32s(0.0)), simd.splat_f32s(0.0), u);
        let eu = simd.mul_f32s(e, u);
        (terms[EX][v], terms[EXX][v], terms[EXY][v]) = (eu, simd.mul_f32s(eu, u), simd.mul_f32s(eu, y));
    }
}

/// Adds a block's terms to the accumulators; `all` of them, or only those of colour. The terms along `x`, if it is given, are
/// computed here, because every vector has the same pixel columns.
#[inline(always)]
fn add_terms<S: Simd>(simd: S, all: bool, terms: &Terms<S>, x: Option<S::f32s>, lanes: &mut Lanes) {
    if S::F32_LANES > SUM_LANES {
        add_one_vector::<S>(all, terms, x, lanes);
    } else {
        add_vectors(simd, all, terms, x, lanes);
    }
}

/// As [`add_terms`], where a single vector has the block's 16 pixels.
#[inline(always)]
fn add_one_vector<S: Simd>(all: bool, terms: &Terms<S>, x: Option<S::f32s>, lanes: &mut Lanes) {
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
            folded[EX][lane] = folded[E][lane] * x;
            folded[EXX][lane] = folded[EX][lane] * x;
            folded[EXY][lane] = folded[EY][lane] * x;
        }
    }
    for (sum, folded) in lanes.iter_mut().zip(folded).take(if all { SUMS } else { SUMS_OF_COLOUR }) {
        for (sum, value) in sum.iter_mut().zip(folded) {
            *sum += value;
        }
    }
}

/// As [`add_terms`], where a vector has at most 8 pixels.
#[inline(always)]
fn add_vectors<S: Simd>(simd: S, all: bool, terms: &Terms<S>, x: Option<S::f32s>, lanes: &mut Lanes) {
    let halves = SUM_LANES / S::F32_LANES;
    for half in 0..halves {
        let fold = |sum: usize| simd.add_f32s(terms[sum][half], terms[sum][half + halves]);
        let (e, ey) = (fold(E), fold(EY));
        let (ex, exx, exy) = if let Some(x) = x {
            let ex = simd.mul_f32s(e, x);
            (ex, simd.mul_f32s(ex, x), simd.mul_f32s(ey, x))
        } else {
            (fold(EX), fold(EXX), fold(EXY))
        };
        let mut folded = [e, ex, ey, exx, exy, fold(EYY), fold(RGB), fold(RGB + 1), fold(RGB + 2), e, e];
        if all {
            (folded[DEPTH], folded[SCALAR]) = (fold(DEPTH), fold(SCALAR));
        }
        for (sum, value) in lanes.iter_mut().zip(folded).take(if all { SUMS } else { SUMS_OF_COLOUR }) {
            let slot = &mut S::as_mut_simd_f32s(sum).0[half];
            *slot = simd.add_f32s(*slot, value);
        }
    }
}
