//! The derivative of compositing: each tile once more from front to back, knowing what its pixels ended as.

use pulp::{Simd, WithSimd};

use super::block::{BATCH, Ellipse, Exp2, Grid, Limits, Passed, block_size, finished, passed_on, read_batch};
use super::kernel::{Paint, Tile};
use super::project::Splat;
use crate::ImageGradients;
use crate::constants::ClampedGradient;

/// Sums over a tile's pixels for one splat. `e` is the derivative by the exponent `½ dᵀ Σ⁻¹ d`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sums {
    /// `Σ e`.
    pub(super) e: f32,
    /// `Σ e·dx`, `Σ e·dy`.
    pub(super) first: [f32; 2],
    /// `Σ e·dx²`, `Σ e·dx·dy`, `Σ e·dy²`.
    pub(super) second: [f32; 3],
    pub(super) rgb: [f32; 3],
    pub(super) depth: f32,
    pub(super) scalar: f32,
}

/// The derivatives by a tile's images, in the order that its pixels are kept.
#[derive(Debug)]
pub(super) struct TileGradient {
    rgb: [Vec<f32>; 3],
    depth: Vec<f32>,
    scalar: Vec<f32>,
    /// What lies behind the current splat, weighted by the derivatives: at first, the whole pixel.
    behind: Vec<f32>,
    transmittance: Vec<f32>,
}

impl TileGradient {
    pub(super) fn new(side: u32) -> Self {
        let zeros = || vec![0.0; (side * side) as usize];
        Self {
            rgb: [zeros(), zeros(), zeros()],
            depth: zeros(),
            scalar: zeros(),
            behind: zeros(),
            transmittance: zeros(),
        }
    }

    /// Takes the derivatives by a tile's pixels from the images, and what the tile was rendered to; returns the
    /// derivative by the background.
    pub(super) fn fill(
        &mut self,
        rendered: &Tile,
        at: (usize, usize),
        paint: &Paint<'_>,
        images: &ImageGradients<f32>,
    ) -> [f64; 3] {
        let mut background = [0.0; 3];
        for values in self.rgb.iter_mut().chain([&mut self.depth, &mut self.scalar, &mut self.behind]) {
            values.fill(0.0);
        }
        self.transmittance.fill(1.0);
        rendered.for_pixels(at, paint.size, |pixel, place| {
            let gradient = images.at(pixel);
            let ended = rendered.ended(place);
            let mut behind = -ended.transmittance * gradient.alpha + ended.depth * gradient.depth;
            if !paint.options.gradients.scalar_stops {
                behind += ended.scalar * gradient.scalar;
            }
            let channels = self.rgb.iter_mut().zip(gradient.rgb).zip(ended.rgb).zip(paint.background);
            for ((((image, by_channel), colour), colour_behind), sum) in channels.zip(&mut background) {
                behind += by_channel * (colour + ended.transmittance * colour_behind);
                *sum += f64::from(by_channel) * f64::from(ended.transmittance);
                put(image, place, by_channel);
            }
            put(&mut self.depth, place, gradient.depth);
            put(&mut self.scalar, place, gradient.scalar);
            put(&mut self.behind, place, behind);
        });
        background
    }
}

fn put(values: &mut [f32], place: usize, value: f32) {
    if let Some(slot) = values.get_mut(place) {
        *slot = value;
    }
}

/// Differentiates one tile; `sums` has one entry per entry of `list`.
pub(super) struct Differentiate<'a> {
    pub(super) paint: &'a Paint<'a>,
    pub(super) list: &'a [u32],
    /// Column and row of the tile.
    pub(super) at: (usize, usize),
    pub(super) side: usize,
    pub(super) gradient: &'a mut TileGradient,
    pub(super) sums: &'a mut [Sums],
}

