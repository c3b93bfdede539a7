//! Generic implementation of every operation from a backend's primitive operations, for devices and element types without
//! kernels. Formulas are those of the kernels, forward and backward, and attention is tiled too.
//!
//! Burn's high-level operations cannot replace it: each operation is a single node of the autodiff graph on every backend, so
//! that both passes must work on primitive tensors, and composed attention would store a matrix of tokens × tokens.

mod array;
pub(crate) mod attention;
pub(crate) mod gather;
pub(crate) mod rows;

use array::Array;
