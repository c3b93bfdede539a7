//! Rounding of matrices to bfloat16 in the layout of tile registers, by AVX-512.

#![expect(unsafe_code, reason = "vector loads and stores take pointers")]

use std::arch::x86_64::{
    __m256bh, __m256i, __m512bh, __m512i, _mm512_cvtepu16_epi32, _mm512_cvtne2ps_pbh, _mm512_cvtneps_pbh,
    _mm512_load_si512, _mm512_loadu_ps, _mm512_or_si512, _mm512_shuffle_i32x4, _mm512_slli_epi32, _mm512_store_si512,
    _mm512_unpackhi_epi32, _mm512_unpackhi_epi64, _mm512_unpacklo_epi32, _mm512_unpacklo_epi64,
};
use std::mem::transmute;

use super::super::matrix::Matrix;

/// Rows or columns of a tile.
pub(super) const LANES: usize = 16;
/// Terms of a tile's sums.
pub(super) const TERMS: usize = 32;

/// What a tile register holds: 16 rows of 64 bytes. A number is a pair of bfloat16, the first term in its lower half.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Tile([[u32; 16]; 16]);

impl Tile {
    pub(super) const ZERO: Self = Self([[0; 16]; 16]);

    /// All rows.
    pub(super) const fn rows(&self) -> &[[u32; 16]; 16] {
        &self.0
    }
}

/// Which of a tile's indices comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    /// Rows of the left matrix: each has all its pairs of terms.
    Lanes,
    /// Columns of the right matrix: all of them for one pair of terms, then for the next.
    Pairs,
}

pub(super) fn has_instructions() -> bool {
    is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512bf16")
}

/// Rounds 16 lanes of a matrix (rows of the left one; columns of the right one, given transposed) into tiles, one for each 32 terms.
/// Numbers outside the matrix are 0.
///
/// # Panics
/// Without [`has_instructions`].
pub(super) fn pack(lanes: Matrix<'_>, first: usize, order: Order, tiles: &mut [Tile]) {
    assert!(has_instructions(), "AVX-512 with bfloat16");
    if first < lanes.rows {
        // SAFETY: the instructions exist.
        unsafe { pack_lanes(lanes, first, order, tiles) };
    } else {
        tiles.fill(Tile::ZERO);
    }
}

#[target_feature(enable = "avx512f,avx512bw,avx512bf16")]
fn pack_lanes(lanes: Matrix<'_>, first: usize, order: Order, tiles: &mut [Tile]) {
    let count = LANES.min(lanes.rows - first);
    let [lane_stride, term_stride] = lanes.strides;
    // Of a single column, terms are apart.
    let by_terms = term_stride == 1;
    let found = if by_terms { Order::Lanes } else { Order::Pairs };
    for (at, tile) in tiles.iter_mut().enumerate() {
        let first_term = at * TERMS;
        let terms = TERMS.min(lanes.columns - first_term);
        let data = &lanes.data[first * lane_stride + first_term * term_stride..];
        let adjacent = by_terms || lane_stride == 1;
        if count == LANES && terms == TERMS && adjacent {
            if by_terms { of_terms(data, lane_stride, tile) } else { of_lanes(data, term_stride, tile) }
        } else {
            edge(data, [lane_stride, term_stride], [count, terms], by_terms, tile);
        }
        if found != order {
            transpose(tile);
        }
    }
}

/// A tile at the edge of the matrix, by way of a copy with zeros.
#[target_feature(enable = "avx512f,avx512bw,avx512bf16")]
fn edge(
    data: &[f32],
    [lane_stride, term_stride]: [usize; 2],
    [lanes, terms]: [usize; 2],
    by_terms: bool,
    tile: &mut Tile,
) {
    let mut copy = [0.0; LANES * TERMS];
    let strides = if by_terms { [TERMS, 1] } else { [1, LANES] };
    for lane in 0..lanes {
        for term in 0..terms {
            copy[lane * strides[0] + term * strides[1]] = data[lane * lane_stride + term * term_stride];
        }
    }
    if by_terms { of_terms(&copy, TERMS, tile) } else { of_lanes(&copy, LANES, tile) }
}

