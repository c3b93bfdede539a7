//! Image metrics under named conventions: PSNR, SSIM, LPIPS, ST-LPIPS and L1.
//!
//! A [`Pair`] is validated first: equal sizes and finite samples, or a typed error with what is wrong and how often. Metrics are
//! computed in f64 with a fixed order of summation, so results do not depend on the number of threads. What papers call "SSIM"
//! differs by up to 0.03; [`definitions`] lists every convention as data, and [`Suite`] computes any of them.
//!
//! Learned metrics need weights that may not be redistributed. If they are missing, the score is
//! [`NotComputed::WeightsAbsent`] with instructions to get them; there is no substitute value.

mod colour_map;
mod d_ssim;
mod definition;
mod error;
pub mod learned;
mod non_finite;
mod pair;
mod pixelwise;
mod score;
pub mod ssim;
mod suite;
mod sums;
mod values;

pub use colour_map::ColourMap;
pub use d_ssim::DSsim;
pub use definition::{Definition, Direction, Measure, Scale, definition, definition_in_any_case, definitions};
pub use error::MetricError;
pub use non_finite::NonFinite;
pub use pair::Pair;
pub use pixelwise::{l1, mean_squared_error, psnr, psnr_of_mean_squared_error};
pub use score::{DECIBEL_CAP, NotComputed, Score};
pub use ssim::{Ssim, ssim, ssim_map};
pub use suite::{Networks, Scored, Suite};
pub use values::Values;
