//! Learned metrics: LPIPS (Zhang et al. 2018) and ST-LPIPS (Ghildyal and Liu 2022), on the processor.
//!
//! A picture goes through a network; features at five depths are normalised per pixel, and their squared differences
//! are weighted per channel and averaged. LPIPS's weighting of channels ("heads") is carried here; the networks below
//! them come from the user's own files, found by [`WeightsFolders`].

mod architecture;
mod cache;
mod convolution;
mod features;
mod heads;
mod matrix;
mod perceptual;
mod pooling;
mod tensor;
mod weights;

pub use architecture::{Network, Step};
pub use cache::FeatureCache;
pub use features::Features;
pub use heads::carried as carried_heads;
pub use perceptual::{Perceptual, SCALING, WeightsHashes};
pub use weights::{LoadError, WeightsAbsent, WeightsFolders};

#[cfg(test)]
mod tests;
#[cfg(test)]
pub(crate) use tests::uniform;
