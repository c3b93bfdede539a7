use gemm::Parallelism;
use pulp::{Simd, WithSimd};

use super::{bf16, simd};
use crate::MatmulPrecision;

/// Longer sums of products are split into equal parts of at most this many terms.
///
/// `gemm` chooses its own parts from cache sizes and the number of columns; parts this short are never split.
const LONGEST_SUM: usize = 512;

/// A matrix inside a slice.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Matrix<'a> {
    pub(super) data: &'a [f32],
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// From one row to the next, and from one column to the next.
    pub(super) strides: [usize; 2],
}

impl<'a> Matrix<'a> {
    /// `rows × columns` from the first element on, rows `row_stride` elements apart.
    pub(crate) fn new(data: &'a [f32], rows: usize, columns: usize, row_stride: usize) -> Self {
        check(data.len(), rows, columns, row_stride);
        Self { data, rows, columns, strides: [row_stride, 1] }
    }

    /// The transposed matrix.
    pub(crate) const fn transposed(self) -> Self {
        let Self { data, rows, columns, strides: [row, column] } = self;
        Self { data, rows: columns, columns: rows, strides: [column, row] }
    }

    pub(super) fn at(&self, row: usize, column: usize) -> f32 {
        self.data[row * self.strides[0] + column * self.strides[1]]
    }

    fn columns_from(self, first: usize, count: usize) -> Self {
        // A matrix without elements has no data to skip.
        let data = self.data.get(first * self.strides[1]..).unwrap_or_default();
        Self { data, columns: count, ..self }
    }

    fn rows_from(self, first: usize, count: usize) -> Self {
        self.transposed().columns_from(first, count).transposed()
    }
}

/// A row-major matrix to write to.
#[derive(Debug)]
pub(crate) struct Output<'a> {
    pub(super) data: &'a mut [f32],
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) row_stride: usize,
}

impl<'a> Output<'a> {
    /// `rows × columns` from the first element on, rows `row_stride` elements apart.
    pub(crate) fn new(data: &'a mut [f32], rows: usize, columns: usize, row_stride: usize) -> Self {
        check(data.len(), rows, columns, row_stride);
        assert!(row_stride >= columns, "rows of {columns} elements overlap when {row_stride} apart");
        Self { data, rows, columns, row_stride }
    }
}

fn check(length: usize, rows: usize, columns: usize, row_stride: usize) {
    let needed = if rows == 0 || columns == 0 { 0 } else { (rows - 1) * row_stride + columns };
    assert!(needed <= length, "a matrix of {rows}×{columns}, rows {row_stride} apart, in {length} elements");
}

/// How a product is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Write {
    /// Replaces the elements.
    Set,
    /// Adds to the elements.
    Add,
}

/// Threads that compute a product.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Threads {
    /// The calling thread, for callers that are already parallel.
    One,
    /// All threads of rayon's current pool.
    All,
}

/// `left · right` into `out`, in the given precision.
///
/// An element's bits depend only on its row of `left` and its column of `right`, not on threads or on the number of other rows and
/// columns.
///
/// # Panics
/// If the shapes do not fit together.
pub(crate) fn multiply(
    out: Output<'_>,
    left: Matrix<'_>,
    right: Matrix<'_>,
    write: Write,
    (threads, precision): (Threads, MatmulPrecision),
) {
    match precision {
        MatmulPrecision::F32 | MatmulPrecision::F16 => multiply_f32(out, left, right, write, threads),
        MatmulPrecision::Bf16 => bf16::multiply(out, left, right, write, threads),
    }
}

/// A factor of several products, brought once into the form that its precision multiplies.
#[derive(Debug)]
pub(crate) enum Factor<'a> {
    /// As it is.
    F32(Matrix<'a>),
    /// Rounded.
    Bf16(bf16::Factor),
}

impl<'a> Factor<'a> {
    /// A factor on the left.
    pub(super) fn left(matrix: Matrix<'a>, precision: MatmulPrecision) -> Self {
        match precision {
            MatmulPrecision::F32 | MatmulPrecision::F16 => Self::F32(matrix),
            MatmulPrecision::Bf16 => Self::Bf16(bf16::Factor::left(matrix)),
        }
    }

    /// A factor on the right.
    pub(super) fn right(matrix: Matrix<'a>, precision: MatmulPrecision) -> Self {
        match precision {
            MatmulPrecision::F32 | MatmulPrecision::F16 => Self::F32(matrix),
            MatmulPrecision::Bf16 => Self::Bf16(bf16::Factor::right(matrix)),
        }
    }
}

/// `left · right` into `out` on this thread, to the bits of [`multiply`].
///
/// # Panics
/// If the shapes do not fit together, or the factors have different precisions.
pub(super) fn multiply_factors(out: Output<'_>, left: &Factor<'_>, right: &Factor<'_>, write: Write) {
    match (left, right) {
        (Factor::F32(left), Factor::F32(right)) => multiply_f32(out, *left, *right, write, Threads::One),
        (Factor::Bf16(left), Factor::Bf16(right)) => bf16::multiply_factors(out, left, right, write),
        _ => unreachable!("factors of one product have one precision"),
    }
}

