use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::simd;

/// Rows per partial sum; fixed, so that the order of sums does not depend on threads.
pub(crate) const BLOCK: usize = 64;

/// The sum of rows of `width` elements.
pub(crate) fn sum(data: &[f32], width: usize) -> Vec<f32> {
    if width == 0 {
        return Vec::new();
    }
    let blocks = data.par_chunks(BLOCK * width).map(|block| {
        let mut sum = vec![0.0; width];
        block.chunks_exact(width).for_each(|row| add(&mut sum, row));
        sum
    });
    in_order(blocks.collect(), width)
}

/// The sum of the partial sums, from the first to the last.
pub(crate) fn in_order(blocks: Vec<Vec<f32>>, width: usize) -> Vec<f32> {
    let mut blocks = blocks.into_iter();
    let first = blocks.next().unwrap_or_else(|| vec![0.0; width]);
    blocks.fold(first, |mut sum, block| {
        add(&mut sum, &block);
        sum
    })
}

/// Adds a row to another.
pub(crate) fn add(sum: &mut [f32], row: &[f32]) {
    simd::run(Add { sum, row });
}

struct Add<'a> {
    sum: &'a mut [f32],
    row: &'a [f32],
}

impl WithSimd for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let add = {
            #[inline(always)]
            |sum, [value]: [S::f32s; 1]| simd.add_f32s(sum, value)
        };
        simd::map(simd, self.sum, [self.row], add);
    }
}
