//! Fused transformer operations and layers for burn, faster than burn's composed operations.
//!
//! [`ops`] has the operations: linear with bias, erf-GELU, layer norm and RMS norm (of rows, or of heads inside packed
//! tensors), tiled attention on packed queries, keys and values, gathering of rows and maxima over gathered rows. [`layers`]
//! has modules built from them.
//!
//! On burn's CPU backend, f32 uses kernels with a hand-written backward pass: matrix products by the `gemm` crate, everything
//! else vectorised with `pulp`. Other devices and element types use one generic implementation of the same forward and
//! backward passes. Within [`MatmulPrecision::scope`], matrix products on the CPU round their inputs to bfloat16, which processors with AMX
//! or AVX-512's instructions for it multiply faster.
//!
//! # Determinism
//!
//! Kernels give the same bits on every run and for any number of threads: the order of every sum depends only on sizes. A
//! sample's result does not depend on its batch. Weight gradients, which are sums over the batch, are summed in the order of
//! its rows. This holds on one type of processor; another vector width may round differently.
//!
//! # Shapes
//!
//! Like burn's own operations, these panic if shapes do not fit together.

#![expect(clippy::inline_always, reason = "only inlined code gets vector instructions")]

mod autodiff;
mod backend;
mod flex;
mod generic;
mod kernels;
pub mod layers;
mod matmul_precision;
pub mod ops;
#[cfg(test)]
mod tests;

use burn::Tensor;
pub use matmul_precision::MatmulPrecision;

/// The values of a tensor in f32, row-major.
#[expect(clippy::expect_used, reason = "a tensor's data has the element type that it was converted to")]
pub fn f32_values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data_as::<f32>().try_into_vec().expect("data converted to f32")
}

/// Kind of normalisation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum NormKind {
    /// Layer norm: subtract the mean, then divide by the standard deviation.
    Layer,
    /// RMS norm: divide by the root of the mean square.
    Rms,
}
