//! The two passes with 256-bit vectors.
//!
//! There is no fast product of a byte and a 24-bit weight, but there is one of pairs of 16 bits (`pmaddwd`). A weight is
//! split into `high · 2¹⁵ + low`; both parts are summed separately over pairs of source pixels and combined at the end.
//! All arithmetic is modulo 2³², so the sums equal those of the portable passes.
#![expect(unsafe_code, reason = "vector loads, and calls of functions that require AVX2")]

use std::arch::x86_64::{
    __m128i, __m256i, _mm_add_epi32, _mm_extract_epi32, _mm_loadu_si128, _mm_packs_epi32, _mm_packus_epi16,
    _mm_set1_epi32, _mm_srai_epi32, _mm256_add_epi32, _mm256_broadcastsi128_si256, _mm256_castsi256_si128,
    _mm256_extracti128_si256, _mm256_loadu_si256, _mm256_madd_epi16, _mm256_packs_epi32, _mm256_packus_epi16,
    _mm256_set1_epi32, _mm256_set1_epi64x, _mm256_setr_epi8, _mm256_setzero_si256, _mm256_shuffle_epi8,
    _mm256_slli_epi32, _mm256_srai_epi32, _mm256_storeu_si256, _mm256_unpackhi_epi8, _mm256_unpacklo_epi8,
};
use std::ops::Range;

use super::coefficients::{Coefficients, PRECISION_BITS};
use super::passes::{HALF, sum_columns};

const LOW_BITS: i32 = 15;
const SHIFT: i32 = PRECISION_BITS.cast_signed();
/// Bytes of a vector.
const VECTOR_BYTES: usize = 32;
/// Source pixels per step of the horizontal pass.
const STEP: usize = 4;
/// Bytes that a step may read past the last pixel: it loads 16 where it needs 3.
const PADDING: usize = STEP * 3 + 16;

/// # Panics
/// Without AVX2.
pub(super) fn horizontal(source: &[u8], stride: usize, columns: &Coefficients, target: &mut [u8]) {
    assert!(is_x86_feature_detected!("avx2"), "AVX2 is missing");
    // SAFETY: AVX2 is available, as asserted above.
    unsafe { horizontal_pass(source, stride, columns, target) }
}

/// # Panics
/// Without AVX2.
pub(super) fn vertical(source: &[u8], stride: usize, rows: &Coefficients, target: &mut [u8]) {
    assert!(is_x86_feature_detected!("avx2"), "AVX2 is missing");
    // SAFETY: AVX2 is available, as asserted above.
    unsafe { vertical_pass(source, stride, rows, target) }
}

/// A target column: the start of its source pixels, and their split weights in steps of four.
struct Column {
    first_byte: usize,
    steps: Range<usize>,
}

/// Processes four rows at a time, so that each weight is loaded once for four rows.
#[target_feature(enable = "avx2")]
fn horizontal_pass(source: &[u8], stride: usize, columns: &Coefficients, target: &mut [u8]) {
    let mut steps: Vec<[i64; 2]> = Vec::new();
    let table: Vec<Column> = columns
        .iter()
        .map(|(start, weights)| {
            let first_step = steps.len();
            steps.extend(weights.chunks(STEP).map(split_step));
            Column { first_byte: start * 3, steps: first_step..steps.len() }
        })
        .collect();
    let mut padded: [Vec<u8>; 4] = std::array::from_fn(|_| vec![0; stride + PADDING]);
    let sources = source.chunks(stride * 4);
    let targets = target.chunks_mut(columns.len() * 12);
    for (rows, written) in sources.zip(targets) {
        for (row, copy) in rows.chunks_exact(stride).zip(&mut padded) {
            copy[..stride].copy_from_slice(row);
        }
        four_rows(&table, &steps, &padded, columns.len() * 3, written);
    }
}

