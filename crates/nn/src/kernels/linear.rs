use super::columns;
use super::matrix::{Matrix, Output, Threads, Write, multiply};
use crate::MatmulPrecision;

/// `x · weight + bias`; `x` has rows of `inputs` elements, `weight` is `inputs × outputs`.
pub(crate) fn forward(x: &[f32], weight: &[f32], bias: Option<&[f32]>, inputs: usize, outputs: usize) -> Vec<f32> {
    let rows = rows_of(x, inputs);
    let (mut out, write) = match bias {
        Some(bias) => (bias.repeat(rows), Write::Add),
        None => (vec![0.0; rows * outputs], Write::Set),
    };
    multiply(
        Output::new(&mut out, rows, outputs, outputs),
        Matrix::new(x, rows, inputs, inputs),
        Matrix::new(weight, inputs, outputs, outputs),
        write,
        (Threads::All, MatmulPrecision::current()),
    );
    out
}

/// The gradient of `x`: `grad · weightᵀ`.
pub(crate) fn input_gradient(grad: &[f32], weight: &[f32], inputs: usize, outputs: usize) -> Vec<f32> {
    let rows = rows_of(grad, outputs);
    let mut out = vec![0.0; rows * inputs];
    multiply(
        Output::new(&mut out, rows, inputs, inputs),
        Matrix::new(grad, rows, outputs, outputs),
        Matrix::new(weight, inputs, outputs, outputs).transposed(),
        Write::Set,
        (Threads::All, MatmulPrecision::current()),
    );
    out
}

/// The gradient of `weight`: `xᵀ · grad`.
pub(crate) fn weight_gradient(x: &[f32], grad: &[f32], inputs: usize, outputs: usize) -> Vec<f32> {
    let rows = rows_of(x, inputs);
    let mut out = vec![0.0; inputs * outputs];
    multiply(
        Output::new(&mut out, inputs, outputs, outputs),
        Matrix::new(x, rows, inputs, inputs).transposed(),
        Matrix::new(grad, rows, outputs, outputs),
        Write::Set,
        (Threads::All, MatmulPrecision::current()),
    );
    out
}

/// The gradient of the bias: the sum of the rows.
pub(crate) fn bias_gradient(grad: &[f32], outputs: usize) -> Vec<f32> {
    columns::sum(grad, outputs)
}

fn rows_of(data: &[f32], width: usize) -> usize {
    data.len().checked_div(width).unwrap_or(0)
}
