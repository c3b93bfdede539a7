//! How floats are compared and ordered everywhere in atsplat.
//!
//! Two rules live here because every crate shares them: a comparison names its [`Tolerance`], and
//! [`Extremes`] lets NaN through where the standard library's `max` and `min` swallow it. Shared for the same reason:
//! [`median`] and [`quantile`], and [`SplitMix64`], which every random choice comes from.

mod bytes;
mod extremes;
mod order;
mod random;
mod rank;
mod split_mix;
mod tolerance;

pub use bytes::format_bytes;
pub use extremes::Extremes;
pub use order::{median, quantile};
pub use random::SplitMix64;
pub use rank::rank_correlation;
pub use split_mix::{SPLIT_MIX_STEP, split_mix};
pub use tolerance::{Mismatch, Tolerance};
