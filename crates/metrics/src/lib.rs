//! Image metrics under named conventions: PSNR, SSIM, LPIPS, L1 and depth errors.
//!
//! A [`Pair`] is validated first: equal sizes and finite samples, or a typed error with what is wrong and how often. Metrics are
//! computed in f64 with a fixed order of summation, so results do not depend on the number of threads. What papers call "SSIM"
//! differs by up to 0.03; [`definitions`] lists every convention as data, and [`Suite`] computes any of them.
//!
//! Learned metrics need weights that may not be redistributed. If they are missing, the score is
//! [`NotComputed::WeightsAbsent`] with instructions to get them; there is no substitute value.

mod d_ssim;
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

pub use d_ssim::DSsim;
pub use definition::{Definition, Direction, Measure, definition, definitions};
pub use depth::{DepthError, DepthMap, DepthRange, DepthScale, depth_error};
pub use error::MetricError;
pub use map::{ColourMap, Map, absolute_error_map};
pub use mask::Mask;
pub use non_finite::NonFinite;
pub use pair::Pair;
pub use pixelwise::{l1, mean_squared_error, psnr, psnr_of_mean_squared_error};
pub use score::{DECIBEL_CAP, NotComputed, Score};
pub use ssim::{Ssim, ssim, ssim_map};
pub use suite::{Networks, Scored, Suite};
pub use values::Values;