/// One to four rows of the target, `written`, of `stride` bytes each.
#[target_feature(enable = "avx2")]
fn four_rows(table: &[Column], steps: &[[i64; 2]], rows: &[Vec<u8>; 4], stride: usize, written: &mut [u8]) {
    // Pixels 0 and 1 of each channel adjacent in the lower half, 2 and 3 in the upper half.
    let spread = _mm256_setr_epi8(
        0, -1, 3, -1, 1, -1, 4, -1, 2, -1, 5, -1, -1, -1, -1, -1, //
        6, -1, 9, -1, 7, -1, 10, -1, 8, -1, 11, -1, -1, -1, -1, -1,
    );
    let first_pair = _mm256_setr_epi8(
        0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 4, 5, 6, 7, 4, 5, 6, 7, 4, 5, 6, 7, 4, 5, 6, 7,
    );
    for (index, column) in table.iter().enumerate() {
        let mut low = [_mm256_setzero_si256(); 4];
        let mut high = low;
        let mut at = column.first_byte;
        for &[low_weights, high_weights] in &steps[column.steps.clone()] {
            let low_weights = _mm256_shuffle_epi8(_mm256_set1_epi64x(low_weights), first_pair);
            let high_weights = _mm256_shuffle_epi8(_mm256_set1_epi64x(high_weights), first_pair);
            for (row, (low, high)) in rows.iter().zip(low.iter_mut().zip(&mut high)) {
                let Some(bytes) = row.get(at..).and_then(<[u8]>::first_chunk) else { continue };
                let samples = _mm256_shuffle_epi8(_mm256_broadcastsi128_si256(load_half(bytes)), spread);
                *low = _mm256_add_epi32(*low, _mm256_madd_epi16(samples, low_weights));
                *high = _mm256_add_epi32(*high, _mm256_madd_epi16(samples, high_weights));
            }
            at += STEP * 3;
        }
        let sums: [__m128i; 4] = std::array::from_fn(|row| {
            let sum = _mm256_add_epi32(_mm256_slli_epi32::<LOW_BITS>(high[row]), low[row]);
            let sum = _mm_add_epi32(_mm256_castsi256_si128(sum), _mm256_extracti128_si256::<1>(sum));
            _mm_srai_epi32::<SHIFT>(_mm_add_epi32(sum, _mm_set1_epi32(HALF)))
        });
        let packed = _mm_packus_epi16(_mm_packs_epi32(sums[0], sums[1]), _mm_packs_epi32(sums[2], sums[3]));
        let pixels = [
            _mm_extract_epi32::<0>(packed),
            _mm_extract_epi32::<1>(packed),
            _mm_extract_epi32::<2>(packed),
            _mm_extract_epi32::<3>(packed),
        ];
        for (row, pixel) in written.chunks_exact_mut(stride).zip(pixels) {
            let [red, green, blue, _] = pixel.to_le_bytes();
            if let Some(out) = row.get_mut(index * 3..).and_then(<[u8]>::first_chunk_mut) {
                *out = [red, green, blue];
            }
        }
    }
}

#[target_feature(enable = "avx2")]
fn vertical_pass(source: &[u8], stride: usize, rows: &Coefficients, target: &mut [u8]) {
    let mut pairs = Vec::new();
    for ((start, weights), written) in rows.iter().zip(target.chunks_exact_mut(stride)) {
        let rows_below = &source[start * stride..];
        pairs.clear();
        pairs.extend(weights.chunks(2).map(split_pair));
        let mut first = 0;
        while first + VECTOR_BYTES <= stride {
            let sums = sum_block(rows_below, stride, first, &pairs);
            if let Some(out) = written.get_mut(first..).and_then(<[u8]>::first_chunk_mut) {
                store(out, sums);
            }
            first += VECTOR_BYTES;
        }
        sum_columns(rows_below, stride, first, weights, &mut written[first..]);
    }
}