/// `left · right` into `out`.
///
/// Each element is a chain of fused multiply-adds over the terms in order, in parts of at most [`LONGEST_SUM`]: its bits
/// depend only on its row of `left` and its column of `right`, not on threads or on the number of other rows and columns.
///
/// # Panics
/// If the shapes do not fit together.
pub(super) fn multiply_f32(mut out: Output<'_>, left: Matrix<'_>, right: Matrix<'_>, write: Write, threads: Threads) {
    assert_eq!(left.columns, right.rows, "inner sizes of a product");
    assert_eq!([out.rows, out.columns], [left.rows, right.columns], "outer sizes of a product");
    let terms = left.columns;
    if terms == 0 {
        if write == Write::Set {
            for row in out.data.chunks_mut(out.row_stride.max(1)).take(out.rows) {
                row.iter_mut().take(out.columns).for_each(|slot| *slot = 0.0);
            }
        }
        return;
    }
    let part = terms.div_ceil(terms.div_ceil(LONGEST_SUM));
    for first in (0..terms).step_by(part) {
        let count = part.min(terms - first);
        let add = write == Write::Add || first > 0;
        let (left, right) = (left.columns_from(first, count), right.rows_from(first, count));
        if ordered_by_gemm(&out, left, right) {
            call_gemm(&mut out, left, right, add, threads);
        } else {
            multiply_thin(&mut out, left, right, add);
        }
    }
}

/// Whether `gemm` sums in the order documented at [`multiply`]. It has other kernels for vectors, for sums of one or two
/// terms, and for few elements with contiguous terms.
fn ordered_by_gemm(out: &Output<'_>, left: Matrix<'_>, right: Matrix<'_>) -> bool {
    let few = out.rows * out.columns <= 256 && left.strides[1] == 1 && right.strides[0] == 1;
    out.rows > 1 && out.columns > 1 && left.columns > 2 && !few
}

#[expect(unsafe_code, reason = "the matrix product of a library that takes pointers")]
fn call_gemm(out: &mut Output<'_>, left: Matrix<'_>, right: Matrix<'_>, add: bool, threads: Threads) {
    let stride = usize::cast_signed;
    let parallelism = match threads {
        Threads::One => Parallelism::None,
        Threads::All => Parallelism::Rayon(0),
    };
    // SAFETY: the constructors of `Matrix` and `Output` checked that every element lies inside its slice, and parts of a
    // matrix lie inside the matrix; the mutable borrow of `out` excludes aliasing.
    unsafe {
        gemm::gemm::<f32>(
            out.rows,
            out.columns,
            left.columns,
            out.data.as_mut_ptr(),
            1,
            stride(out.row_stride),
            add,
            left.data.as_ptr(),
            stride(left.strides[1]),
            stride(left.strides[0]),
            right.data.as_ptr(),
            stride(right.strides[1]),
            stride(right.strides[0]),
            1.0,
            1.0,
            false,
            false,
            false,
            parallelism,
        );
    }
}

/// The same chains of operations as `gemm`'s main kernel, for shapes that it treats differently.
fn multiply_thin(out: &mut Output<'_>, left: Matrix<'_>, right: Matrix<'_>, add: bool) {
    let terms = left.columns;
    let mut column = vec![0.0; terms];
    let mut row = vec![0.0; terms];
    let by_row = out.rows <= out.columns;
    let (outer, inner) = if by_row { (left, right) } else { (right.transposed(), left.transposed()) };
    // Lanes run along the longer side.
    let mut lanes = vec![0.0; inner.columns];
    for at in 0..outer.rows {
        for (term, slot) in row.iter_mut().enumerate() {
            *slot = outer.data[at * outer.strides[0] + term * outer.strides[1]];
        }
        if inner.strides[1] == 1 {
            simd::run(Chains { lanes: &mut lanes, weights: &row, rows: inner.data, row_stride: inner.strides[0] });
        } else {
            for (place, lane) in lanes.iter_mut().enumerate() {
                for (term, slot) in column.iter_mut().enumerate() {
                    *slot = inner.data[place * inner.strides[1] + term * inner.strides[0]];
                }
                simd::run(Chains { lanes: std::slice::from_mut(lane), weights: &row, rows: &column, row_stride: 1 });
            }
        }
        for (place, &value) in lanes.iter().enumerate() {
            let [r, c] = if by_row { [at, place] } else { [place, at] };
            let slot = &mut out.data[r * out.row_stride + c];
            *slot = if add { *slot + value } else { value };
        }
    }
}

/// One chain of multiply-adds per lane: `lanes[i] = Σ weights[t]·rows[t][i]`.
struct Chains<'a> {
    lanes: &'a mut [f32],
    weights: &'a [f32],
    rows: &'a [f32],
    row_stride: usize,
}

impl WithSimd for Chains<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.lanes.fill(0.0);
        for (term, &weight) in self.weights.iter().enumerate() {
            let weight = simd.splat_f32s(weight);
            let row = &self.rows[term * self.row_stride..][..self.lanes.len()];
            let add = {
                #[inline(always)]
                |sum, [value]: [S::f32s; 1]| simd.mul_add_e_f32s(weight, value, sum)
            };
            simd::map(simd, self.lanes, [row], add);
        }
    }
}
