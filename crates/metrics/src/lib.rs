//! Two pictures into a number, under a named convention.
//!
//! A [`Pair`] is checked first: sizes agree and every sample is finite, or a typed error says what is wrong and how
//! often. Measures then compute in f64 with a fixed order of sums, so that threads change no bit. What papers mean by
//! "SSIM" differs by up to 0.03; [`definitions`] lists every convention as data, and [`Suite`] computes any of them.
//!
//! Learned metrics need weights that are not ours to carry. Where they are absent a score says so
//! ([`NotComputed::WeightsAbsent`]) and how to get them; nothing is put in their place.

mod average;
mod definition;
mod depth;
mod error;
pub mod learned;
mod map;
mod mask;
mod non_finite;
mod pair;
mod pixelwise;
mod score;
pub mod ssim;
mod suite;
mod sums;
mod values;

pub use average::{Average, DECIBEL_CAP};
pub use definition::{Definition, Direction, Measure, definition, definitions};
pub use depth::{DepthError, DepthMap, DepthRange, DepthScale, depth_error};
pub use error::MetricError;
pub use map::{Map, Ramp, absolute_error_map};
pub use mask::Mask;
pub use non_finite::NonFinite;
pub use pair::Pair;
pub use pixelwise::{l1, mean_squared_error, psnr, psnr_of_mean_squared_error};
pub use score::{NotComputed, Score};
pub use ssim::{Ssim, ssim, ssim_map};
pub use suite::{Networks, Scored, Suite};
pub use values::Values;