impl WithSimd for Differentiate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Differentiate { paint, list, at, side, gradient, sums } = self;
        debug_assert_eq!(side % block_size::<S>()[0], 0);
        let grid = Grid::<S>::new(simd, side, at);
        let limits = Limits::<S>::new(simd, &paint.options.constants);
        let exp2 = Exp2::new(simd);
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let clamp_stops = paint.options.constants.clamped_gradient == ClampedGradient::Exact;
        let scalar_passes = !paint.options.gradients.scalar_stops;

        let [red, green, blue] = &gradient.rgb;
        let [red, green, blue] = [red, green, blue].map(|image| S::as_simd_f32s(image).0);
        let [depth, scalar] = [&gradient.depth, &gradient.scalar].map(|image| S::as_simd_f32s(image).0);
        let (behind, _) = S::as_mut_simd_f32s(&mut gradient.behind);
        let (transmittance, _) = S::as_mut_simd_f32s(&mut gradient.transmittance);

        let mut batch = [Splat::default(); BATCH];
        let mut batches = list.chunks(BATCH).zip(sums.chunks_mut(BATCH));
        let mut next = batches.next();
        while let Some((indices, sums)) = next {
            for (splat, sums) in read_batch(&mut batch, indices, paint.splats).iter().zip(sums) {
                let ellipse = Ellipse::new(simd, splat);
                let [r, g, b] = splat.rgb.map(|value| simd.splat_f32s(value));
                let (z, u) = (simd.splat_f32s(splat.depth), simd.splat_f32s(splat.scalar));
                let mut total = [zero; 11];
                let (columns, rows) = grid.blocks_of(splat);
                for block_row in rows {
                    let row = ellipse.row(simd, &grid, block_row);
                    for block_column in columns.clone() {
                        let (dx, falloff) = ellipse.at(simd, &grid, &exp2, &row, block_column);
                        let full = simd.mul_f32s(ellipse.opacity, falloff);
                        let alpha = simd.min_f32s(limits.max_alpha, full);
                        let place = block_row * grid.across + block_column;
                        let (Some(before), Some(behind)) = (transmittance.get_mut(place), behind.get_mut(place)) else {
                            continue;
                        };
                        let Passed { weight, after, seen, open, hit } = limits.pass(simd, alpha, *before);
                        let of = |image: &[S::f32s]| image.get(place).copied().unwrap_or(zero);
                        let by = [of(red), of(green), of(blue), of(depth), of(scalar)];
                        let weight = simd.select_f32s(hit, weight, zero);
                        for (sum, by) in total.iter_mut().skip(6).zip(by) {
                            *sum = simd.mul_add_e_f32s(weight, by, *sum);
                        }
                        let mut shown = simd.mul_f32s(z, by[3]);
                        for (colour, by) in [(r, by[0]), (g, by[1]), (b, by[2])] {
                            shown = simd.mul_add_e_f32s(colour, by, shown);
                        }
                        if scalar_passes {
                            shown = simd.mul_add_e_f32s(u, by[4], shown);
                        }
                        *behind = simd.sub_f32s(*behind, simd.mul_f32s(weight, shown));
                        let left = simd.sub_f32s(one, alpha);
                        let by_alpha = simd.sub_f32s(simd.mul_f32s(*before, shown), simd.div_f32s(*behind, left));
                        let mut e = simd.neg_f32s(simd.mul_f32s(full, by_alpha));
                        e = simd.select_f32s(hit, e, zero);
                        if clamp_stops {
                            e = simd.select_f32s(simd.greater_than_f32s(full, limits.max_alpha), zero, e);
                        }
                        *before = passed_on(simd, seen, open, *before, after);
                        let (ex, ey) = (simd.mul_f32s(e, dx), simd.mul_f32s(e, row.dy));
                        total[0] = simd.add_f32s(total[0], e);
                        total[1] = simd.add_f32s(total[1], ex);
                        total[2] = simd.add_f32s(total[2], ey);
                        total[3] = simd.mul_add_e_f32s(ex, dx, total[3]);
                        total[4] = simd.mul_add_e_f32s(ex, row.dy, total[4]);
                        total[5] = simd.mul_add_e_f32s(ey, row.dy, total[5]);
                    }
                }
                let [e, x, y, xx, xy, yy, red, green, blue, depth, scalar] = total.map(|sum| simd.reduce_sum_f32s(sum));
                *sums = Sums { e, first: [x, y], second: [xx, xy, yy], rgb: [red, green, blue], depth, scalar };
            }
            next = if finished(simd, transmittance) { None } else { batches.next() };
        }
    }
}
