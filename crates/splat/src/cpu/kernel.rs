use atsplat_camera::ImageSize;
use pulp::{Simd, WithSimd};

use super::project::Splat;
use super::{Band, narrowed};
use crate::RenderOptions;

/// What all tiles share.
pub(super) struct Paint<'a> {
    pub(super) options: &'a RenderOptions,
    pub(super) background: [f32; 3],
    pub(super) size: ImageSize,
    pub(super) splats: &'a [Splat],
}

/// The pixels of one tile, block after block of as many as there are lanes, block rows from the top.
///
/// A pixel that is finished keeps its transmittance with the sign turned: no later splat passes the test on it.
#[derive(Debug)]
pub(super) struct Tile {
    side: usize,
    block: [usize; 2],
    transmittance: Vec<f32>,
    channels: [Vec<f32>; 6],
}

/// Splats that are read at a time: 4 KiB.
const BATCH: usize = 64;

const DEPTH: usize = 3;
const SCALAR: usize = 4;
const MEDIAN: usize = 5;

impl Tile {
    pub(super) fn new(side: u32) -> Self {
        let pixels = (side * side) as usize;
        Self {
            side: side as usize,
            block: [1, 1],
            transmittance: vec![1.0; pixels],
            channels: std::array::from_fn(|_| vec![0.0; pixels]),
        }
    }

    fn clear(&mut self, block: [usize; 2]) {
        self.block = block;
        self.transmittance.fill(1.0);
        self.channels.iter_mut().for_each(|channel| channel.fill(0.0));
    }

    /// Where a pixel of the tile is kept.
    const fn place(&self, column: usize, row: usize) -> usize {
        let [width, height] = self.block;
        let block = (row / height) * (self.side / width) + column / width;
        block * width * height + (row % height) * width + column % width
    }

    /// Writes the pixels into the images, over the background.
    pub(super) fn copy_to(&self, band: &mut Band<'_>, tile_column: usize, paint: &Paint<'_>) {
        let width = paint.size.width as usize;
        let left = tile_column * self.side;
        let columns = if width - left < self.side { width - left } else { self.side };
        let rows = band.alpha.len() / width;
        let value =
            |channel: usize, place: usize| self.channels.get(channel).and_then(|values| values.get(place)).copied();
        for row in 0..rows {
            for column in 0..columns {
                let (place, pixel) = (self.place(column, row), row * width + left + column);
                let transmittance = self.transmittance.get(place).copied().unwrap_or(1.0).abs();
                if let (Some(rgb), Some(alpha)) = (band.rgb.get_mut(pixel), band.alpha.get_mut(pixel)) {
                    *alpha = 1.0 - transmittance;
                    for (channel, (slot, behind)) in rgb.iter_mut().zip(paint.background).enumerate() {
                        *slot = behind * transmittance + value(channel, place).unwrap_or_default();
                    }
                }
                for (image, channel) in
                    [(&mut band.depth, DEPTH), (&mut band.scalar, SCALAR), (&mut band.median_depth, MEDIAN)]
                {
                    if let Some(slot) = image.as_mut().and_then(|image| image.get_mut(pixel)) {
                        *slot = value(channel, place).unwrap_or_default();
                    }
                }
            }
        }
    }
}

/// Composites one tile.
pub(super) struct Render<'a> {
    pub(super) paint: &'a Paint<'a>,
    pub(super) list: &'a [u32],
    /// Column and row of the tile.
    pub(super) at: (usize, usize),
    pub(super) tile: &'a mut Tile,
}

impl WithSimd for Render<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let channels = self.paint.options.channels;
        // The common case pays nothing for images that nobody asked for.
        if channels.depth || channels.scalar || channels.median_depth {
            render::<S, true>(simd, self);
        } else {
            render::<S, false>(simd, self);
        }
    }
}

