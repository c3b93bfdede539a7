//! Operations and layers of transformers for burn: tensors into tensors, faster than burn's decomposed forms.
//!
//! [`ops`] has the operations: linear with bias, erf-GELU, layer norm and RMS norm (of rows, or of heads inside packed
//! tensors), attention on packed queries, keys and values in tiles, gathering of rows and of the largest over neighbours,
//! top-k and nearest neighbours. [`layers`] has the modules built of them.
//!
//! On burn's processor backend, f32 takes kernels of ours with a hand-written backward pass: matrix products by the `gemm`
//! crate, everything around them vectorised with `pulp`. Other devices and element types take one generic implementation
//! of the same forward and backward passes.
//!
//! # Determinism
//!
//! Kernels give the same bits on every run and for any number of threads: the order of every sum is fixed by the sizes
//! of what is summed. A sample's result does not depend on the batch that it is in. Weight gradients, which are sums over
//! the batch, are summed in the order of its rows. That holds on one type of processor; vectors of another width may
//! round differently.
//!
//! # Shapes
//!
//! Like burn's own, operations panic when shapes do not fit together.

#![expect(clippy::inline_always, reason = "vector instructions reach only what is inlined")]

mod autodiff;
mod backend;
mod flex;
mod generic;
mod kernels;
pub mod layers;
pub mod ops;
#[cfg(test)]
mod tests;

use burn::Tensor;

/// The values of a tensor in f32, row-major.
#[expect(clippy::expect_used, reason = "a tensor's data has the element type that it was converted to")]
pub fn f32_values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data_as::<f32>().try_to_vec().expect("data converted to f32")
}

/// How a vector is normalised.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum NormKind {
    /// The mean is taken off, and the rest divided by the standard deviation: layer norm.
    Layer,
    /// Divided by the root of the mean square: RMS norm.
    Rms,
}
