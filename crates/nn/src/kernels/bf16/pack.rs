use pulp::{Simd, WithSimd};

use super::super::matrix::Matrix;
use super::super::simd;
use super::rounded_bits;

/// Rows or columns of a tile.
pub(super) const LANES: usize = 16;
/// Terms of a tile's sums.
pub(super) const TERMS: usize = 32;
const PAIRS: usize = TERMS / 2;

/// What a tile register holds: 16 rows of 64 bytes. A number is a pair of bfloat16, the first term in its lower half.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Tile([u32; LANES * PAIRS]);

impl Tile {
    pub(super) const ZERO: Self = Self([0; LANES * PAIRS]);
}

/// Which of a tile's indices comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    /// Rows of the left matrix: each holds all its pairs of terms.
    Lanes,
    /// Columns of the right matrix: all of them for one pair of terms, then for the next.
    Pairs,
}

/// Rounds 16 lanes of a matrix (rows of the left one, columns of the right one) into tiles, one for each 32 terms; what lies outside
/// the matrix is 0.
pub(super) struct Pack<'a> {
    /// The left matrix, or the right one transposed.
    pub(super) lanes: Matrix<'a>,
    pub(super) first: usize,
    pub(super) order: Order,
    pub(super) tiles: &'a mut [Tile],
}

impl Pack<'_> {
    pub(super) fn run(self) {
        simd::run(self);
    }
}

impl WithSimd for Pack<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { lanes, first, order, tiles } = self;
        let count = LANES.min(lanes.rows - first);
        let [lane_stride, term_stride] = lanes.strides;
        for (at, tile) in tiles.iter_mut().enumerate() {
            let first_term = at * TERMS;
            let terms = TERMS.min(lanes.columns - first_term);
            let data = &lanes.data[first * lane_stride + first_term * term_stride..];
            let full = count == LANES && terms == TERMS;
            let found = if term_stride == 1 {
                if full {
                    by_terms_full(data, lane_stride, tile)
                } else {
                    by_terms(data, lane_stride, [count, terms], tile)
                }
                Order::Lanes
            } else {
                if full {
                    by_lanes_full(data, term_stride, tile)
                } else {
                    by_lanes(data, [lane_stride, term_stride], [count, terms], tile)
                }
                Order::Pairs
            };
            if found != order {
                transpose(tile);
            }
        }
    }
}

#[inline(always)]
const fn pair(first: f32, second: f32) -> u32 {
    rounded_bits(second) | rounded_bits(first) >> 16
}

/// Terms are adjacent: one row of pairs per lane.
#[inline(always)]
fn by_terms_full(data: &[f32], stride: usize, tile: &mut Tile) {
    for (lane, out) in tile.0.chunks_exact_mut(PAIRS).enumerate() {
        let row = &data[lane * stride..][..TERMS];
        for (out, terms) in out.iter_mut().zip(row.chunks_exact(2)) {
            *out = pair(terms[0], terms[1]);
        }
    }
}

#[inline(always)]
fn by_terms(data: &[f32], stride: usize, [lanes, terms]: [usize; 2], tile: &mut Tile) {
    for (lane, out) in tile.0.chunks_exact_mut(PAIRS).enumerate() {
        let mut row = [0.0; TERMS];
        if lane < lanes {
            row[..terms].copy_from_slice(&data[lane * stride..][..terms]);
        }
        for (out, terms) in out.iter_mut().zip(row.chunks_exact(2)) {
            *out = pair(terms[0], terms[1]);
        }
    }
}

/// Lanes are adjacent: one row of lanes per pair of terms.
#[inline(always)]
fn by_lanes_full(data: &[f32], stride: usize, tile: &mut Tile) {
    for (at, out) in tile.0.chunks_exact_mut(LANES).enumerate() {
        let (first, second) = (&data[2 * at * stride..][..LANES], &data[(2 * at + 1) * stride..][..LANES]);
        for (out, (first, second)) in out.iter_mut().zip(first.iter().zip(second)) {
            *out = pair(*first, *second);
        }
    }
}

#[inline(always)]
fn by_lanes(data: &[f32], [lane_stride, term_stride]: [usize; 2], [lanes, terms]: [usize; 2], tile: &mut Tile) {
    let value = |lane: usize, term: usize| {
        if lane < lanes && term < terms { data[lane * lane_stride + term * term_stride] } else { 0.0 }
    };
    for (at, out) in tile.0.chunks_exact_mut(LANES).enumerate() {
        for (lane, out) in out.iter_mut().enumerate() {
            *out = pair(value(lane, 2 * at), value(lane, 2 * at + 1));
        }
    }
}

#[inline(always)]
fn transpose(tile: &mut Tile) {
    let source = tile.0;
    for (row, out) in tile.0.chunks_exact_mut(LANES).enumerate() {
        for (column, out) in out.iter_mut().enumerate() {
            *out = source[column * LANES + row];
        }
    }
}
