//! Every operation composed of a backend's own, for devices and element types that no kernel here is written for.
//!
//! The same formulas as the kernels', forward and backward; attention goes tile by tile here too.

mod array;
pub(crate) mod attention;
pub(crate) mod gather;
pub(crate) mod rows;

use array::Array;
