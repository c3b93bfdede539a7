use super::columns;
use super::matrix::{Matrix, Output, Threads, Write, multiply, product};
use crate::MatmulPrecision;

/// `x · weight + bias`; `x` has rows of `inputs` elements, `weight` is `inputs × outputs`.
pub(crate) fn forward(x: &[f32], weight: &[f32], bias: Option<&[f32]>, inputs: usize, outputs: usize) -> Vec<f32> {
    let rows = rows_of(x, inputs);
    let (x, weight) = (Matrix::new(x, rows, inputs, inputs), Matrix::new(weight, inputs, outputs, outputs));
    let Some(bias) = bias else { return product(x, weight, on_all_threads()) };
    let mut out = bias.repeat(rows);
    multiply(Output::new(&mut out, rows, outputs, outputs), x, weight, Write::Add, on_all_threads());
    out
}

/// The gradient of `x`: `grad · weightᵀ`.
pub(crate) fn input_gradient(grad: &[f32], weight: &[f32], inputs: usize, outputs: usize) -> Vec<f32> {
    let grad = Matrix::new(grad, rows_of(grad, outputs), outputs, outputs);
    product(grad, Matrix::new(weight, inputs, outputs, outputs).transposed(), on_all_threads())
}

/// The gradient of `weight`: `xᵀ · grad`.
pub(crate) fn weight_gradient(x: &[f32], grad: &[f32], inputs: usize, outputs: usize) -> Vec<f32> {
    let rows = rows_of(x, inputs);
    let x = Matrix::new(x, rows, inputs, inputs).transposed();
    product(x, Matrix::new(grad, rows, outputs, outputs), on_all_threads())
}

/// The gradient of the bias: the sum of the rows.
pub(crate) fn bias_gradient(grad: &[f32], outputs: usize) -> Vec<f32> {
    columns::sum(grad, outputs)
}

fn on_all_threads() -> (Threads, MatmulPrecision) {
    (Threads::All, MatmulPrecision::current())
}

fn rows_of(data: &[f32], width: usize) -> usize {
    data.len().checked_div(width).unwrap_or(0)
}