#[inline(always)]
fn render<S: Simd, const EXTRA: bool>(simd: S, Render { paint, list, at, tile }: Render<'_>) {
    let lanes = S::F32_LANES;
    let block = if lanes >= 8 { [4, lanes / 4] } else { [lanes, 1] };
    tile.clear(block);
    let [width, height] = block;
    let side = tile.side;
    let lane = |of: fn(usize, usize) -> usize| {
        let mut values = [0.0f32; 64];
        for (index, value) in values.iter_mut().take(lanes).enumerate() {
            *value = of(index, if lanes >= 8 { 4 } else { lanes }) as f32;
        }
        first::<S>(&values, simd)
    };
    let (lane_x, lane_y) = (lane(|index, width| index % width), lane(|index, width| index / width));

    let constants = &paint.options.constants;
    let [max_alpha, min_alpha, min_transmittance] =
        [constants.max_alpha, constants.min_alpha, constants.min_transmittance]
            .map(|value| simd.splat_f32s(narrowed(value)));
    let (zero, half) = (simd.splat_f32s(0.0), simd.splat_f32s(0.5));
    let exp2 = Exp2::new(simd);

    let (left, top) = (at.0 * side, at.1 * side);
    let blocks_across = side / width;
    let (transmittance, _) = S::as_mut_simd_f32s(&mut tile.transmittance);
    let [red, green, blue, depth, scalar, median] = &mut tile.channels;
    let [red, green, blue, depth, scalar, median] =
        [red, green, blue, depth, scalar, median].map(|channel| S::as_mut_simd_f32s(channel).0);

    // Copied a batch at a time: the loads of one batch wait for memory together, not one after the other.
    let mut batch = [Splat::default(); BATCH];
    let mut batches = list.chunks(BATCH);
    let mut next = batches.next();
    while let Some(indices) = next {
        for (slot, index) in batch.iter_mut().zip(indices) {
            *slot = paint.splats.get(*index as usize).copied().unwrap_or_default();
        }
        for splat in batch.iter().take(indices.len()) {
            let clip = |[from, to]: [u16; 2], start: usize| {
                let from = usize::from(from).saturating_sub(start);
                let to = usize::from(to).saturating_sub(start);
                (from, if to < side { to } else { side })
            };
            let (first_column, past_column) = clip(splat.reach[0], left);
            let (first_row, past_row) = clip(splat.reach[1], top);

            let [l11, l12, l22] = splat.whitener.map(|value| simd.splat_f32s(value));
            let [offset_x, offset_y] = splat.offset.map(|value| simd.splat_f32s(value));
            let opacity = simd.splat_f32s(splat.opacity);
            let [r, g, b] = splat.rgb.map(|value| simd.splat_f32s(value));
            let (z, u) = (simd.splat_f32s(splat.depth), simd.splat_f32s(splat.scalar));
            for block_row in first_row / height..past_row.div_ceil(height) {
                let row = distance(top + block_row * height, splat.base[1]);
                let dy = simd.add_f32s(simd.add_f32s(simd.splat_f32s(row), lane_y), offset_y);
                let shear = simd.mul_f32s(l12, dy);
                let across = simd.mul_f32s(l22, dy);
                let across = simd.mul_f32s(across, across);
                for block_column in first_column / width..past_column.div_ceil(width) {
                    let column = distance(left + block_column * width, splat.base[0]);
                    let dx = simd.add_f32s(simd.add_f32s(simd.splat_f32s(column), lane_x), offset_x);
                    let along = simd.mul_add_e_f32s(l11, dx, shear);
                    let exponent = simd.mul_add_e_f32s(along, along, across);
                    let falloff = exp2.of_negative(simd, exponent);
                    let alpha = simd.min_f32s(max_alpha, simd.mul_f32s(opacity, falloff));

                    let place = block_row * blocks_across + block_column;
                    let Some(before) = transmittance.get_mut(place) else { continue };
                    let weight = simd.mul_f32s(alpha, *before);
                    let after = simd.sub_f32s(*before, weight);
                    let seen = simd.greater_than_or_equal_f32s(alpha, min_alpha);
                    let open = simd.greater_than_f32s(after, min_transmittance);
                    let hit = simd.and_m32s(seen, open);
                    let weight = simd.select_f32s(hit, weight, zero);
                    if EXTRA
                        && let (Some(depth), Some(scalar), Some(median)) =
                            (depth.get_mut(place), scalar.get_mut(place), median.get_mut(place))
                    {
                        *depth = simd.mul_add_e_f32s(weight, z, *depth);
                        *scalar = simd.mul_add_e_f32s(weight, u, *scalar);
                        let crosses = simd.and_m32s(
                            hit,
                            simd.and_m32s(
                                simd.greater_than_f32s(*before, half),
                                simd.greater_than_or_equal_f32s(half, after),
                            ),
                        );
                        *median = simd.select_f32s(crosses, z, *median);
                    }
                    let closed = simd.neg_f32s(simd.abs_f32s(*before));
                    *before = simd.select_f32s(seen, simd.select_f32s(open, after, closed), *before);
                    if let (Some(red), Some(green), Some(blue)) =
                        (red.get_mut(place), green.get_mut(place), blue.get_mut(place))
                    {
                        *red = simd.mul_add_e_f32s(weight, r, *red);
                        *green = simd.mul_add_e_f32s(weight, g, *green);
                        *blue = simd.mul_add_e_f32s(weight, b, *blue);
                    }
                }
            }
        }
        next = if finished(simd, transmittance) { None } else { batches.next() };
    }
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
fn finished<S: Simd>(simd: S, transmittance: &[S::f32s]) -> bool {
    let mut most = simd.splat_f32s(-1.0);
    for value in transmittance {
        most = simd.max_f32s(most, *value);
    }
    simd.reduce_max_f32s(most) <= 0.0
}

/// `2^(−x)` for `x ≥ 0`, to 2 units in the last place down to `2^−20`, below which it is 0: far from denormals,
/// and no opacity that small is ever drawn.
struct Exp2<S: Simd> {
    rounder: S::f32s,
    coefficients: [S::f32s; 6],
    one: S::f32s,
    limit: S::f32s,
    mantissa_bits: S::u32s,
}

impl<S: Simd> Exp2<S> {
    #[inline(always)]
    fn new(simd: S) -> Self {
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
