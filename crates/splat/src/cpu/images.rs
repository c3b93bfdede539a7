//! From composited pixels, stored cell by cell, to row-major images.

use rayon::prelude::*;

use super::batch::{BLOCK, CELL, Cell, LANES};
use super::bins::Tiling;
use super::composite::{self, plane_count};
use super::{RasterParams, has_extra_channels};
use crate::{RenderOptions, Rendering, View};

/// How a tiling's pixels are stored: cell by cell, each of them `stride` values.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    pub(super) tiling: Tiling,
    /// Cells per side of a tile.
    cells: usize,
    /// Blocks per side of a cell.
    across: usize,
    pub(super) extra: bool,
}

impl Layout {
    pub(super) fn new(tiling: Tiling, extra: bool) -> Self {
        let cell = if tiling.side < CELL { tiling.side } else { CELL };
        Self { tiling, cells: tiling.side / cell, across: cell / BLOCK, extra }
    }

    /// The layout of a view's pixels in tiles of `tile` pixels a side.
    pub(super) fn of(view: &View, options: &RenderOptions, tile: u32) -> Self {
        Self::new(Tiling::new(view.size, tile), has_extra_channels(options))
    }

    /// Number of values per cell.
    pub(super) const fn stride(self) -> usize {
        self.across * self.across * LANES * plane_count(self.extra)
    }

    /// Number of values per tile.
    pub(super) const fn per_tile(self) -> usize {
        self.stride() * self.cells * self.cells
    }

    /// The cells of a tile, row by row.
    pub(super) fn cells(self, tile: usize) -> impl Iterator<Item = Cell> {
        let (column, row) = (tile % self.tiling.columns, tile / self.tiling.columns);
        (0..self.cells * self.cells).map(move |cell| Cell {
            left: column * self.tiling.side + cell % self.cells * CELL,
            top: row * self.tiling.side + cell / self.cells * CELL,
            across: self.across,
        })
    }

    /// Offsets of each four pixels of a row, from left to right, in the first plane.
    fn quads(self, row: usize) -> impl Iterator<Item = usize> {
        let Self { tiling, cells, across, .. } = self;
        let (tile_row, within) = (row / tiling.side, row % tiling.side);
        let block_row = within / BLOCK;
        let block = LANES * plane_count(self.extra);
        let first = block_row % across * across * block + within % BLOCK * BLOCK;
        (0..tiling.columns).flat_map(move |column| {
            let tile = (tile_row * tiling.columns + column) * self.per_tile();
            (0..cells).flat_map(move |cell| {
                let cell = tile + (block_row / across * cells + cell) * self.stride();
                (0..across).map(move |at| cell + first + at * block)
            })
        })
    }
}

/// Writes the composited pixels over the background into the images.
pub(super) fn write(layout: Layout, pixels: &[f32], params: &RasterParams<'_>, rendering: &mut Rendering<f32>) {
    let width = params.size.width as usize;
    let Rendering { rgb, alpha, depth, scalar, median_depth, .. } = rendering;
    let [behind_red, behind_green, behind_blue] = params.background;
    let colour = |transmittance: &[f32; BLOCK], red: &[f32; BLOCK], green: &[f32; BLOCK], blue: &[f32; BLOCK]| {
        let through = transmittance.map(f32::abs);
        let over: [[f32; 3]; BLOCK] = std::array::from_fn(|n| {
            [behind_red * through[n] + red[n], behind_green * through[n] + green[n], behind_blue * through[n] + blue[n]]
        });
        (over, through.map(|through| 1.0 - through))
    };
    rgb.par_chunks_mut(width).zip(alpha.par_chunks_mut(width)).enumerate().for_each(|(row, (rgb, alpha))| {
        for (from, (rgb, alpha)) in layout.quads(row).zip(rgb.chunks_mut(BLOCK).zip(alpha.chunks_mut(BLOCK))) {
            #[expect(clippy::expect_used, reason = "every plane has four pixels per row of a block")]
            let quad = |plane: usize| pixels[from + plane * LANES..].first_chunk().expect("four pixels");
            let (red, green, blue) = (quad(composite::RGB), quad(composite::RGB + 1), quad(composite::RGB + 2));
            let (over, opaque) = colour(quad(composite::TRANSMITTANCE), red, green, blue);
            rgb.iter_mut().zip(over).for_each(|(slot, value)| *slot = value);
            alpha.iter_mut().zip(opaque).for_each(|(slot, value)| *slot = value);
        }
    });
    for (plane, image) in
        [(composite::DEPTH, depth), (composite::SCALAR, scalar), (composite::MEDIAN_DEPTH, median_depth)]
    {
        let Some(image) = image else { continue };
        image.par_chunks_mut(width).enumerate().for_each(|(row, values)| {
            for (from, values) in layout.quads(row).zip(values.chunks_mut(BLOCK)) {
                let quad = &pixels[from + plane * LANES..];
                values.iter_mut().zip(quad).for_each(|(slot, value)| *slot = *value);
            }
        });
    }
}
