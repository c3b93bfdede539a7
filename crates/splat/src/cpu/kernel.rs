use atsplat_camera::ImageSize;
use pulp::{Simd, WithSimd};

use super::block::{BATCH, Ellipse, Exp2, Grid, Limits, Passed, block_size, finished, passed_on, read_batch};

use super::Band;
use super::project::Splat;
use crate::RenderOptions;

/// What all tiles share.
pub(super) struct Paint<'a> {
    pub(super) options: &'a RenderOptions,
    pub(super) background: [f32; 3],
    pub(super) size: ImageSize,
    pub(super) splats: &'a [Splat],
    /// Whether depth and scalar are composited too.
    pub(super) extra: bool,
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

    /// Calls `with` for each of the tile's pixels inside the picture: its number there, and its place here.
    pub(super) fn for_pixels(&self, at: (usize, usize), size: ImageSize, mut with: impl FnMut(usize, usize)) {
        let (width, height) = (size.width as usize, size.height as usize);
        let (left, top) = (at.0 * self.side, at.1 * self.side);
        for row in 0..self.side.min(height.saturating_sub(top)) {
            for column in 0..self.side.min(width.saturating_sub(left)) {
                with((top + row) * width + left + column, self.place(column, row));
            }
        }
    }

    /// What a pixel was composited to, the background apart.
    pub(super) fn ended(&self, place: usize) -> Ended {
        let value = |values: &[f32]| values.get(place).copied().unwrap_or_default();
        let [red, green, blue, depth, scalar, median_depth] = &self.channels;
        Ended {
            rgb: [value(red), value(green), value(blue)],
            transmittance: value(&self.transmittance).abs(),
            depth: value(depth),
            scalar: value(scalar),
            median_depth: value(median_depth),
        }
    }

    /// Writes the pixels into the images, over the background.
    pub(super) fn copy_to(&self, band: &mut Band<'_>, at: (usize, usize), paint: &Paint<'_>) {
        let before = at.1 * self.side * paint.size.width as usize;
        self.for_pixels(at, paint.size, |pixel, place| {
            let (pixel, ended) = (pixel - before, self.ended(place));
            if let (Some(rgb), Some(alpha)) = (band.rgb.get_mut(pixel), band.alpha.get_mut(pixel)) {
                *alpha = 1.0 - ended.transmittance;
                for ((slot, behind), value) in rgb.iter_mut().zip(paint.background).zip(ended.rgb) {
                    *slot = behind * ended.transmittance + value;
                }
            }
            for (image, value) in [
                (&mut band.depth, ended.depth),
                (&mut band.scalar, ended.scalar),
                (&mut band.median_depth, ended.median_depth),
            ] {
                if let Some(slot) = image.as_mut().and_then(|image| image.get_mut(pixel)) {
                    *slot = value;
                }
            }
        });
    }
}

/// A pixel when all splats are through.
pub(super) struct Ended {
    pub(super) rgb: [f32; 3],
    pub(super) transmittance: f32,
    pub(super) depth: f32,
    pub(super) scalar: f32,
    pub(super) median_depth: f32,
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
        // The common case pays nothing for images that nobody asked for.
        if self.paint.extra {
            render::<S, true>(simd, self);
        } else {
            render::<S, false>(simd, self);
        }
    }
}

#[inline(always)]
fn render<S: Simd, const EXTRA: bool>(simd: S, Render { paint, list, at, tile }: Render<'_>) {
    tile.clear(block_size::<S>());
    let grid = Grid::<S>::new(simd, tile.side, at);
    let limits = Limits::<S>::new(simd, &paint.options.constants);
    let (zero, half) = (simd.splat_f32s(0.0), simd.splat_f32s(0.5));
    let exp2 = Exp2::new(simd);

    let (transmittance, _) = S::as_mut_simd_f32s(&mut tile.transmittance);
    let [red, green, blue, depth, scalar, median] = &mut tile.channels;
    let [red, green, blue, depth, scalar, median] =
        [red, green, blue, depth, scalar, median].map(|channel| S::as_mut_simd_f32s(channel).0);

    let mut batch = [Splat::default(); BATCH];
    let mut batches = list.chunks(BATCH);
    let mut next = batches.next();
    while let Some(indices) = next {
        for splat in read_batch(&mut batch, indices, paint.splats) {
            let ellipse = Ellipse::new(simd, splat);
            let [r, g, b] = splat.rgb.map(|value| simd.splat_f32s(value));
            let (z, u) = (simd.splat_f32s(splat.depth), simd.splat_f32s(splat.scalar));
            let (columns, rows) = grid.blocks_of(splat);
            for block_row in rows {
                let row = ellipse.row(simd, &grid, block_row);
                for block_column in columns.clone() {
                    let (_, falloff) = ellipse.at(simd, &grid, &exp2, &row, block_column);
                    let alpha = simd.min_f32s(limits.max_alpha, simd.mul_f32s(ellipse.opacity, falloff));
                    let place = block_row * grid.across + block_column;
                    let Some(before) = transmittance.get_mut(place) else { continue };
                    let Passed { weight, after, seen, open, hit } = limits.pass(simd, alpha, *before);
                    let weight = simd.select_f32s(hit, weight, zero);
                    if EXTRA
                        && let (Some(depth), Some(scalar), Some(median)) =
                            (depth.get_mut(place), scalar.get_mut(place), median.get_mut(place))
                    {
                        *depth = simd.mul_add_e_f32s(weight, z, *depth);
                        *scalar = simd.mul_add_e_f32s(weight, u, *scalar);
                        let from_above = simd.greater_than_f32s(*before, half);
                        let to_below = simd.greater_than_or_equal_f32s(half, after);
                        let crosses = simd.and_m32s(hit, simd.and_m32s(from_above, to_below));
                        *median = simd.select_f32s(crosses, z, *median);
                    }
                    *before = passed_on(simd, seen, open, *before, after);
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
