//! From pixels as they are composited, cell by cell, to images.

use rayon::prelude::*;

use super::Paint;
use super::batch::{BLOCK, BLOCKS, CELL, Cell, LANES};
use super::bins::Tiling;
use super::composite::kept;
use crate::Rendering;

/// How a tiling's pixels are kept: cell by cell, each of them `stride` values.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    pub(super) tiling: Tiling,
    /// Cells along a side of a tile.
    cells: usize,
    /// Blocks along a side of a cell.
    across: usize,
    pub(super) extra: bool,
}

impl Layout {
    pub(super) fn new(tiling: Tiling, extra: bool) -> Self {
        let cell = if tiling.side < CELL { tiling.side } else { CELL };
        Self { tiling, cells: tiling.side / cell, across: cell / BLOCK, extra }
    }

    /// Values of one cell.
    pub(super) const fn stride(self) -> usize {
        self.across * self.across * LANES * kept(self.extra)
    }

    /// Values of one tile.
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

    /// Where the four pixels from `(4·column, row)` on begin, of what is kept first.
    fn quad(self, column: usize, row: usize) -> usize {
        let blocks = self.tiling.side / BLOCK;
        let (tile_column, block_column) = (column / blocks, column % blocks);
        let (tile_row, row) = (row / self.tiling.side, row % self.tiling.side);
        let block_row = row / BLOCK;
        let cell = block_row / self.across * self.cells + block_column / self.across;
        let block = block_row % self.across * self.across + block_column % self.across;
        let tile = tile_row * self.tiling.columns + tile_column;
        tile * self.per_tile() + cell * self.stride() + block % BLOCKS * LANES * kept(self.extra) + row % BLOCK * BLOCK
    }
}

/// Writes what was composited into images, over the background.
pub(super) fn write(layout: Layout, pixels: &[f32], paint: &Paint<'_>, rendering: &mut Rendering<f32>) {
    let width = paint.size.width as usize;
    let Rendering { rgb, alpha, depth, scalar, median_depth, .. } = rendering;
    let quads = |row: usize| {
        let quad = move |column: usize, of: usize| -> &[f32] {
            let from = layout.quad(column, row) + of * LANES;
            pixels.get(from..from + BLOCK).unwrap_or_default()
        };
        (0..width.div_ceil(BLOCK)).map(move |column| (column, quad))
    };
    rgb.par_chunks_mut(width).zip(alpha.par_chunks_mut(width)).enumerate().for_each(|(row, (rgb, alpha))| {
        for ((column, quad), (rgb, alpha)) in quads(row).zip(rgb.chunks_mut(BLOCK).zip(alpha.chunks_mut(BLOCK))) {
            let [transmittance, red, green, blue] = [0, 1, 2, 3].map(|of| quad(column, of));
            let colours = red.iter().zip(green).zip(blue);
            for (((rgb, alpha), transmittance), ((red, green), blue)) in
                rgb.iter_mut().zip(alpha).zip(transmittance).zip(colours)
            {
                let through = transmittance.abs();
                let [behind_red, behind_green, behind_blue] = paint.background.map(|channel| channel * through);
                *rgb = [behind_red + red, behind_green + green, behind_blue + blue];
                *alpha = 1.0 - through;
            }
        }
    });
    for (of, image) in [(4, depth), (5, scalar), (6, median_depth)] {
        let Some(image) = image else { continue };
        image.par_chunks_mut(width).enumerate().for_each(|(row, values)| {
            for ((column, quad), values) in quads(row).zip(values.chunks_mut(BLOCK)) {
                values.iter_mut().zip(quad(column, of)).for_each(|(slot, value)| *slot = *value);
            }
        });
    }
}
