//! What the operations compute on the processor: slices of f32 in, slices of f32 out.
//!
//! The order of every sum is fixed by the sizes of what is summed up. Threads only decide who computes it.

pub(crate) mod attention;
pub(crate) mod attention_backward;
mod columns;
pub(crate) mod gather;
pub(crate) mod gelu;
pub(crate) mod linear;
mod matrix;
pub(crate) mod norm;
mod simd;
