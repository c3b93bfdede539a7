//! CPU kernels of the operations, on slices of f32.
//!
//! The order of every sum depends only on sizes, never on the number of threads.

pub(crate) mod attention;
pub(crate) mod attention_backward;
mod attention_f32;
pub(crate) mod bf16;
mod columns;
pub(crate) mod gather;
pub(crate) mod gelu;
pub(crate) mod linear;
mod matrix;
pub(crate) mod norm;
mod simd;
mod softmax;