/// Terms are adjacent: a row of pairs for each lane.
#[target_feature(enable = "avx512f,avx512bw,avx512bf16")]
fn of_terms(data: &[f32], stride: usize, tile: &mut Tile) {
    for (lane, row) in tile.0.iter_mut().enumerate() {
        let terms = &data[lane * stride..][..TERMS];
        // SAFETY: 32 numbers are read from a slice of 32.
        let [first, second] = unsafe { [_mm512_loadu_ps(terms.as_ptr()), _mm512_loadu_ps(terms.as_ptr().add(16))] };
        // SAFETY: both are 64 bytes without invalid values.
        *row = unsafe { transmute::<__m512bh, [u32; 16]>(_mm512_cvtne2ps_pbh(second, first)) };
    }
}

/// Lanes are adjacent: a row of lanes for each pair of terms.
#[target_feature(enable = "avx512f,avx512bw,avx512bf16")]
fn of_lanes(data: &[f32], stride: usize, tile: &mut Tile) {
    for (pair, row) in tile.0.iter_mut().enumerate() {
        let [first, second] = [2 * pair, 2 * pair + 1].map(|term| {
            let lanes = &data[term * stride..][..LANES];
            // SAFETY: 16 numbers are read from a slice of 16; conversion between types of 32 bytes without invalid values.
            unsafe {
                _mm512_cvtepu16_epi32(transmute::<__m256bh, __m256i>(_mm512_cvtneps_pbh(_mm512_loadu_ps(
                    lanes.as_ptr(),
                ))))
            }
        });
        let pairs = _mm512_or_si512(first, _mm512_slli_epi32::<16>(second));
        // SAFETY: a row has 64 bytes.
        unsafe { _mm512_store_si512(row.as_mut_ptr().cast(), pairs) };
    }
}

/// Exchanges rows and columns: of pairs, of quadruples, then of blocks of four.
#[target_feature(enable = "avx512f")]
fn transpose(tile: &mut Tile) {
    // SAFETY: each row has 64 bytes, and tiles are aligned to 64.
    let rows: [__m512i; 16] = std::array::from_fn(|row| unsafe { _mm512_load_si512(tile.0[row].as_ptr().cast()) });
    let pairs: [__m512i; 16] = std::array::from_fn(|at| {
        let [a, b] = [rows[at & !1], rows[at | 1]];
        if at & 1 == 0 { _mm512_unpacklo_epi32(a, b) } else { _mm512_unpackhi_epi32(a, b) }
    });
    let fours: [__m512i; 16] = std::array::from_fn(|at| {
        let (base, half) = (at & !3, (at >> 1) & 1);
        let [a, b] = [pairs[base + half], pairs[base + 2 + half]];
        if at & 1 == 0 { _mm512_unpacklo_epi64(a, b) } else { _mm512_unpackhi_epi64(a, b) }
    });
    // `fours[4 g + c]` has columns c, 4 + c, 8 + c, 12 + c of rows 4 g to 4 g + 3.
    for column in 0..4 {
        let [a, b, c, d] = [0, 4, 8, 12].map(|group| fours[group + column]);
        let [even_ab, odd_ab] = [_mm512_shuffle_i32x4::<0x88>(a, b), _mm512_shuffle_i32x4::<0xdd>(a, b)];
        let [even_cd, odd_cd] = [_mm512_shuffle_i32x4::<0x88>(c, d), _mm512_shuffle_i32x4::<0xdd>(c, d)];
        let out = [
            _mm512_shuffle_i32x4::<0x88>(even_ab, even_cd),
            _mm512_shuffle_i32x4::<0x88>(odd_ab, odd_cd),
            _mm512_shuffle_i32x4::<0xdd>(even_ab, even_cd),
            _mm512_shuffle_i32x4::<0xdd>(odd_ab, odd_cd),
        ];
        for (block, row) in out.into_iter().enumerate() {
            // SAFETY: each row has 64 bytes, and tiles are aligned to 64.
            unsafe { _mm512_store_si512(tile.0[4 * block + column].as_mut_ptr().cast(), row) };
        }
    }
}
