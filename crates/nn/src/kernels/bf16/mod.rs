//! Matrix products of inputs rounded to bfloat16, with sums in f32: by AMX or AVX-512 where the processor has instructions for
//! it, else by the f32 product of the rounded inputs.

#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
mod amx;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "x86_64")]
mod blocks;
#[cfg(target_arch = "x86_64")]
mod buffer;
#[cfg(target_arch = "x86_64")]
mod pack;

use super::matrix::{Matrix, Output, Threads, Write, multiply_f32};

/// Whether this processor multiplies bfloat16 matrices faster than those of f32.
pub(crate) fn is_fast() -> bool {
    #[cfg(target_arch = "x86_64")]
    return avx512::is_available();
    #[cfg(not(target_arch = "x86_64"))]
    return false;
}

/// `left · right` into `out`, both rounded to bfloat16.
///
/// Each element is one sum over the terms in order: its bits depend only on its row of `left` and its column of `right`.
pub(super) fn multiply(out: Output<'_>, left: Matrix<'_>, right: Matrix<'_>, write: Write, threads: Threads) {
    #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
    if amx::is_available() {
        return blocks::multiply::<amx::Registers>(out, left, right, write, threads);
    }
    #[cfg(target_arch = "x86_64")]
    if avx512::is_available() {
        return blocks::multiply::<avx512::Vectors>(out, left, right, write, threads);
    }
    multiply_rounded(out, left, right, write, threads);
}

/// A factor of several products, rounded once.
#[derive(Debug)]
pub(super) enum Factor {
    /// For the processor's instructions.
    #[cfg(target_arch = "x86_64")]
    Panels(blocks::Panels),
    /// For products in f32.
    Values(Rounded),
}

impl Factor {
    /// A factor on the left.
    pub(super) fn left(matrix: Matrix<'_>) -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_fast() {
            return Self::Panels(blocks::Panels::of_rows(matrix));
        }
        Self::Values(Rounded::new(matrix))
    }

    /// A factor on the right.
    pub(super) fn right(matrix: Matrix<'_>) -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_fast() {
            return Self::Panels(blocks::Panels::of_columns(matrix));
        }
        Self::Values(Rounded::new(matrix))
    }
}

/// `left · right` into `out` on this thread, to the bits of [`multiply`].
pub(super) fn multiply_factors(out: Output<'_>, left: &Factor, right: &Factor, write: Write) {
    match (left, right) {
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        (Factor::Panels(left), Factor::Panels(right)) if amx::is_available() => {
            blocks::multiply_panels::<amx::Registers>(out, left, right, write);
        }
        #[cfg(target_arch = "x86_64")]
        (Factor::Panels(left), Factor::Panels(right)) => {
            blocks::multiply_panels::<avx512::Vectors>(out, left, right, write);
        }
        (Factor::Values(left), Factor::Values(right)) => {
            multiply_f32(out, left.matrix(), right.matrix(), write, Threads::One);
        }
        #[cfg(target_arch = "x86_64")]
        _ => unreachable!("one processor makes factors of one kind"),
    }
}

/// The f32 product of the rounded inputs.
fn multiply_rounded(out: Output<'_>, left: Matrix<'_>, right: Matrix<'_>, write: Write, threads: Threads) {
    let [a, b] = [left, right].map(Rounded::new);
    multiply_f32(out, a.matrix(), b.matrix(), write, threads);
}

/// A rounded copy of a matrix, whose rows or columns stay adjacent.
#[derive(Debug)]
pub(super) struct Rounded {
    data: Vec<f32>,
    rows: usize,
    columns: usize,
    by_rows: bool,
}

impl Rounded {
    fn new(matrix: Matrix<'_>) -> Self {
        let by_rows = matrix.strides[1] == 1;
        let lines = if by_rows { matrix } else { matrix.transposed() };
        let mut data = Vec::with_capacity(lines.rows * lines.columns);
        for row in 0..lines.rows {
            let start = row * lines.strides[0];
            if lines.strides[1] == 1 {
                data.extend(lines.data[start..start + lines.columns].iter().map(|value| round(*value)));
            } else {
                data.extend((0..lines.columns).map(|column| round(lines.at(row, column))));
            }
        }
        Self { data, rows: matrix.rows, columns: matrix.columns, by_rows }
    }

    fn matrix(&self) -> Matrix<'_> {
        if self.by_rows {
            Matrix::new(&self.data, self.rows, self.columns, self.columns)
        } else {
            Matrix::new(&self.data, self.columns, self.rows, self.rows).transposed()
        }
    }
}

