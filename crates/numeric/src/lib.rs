//! Numeric helpers shared by all crates: comparison of floats with an explicit [`Tolerance`], [`Extremes`] that propagate
//! NaN where the standard library's `max` and `min` ignore it, [`mean`], [`median`], [`quantile`] and [`nearest_quantile`],
//! [`distinct`] and [`grouped`] values, the random number generator [`SplitMix64`], evenly [`spread()`] positions, the
//! rounding of [`narrowed()`] and [`logit`], quadrature by [`GAUSS_LEGENDRE`], and numbers with their unit,
//! noun or decimals in messages.

mod bytes;
mod count;
mod decimals;
mod extremes;
mod narrowed;
mod order;
mod quadrature;
mod random;
mod rank;
mod spread;
mod tolerance;

pub use bytes::format_bytes;
pub use count::{counted, noun};
pub use decimals::{decimals_of_interval, decimals_of_small};
pub use extremes::Extremes;
pub use narrowed::{logit, narrowed, sigmoid};
pub use order::{distinct, grouped, mean, median, nearest_quantile, quantile};
pub use quadrature::GAUSS_LEGENDRE;
pub use random::{SPLIT_MIX_STEP, SplitMix64, split_mix, unit_of_bits};
pub use rank::rank_correlation;
pub use spread::spread;
pub use tolerance::{Mismatch, Tolerance};
