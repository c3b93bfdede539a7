//! How floats are compared and ordered everywhere in atsplat.
//!
//! Two rules live here because every crate shares them: a comparison names its [`Tolerance`], and
//! [`Extremes`] lets NaN through where the standard library's `max` and `min` swallow it. Shared for the same reason:
//! [`median`] and [`quantile`], and the row in which every crate reports how it fared with a hard case, [`StressRow`].

mod extremes;
mod order;
mod rank;
mod split_mix;
mod stress;
mod tolerance;

pub use extremes::Extremes;
pub use order::{median, quantile};
pub use rank::rank_correlation;
pub use split_mix::{SPLIT_MIX_STEP, split_mix};
pub use stress::{MeasuredError, StressRow};
pub use tolerance::{Mismatch, Tolerance};
