//! Products in blocks of 32×32, from tiles of rounded numbers; a [`Kernel`] computes one block.

use rayon::prelude::*;

use super::super::matrix::{Matrix, Output, Threads, Write};
use super::buffer::Buffer;
use super::pack::{LANES, Order, TERMS, Tile, pack};

/// Rows and columns of a block of the result, which is four tiles.
pub(super) const BLOCK: usize = 2 * LANES;
/// Products of fewer multiplications stay on one thread.
const MIN_PARALLEL: usize = 1 << 18;

/// Instructions that multiply tiles, ready on this thread while the value lives.
pub(super) trait Kernel {
    /// Makes them ready.
    fn begin() -> Self;

    /// Computes, or adds to, 32 rows of 32 values that are `row_stride` apart.
    ///
    /// # Panics
    /// As [`BlockFactors::check`].
    fn multiply(&self, factors: BlockFactors<'_>, out: &mut [f32], row_stride: usize, add: bool);
}

/// The factors of a block, each over all terms.
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockFactors<'a> {
    /// The first and the last 16 rows of the left matrix, in [`Order::Lanes`].
    pub(super) rows: [&'a [Tile]; 2],
    /// The first and the last 16 columns of the right matrix, in [`Order::Pairs`].
    pub(super) columns: [&'a [Tile]; 2],
}

impl BlockFactors<'_> {
    /// The number of tiles of each factor.
    ///
    /// # Panics
    /// If the factors differ in it, or `out` is too short for a block.
    pub(super) fn check(&self, out: &[f32], row_stride: usize) -> usize {
        let depth = self.rows[0].len();
        assert!(self.rows.iter().chain(&self.columns).all(|factor| factor.len() == depth), "terms of a block");
        assert!((BLOCK - 1) * row_stride + BLOCK <= out.len() && row_stride >= BLOCK, "a block of 32×32");
        depth
    }
}

/// A factor in tiles: panels of 16 of its rows (the left one) or columns (the right one), each over all terms. There is an even
/// number of panels.
#[derive(Debug)]
pub(in super::super) struct Panels {
    tiles: Buffer,
    /// Tiles of a panel.
    depth: usize,
    /// Rows or columns.
    lanes: usize,
    terms: usize,
}

impl Panels {
    /// The rows of a left factor.
    pub(super) fn of_rows(left: Matrix<'_>) -> Self {
        Self::new(left, Order::Lanes, false)
    }

    /// The columns of a right factor.
    pub(super) fn of_columns(right: Matrix<'_>) -> Self {
        Self::new(right.transposed(), Order::Pairs, false)
    }

    fn new(lanes: Matrix<'_>, order: Order, parallel: bool) -> Self {
        let depth = lanes.columns.div_ceil(TERMS);
        let mut tiles = Buffer::take(lanes.rows.div_ceil(BLOCK) * 2 * depth);
        let pack = |(at, tiles): (usize, &mut [Tile])| pack(lanes, at * LANES, order, tiles);
        // Without terms there is nothing to pack.
        let panel = depth.max(1);
        if parallel {
            tiles.par_chunks_mut(panel).enumerate().for_each(pack);
        } else {
            tiles.chunks_mut(panel).enumerate().for_each(pack);
        }
        Self { tiles, depth, lanes: lanes.rows, terms: lanes.columns }
    }

    /// The two panels of a block.
    fn pair(&self, block: usize) -> [&[Tile]; 2] {
        [2 * block, 2 * block + 1].map(|panel| &self.tiles[panel * self.depth..(panel + 1) * self.depth])
    }
}

/// `left · right` into `out`, blocks of rows in parallel if requested.
///
/// # Panics
/// If the shapes do not fit together.
pub(super) fn multiply<K: Kernel>(
    out: Output<'_>,
    left: Matrix<'_>,
    right: Matrix<'_>,
    write: Write,
    threads: Threads,
) {
    assert_eq!(left.columns, right.rows, "inner sizes of a product");
    assert_eq!([out.rows, out.columns], [left.rows, right.columns], "outer sizes of a product");
    let work = out.rows.saturating_mul(out.columns).saturating_mul(left.columns);
    let parallel = threads == Threads::All && work >= MIN_PARALLEL;
    let right = Panels::new(right.transposed(), Order::Pairs, parallel);
    let rows = |(at, out): (usize, Output<'_>)| {
        // Rows are packed where they are used, so that they are still in the cache.
        let first = at * BLOCK;
        let mut packed = Buffer::take(2 * right.depth);
        let (upper, lower) = packed.split_at_mut(right.depth);
        pack(left, first, Order::Lanes, upper);
        pack(left, first + LANES, Order::Lanes, lower);
        multiply_rows(&K::begin(), out, [upper, lower], &right, write);
    };
    if parallel {
        blocks_of_rows(out).into_par_iter().enumerate().for_each(rows);
    } else {
        blocks_of_rows(out).into_iter().enumerate().for_each(rows);
    }
}

/// `left · right` into `out` on this thread.
///
/// # Panics
/// If the shapes do not fit together.
pub(super) fn multiply_panels<K: Kernel>(out: Output<'_>, left: &Panels, right: &Panels, write: Write) {
    assert_eq!(left.terms, right.terms, "inner sizes of a product");
    assert_eq!([out.rows, out.columns], [left.lanes, right.lanes], "outer sizes of a product");
    let kernel = K::begin();
    for (at, out) in blocks_of_rows(out).into_iter().enumerate() {
        multiply_rows(&kernel, out, left.pair(at), right, write);
    }
}

/// The result in parts of up to 32 rows.
fn blocks_of_rows(out: Output<'_>) -> Vec<Output<'_>> {
    let Output { data, rows, columns, row_stride } = out;
    if rows == 0 || columns == 0 {
        return Vec::new();
    }
    let data = &mut data[..(rows - 1) * row_stride + columns];
    let blocks = data.chunks_mut(BLOCK * row_stride).enumerate();
    blocks.map(|(at, data)| Output { data, rows: BLOCK.min(rows - at * BLOCK), columns, row_stride }).collect()
}

/// Up to 32 rows of the result, from their two panels.
fn multiply_rows<K: Kernel>(kernel: &K, mut out: Output<'_>, rows: [&[Tile]; 2], right: &Panels, write: Write) {
    let add = write == Write::Add;
    for at in 0..out.columns.div_ceil(BLOCK) {
        let first_column = at * BLOCK;
        let factors = BlockFactors { rows, columns: right.pair(at) };
        let columns = BLOCK.min(out.columns - first_column);
        if out.rows == BLOCK && columns == BLOCK {
            kernel.multiply(factors, &mut out.data[first_column..], out.row_stride, add);
            continue;
        }
        // A block at the edge is computed outside the matrix.
        let mut block = [0.0; BLOCK * BLOCK];
        let for_each_row = |out: &mut Output<'_>, copy: &mut dyn FnMut(usize, &mut [f32])| {
            for row in 0..out.rows {
                copy(row, &mut out.data[row * out.row_stride + first_column..][..columns]);
            }
        };
        if add {
            for_each_row(&mut out, &mut |row, numbers| block[row * BLOCK..][..columns].copy_from_slice(numbers));
        }
        kernel.multiply(factors, &mut block, BLOCK, add);
        for_each_row(&mut out, &mut |row, numbers| numbers.copy_from_slice(&block[row * BLOCK..][..columns]));
    }
}
