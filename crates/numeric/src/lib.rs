//! How floats are compared and ordered everywhere in atsplat.
//!
//! Two rules live here because every crate shares them: a comparison names its [`Tolerance`], and
//! [`Extremes`] lets NaN through where the standard library's `max` and `min` swallow it.

mod extremes;
mod tolerance;

pub use extremes::Extremes;
pub use tolerance::{Mismatch, Tolerance};