/// 32 columns of one target row.
#[target_feature(enable = "avx2")]
fn sum_block(source: &[u8], stride: usize, first: usize, pairs: &[[i32; 2]]) -> __m256i {
    let zero = _mm256_setzero_si256();
    let mut low = [zero; 4];
    let mut high = [zero; 4];
    let mut at = first;
    for &[low_weights, high_weights] in pairs {
        let upper = source.get(at..).and_then(<[u8]>::first_chunk).map_or(zero, |bytes| load(bytes));
        // Past the last row the weight is zero.
        let lower = source.get(at + stride..).and_then(<[u8]>::first_chunk).map_or(zero, |bytes| load(bytes));
        at += 2 * stride;
        let (left, right) = (_mm256_unpacklo_epi8(upper, lower), _mm256_unpackhi_epi8(upper, lower));
        let samples = [
            _mm256_unpacklo_epi8(left, zero),
            _mm256_unpackhi_epi8(left, zero),
            _mm256_unpacklo_epi8(right, zero),
            _mm256_unpackhi_epi8(right, zero),
        ];
        let (low_weights, high_weights) = (_mm256_set1_epi32(low_weights), _mm256_set1_epi32(high_weights));
        for (samples, (low, high)) in samples.into_iter().zip(low.iter_mut().zip(&mut high)) {
            *low = _mm256_add_epi32(*low, _mm256_madd_epi16(samples, low_weights));
            *high = _mm256_add_epi32(*high, _mm256_madd_epi16(samples, high_weights));
        }
    }
    let half = _mm256_set1_epi32(HALF);
    let sums: [__m256i; 4] = std::array::from_fn(|part| {
        let sum = _mm256_add_epi32(_mm256_slli_epi32::<LOW_BITS>(high[part]), low[part]);
        _mm256_srai_epi32::<SHIFT>(_mm256_add_epi32(sum, half))
    });
    // Packing reverses the order of unpacking within each half; saturation clips to 0…255.
    _mm256_packus_epi16(_mm256_packs_epi32(sums[0], sums[1]), _mm256_packs_epi32(sums[2], sums[3]))
}

/// Low and high parts of up to four weights, 16 bits each.
fn split_step(weights: &[i32]) -> [i64; 2] {
    let join = |part: fn(i32) -> u16| {
        weights.iter().rev().fold(0u64, |joined, &weight| joined << 16 | u64::from(part(weight))).cast_signed()
    };
    [join(low), join(high)]
}

/// Low and high parts of up to two weights, 16 bits each.
fn split_pair(weights: &[i32]) -> [i32; 2] {
    let join = |part: fn(i32) -> u16| {
        weights.iter().rev().fold(0u32, |joined, &weight| joined << 16 | u32::from(part(weight))).cast_signed()
    };
    [join(low), join(high)]
}

fn low(weight: i32) -> u16 {
    let [first, second, _, _] = (weight & ((1 << LOW_BITS) - 1)).to_le_bytes();
    u16::from_le_bytes([first, second])
}

/// Fits into 16 bits, because the absolute value of a weight is below 2²⁴.
fn high(weight: i32) -> u16 {
    let [first, second, _, _] = (weight >> LOW_BITS).to_le_bytes();
    u16::from_le_bytes([first, second])
}

#[target_feature(enable = "avx2")]
fn load(bytes: &[u8; 32]) -> __m256i {
    // SAFETY: 32 readable bytes; the load needs no alignment.
    unsafe { _mm256_loadu_si256(bytes.as_ptr().cast()) }
}

#[target_feature(enable = "avx2")]
fn load_half(bytes: &[u8; 16]) -> __m128i {
    // SAFETY: 16 readable bytes; the load needs no alignment.
    unsafe { _mm_loadu_si128(bytes.as_ptr().cast()) }
}

#[target_feature(enable = "avx2")]
fn store(bytes: &mut [u8; 32], vector: __m256i) {
    // SAFETY: 32 writable bytes; the store needs no alignment.
    unsafe { _mm256_storeu_si256(bytes.as_mut_ptr().cast(), vector) }
}