/// The nearest bfloat16, of two equally near ones that with an even mantissa; NaN stays NaN.
const fn round(value: f32) -> f32 {
    let bits = value.to_bits();
    // Rounding up could carry a NaN's mantissa into its sign.
    let up = if value.is_nan() { bits | 0x0040_0000 } else { bits.wrapping_add(0x7fff + ((bits >> 16) & 1)) };
    f32::from_bits(up & 0xffff_0000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_to_nearest_even() {
        for (value, expected) in [
            (1.0, 1.0),
            (1.0 + 1.0 / 512.0, 1.0 + 1.0 / 128.0 * 0.0),
            (1.0 + 3.0 / 256.0, 1.0 + 2.0 / 128.0),
            (1.0 + 1.0 / 256.0, 1.0),
            (-1.0 - 1.1 / 256.0, -1.0 - 1.0 / 128.0),
            (f32::MAX, f32::INFINITY),
            (f32::NEG_INFINITY, f32::NEG_INFINITY),
            (0.0, 0.0),
        ] {
            assert_eq!(round(value).to_bits(), f32::to_bits(expected), "{value}");
        }
        assert!([0x7fff_ffff, 0xffff_ffff, 0x7f80_0001].iter().all(|&bits| round(f32::from_bits(bits)).is_nan()));
    }

    /// Every shape around the sizes of tiles, both layouts of both inputs, against sums in f64 of the rounded inputs.
    #[test]
    fn products_are_those_of_rounded_inputs() {
        let number = |at: usize| ((at * 7919 + 13) % 1009) as f32 / 101.0 - 5.0;
        for (rows, terms, columns) in
            [(1, 1, 1), (5, 31, 17), (16, 32, 16), (33, 33, 31), (64, 192, 96), (70, 1, 40), (3, 700, 65)]
        {
            let values = |count: usize, seed: usize| (0..count).map(|at| number(at + seed)).collect::<Vec<f32>>();
            for transposed in [[false, false], [true, false], [false, true], [true, true]] {
                let (a, b) = (values(rows * terms + 64, 1), values(terms * columns + 64, 2));
                let left = if transposed[0] {
                    Matrix::new(&a, terms, rows, rows).transposed()
                } else {
                    Matrix::new(&a, rows, terms, terms)
                };
                let right = if transposed[1] {
                    Matrix::new(&b, columns, terms, terms).transposed()
                } else {
                    Matrix::new(&b, terms, columns, columns)
                };
                for (write, threads) in [(Write::Set, Threads::One), (Write::Add, Threads::All)] {
                    let stride = columns + 3;
                    let before = values(rows * stride, 3);
                    let [mut fast, mut slow] = [before.clone(), before.clone()];
                    multiply(Output::new(&mut fast, rows, columns, stride), left, right, write, threads);
                    multiply_rounded(Output::new(&mut slow, rows, columns, stride), left, right, write, threads);
                    let mut prepared = before.clone();
                    let factors = (Factor::left(left), Factor::right(right));
                    multiply_factors(Output::new(&mut prepared, rows, columns, stride), &factors.0, &factors.1, write);
                    let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
                    assert_eq!(bits(&fast), bits(&prepared), "factors rounded once");
                    // Where AMX is there too, it hides the other instructions.
                    let mut vectors = slow.clone();
                    #[cfg(target_arch = "x86_64")]
                    if avx512::is_available() {
                        vectors.clone_from(&before);
                        let out = Output::new(&mut vectors, rows, columns, stride);
                        blocks::multiply::<avx512::Vectors>(out, left, right, write, threads);
                    }
                    for at in 0..rows * stride {
                        let (row, column) = (at / stride, at % stride);
                        if column >= columns {
                            assert_eq!(
                                [&fast, &slow, &vectors].map(|out| out[at].to_bits()),
                                [before[at].to_bits(); 3],
                                "between the rows"
                            );
                            continue;
                        }
                        let start = if write == Write::Add { f64::from(before[at]) } else { 0.0 };
                        let parts = (0..terms).map(|term| {
                            f64::from(round(left.at(row, term))) * f64::from(round(right.at(term, column)))
                        });
                        let (sum, size) =
                            parts.fold((start, start.abs()), |(sum, size), part| (sum + part, size + part.abs()));
                        for found in [fast[at], slow[at], vectors[at]] {
                            let difference = (f64::from(found) - sum).abs();
                            assert!(
                                difference <= 1e-5 * size,
                                "{rows}×{terms}×{columns} {transposed:?} {write:?} at {row}, {column}: {found} for {sum}"
                            );
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_not_finite_reaches_its_own_elements_alone() {
        let mut a = vec![1.0f32; 40 * 40];
        (a[3 * 40 + 5], a[7 * 40 + 1]) = (f32::NAN, f32::INFINITY);
        let b = vec![1.0f32; 40 * 40];
        let mut out = vec![0.0f32; 40 * 40];
        multiply(
            Output::new(&mut out, 40, 40, 40),
            Matrix::new(&a, 40, 40, 40),
            Matrix::new(&b, 40, 40, 40),
            Write::Set,
            Threads::One,
        );
        for (row, values) in out.chunks(40).enumerate() {
            assert!(values.iter().all(|value| match row {
                3 => value.is_nan(),
                7 => *value == f32::INFINITY,
                _ => value.to_bits() == 40.0f32.to_bits(),
            }));
        }
    }
}
