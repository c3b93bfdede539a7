//! Products by AVX-512's dot products of bfloat16 pairs, on processors without tile registers (AMD since Zen 4).

#![expect(unsafe_code, reason = "vector loads and stores take pointers")]

use std::arch::x86_64::{
    __m512, __m512bh, __m512i, _mm512_dpbf16_ps, _mm512_load_si512, _mm512_loadu_ps, _mm512_set1_epi32,
    _mm512_setzero_ps, _mm512_storeu_ps,
};
use std::array;
use std::mem::transmute;

use super::blocks::{BLOCK, BlockFactors, Kernel};
use super::pack::{self, LANES, Tile};

/// Rows of a strip: two vectors of sums each, which with a pair of columns' vectors and a row's number fit the 32 registers.
const ROWS: usize = 8;

/// Whether the processor has the instructions.
pub(super) fn is_available() -> bool {
    pack::has_instructions()
}

/// Proof that the processor has the instructions.
pub(super) struct Vectors {
    checked: (),
}

impl Kernel for Vectors {
    fn begin() -> Self {
        assert!(is_available(), "AVX-512 with bfloat16");
        Self { checked: () }
    }

    fn multiply(&self, factors: BlockFactors<'_>, out: &mut [f32], row_stride: usize, add: bool) {
        let () = self.checked;
        factors.check(out, row_stride);
        for first in (0..BLOCK).step_by(ROWS) {
            let rows = factors.rows[first / LANES];
            // SAFETY: the value proves that the instructions exist.
            unsafe {
                multiply_strip(rows, first % LANES, factors.columns, &mut out[first * row_stride..], row_stride, add);
            }
        }
    }
}

/// Eight rows of a block, `first` the first of them in their tiles.
#[target_feature(enable = "avx512f,avx512bf16")]
fn multiply_strip(rows: &[Tile], first: usize, columns: [&[Tile]; 2], out: &mut [f32], row_stride: usize, add: bool) {
    let mut sums: [[__m512; 2]; ROWS] = if add {
        array::from_fn(|row| {
            let numbers = &out[row * row_stride..][..BLOCK];
            // SAFETY: 16 numbers are read from each half of a slice of 32.
            unsafe { [_mm512_loadu_ps(numbers.as_ptr()), _mm512_loadu_ps(numbers.as_ptr().add(LANES))] }
        })
    } else {
        [[_mm512_setzero_ps(); 2]; ROWS]
    };
    for (rows, (left, right)) in rows.iter().zip(columns[0].iter().zip(columns[1])) {
        let rows = &rows.rows()[first..first + ROWS];
        for (pair, (left, right)) in left.rows().iter().zip(right.rows()).enumerate() {
            // SAFETY: both are 64 bytes, aligned to 64 as rows of tiles are, without invalid values.
            let [left, right] = [left, right]
                .map(|columns| unsafe { transmute::<__m512i, __m512bh>(_mm512_load_si512(columns.as_ptr().cast())) });
            for (row, sums) in rows.iter().zip(&mut sums) {
                // SAFETY: both are 64 bytes without invalid values.
                let number = unsafe { transmute::<__m512i, __m512bh>(_mm512_set1_epi32(row[pair].cast_signed())) };
                *sums = [_mm512_dpbf16_ps(sums[0], number, left), _mm512_dpbf16_ps(sums[1], number, right)];
            }
        }
    }
    for (row, sums) in sums.into_iter().enumerate() {
        let numbers = &mut out[row * row_stride..][..BLOCK];
        // SAFETY: 16 numbers are written to each half of a slice of 32.
        unsafe {
            _mm512_storeu_ps(numbers.as_mut_ptr(), sums[0]);
            _mm512_storeu_ps(numbers.as_mut_ptr().add(LANES), sums[1]);
        }
    }
}
