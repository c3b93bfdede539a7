//! Learned metrics: LPIPS (Zhang et al. 2018) and ST-LPIPS (Ghildyal and Liu 2022), on the CPU.
//!
//! Features of five layers of a network are normalised per pixel; their squared differences are weighted per channel and
//! averaged. LPIPS's channel weights ("heads") are embedded in the crate; the networks' weights are read from the user's files,
//! which [`WeightsFolders`] finds.

mod architecture;
mod cache;
mod convolution;
mod features;
mod lpips;
mod matrix;
mod pooling;
mod weights;

pub use architecture::{LpipsNetwork, Step};
pub use cache::FeatureCache;
pub use features::Features;
pub use lpips::{Lpips, SCALING, WeightsHashes};
pub use weights::{LoadError, WeightsAbsent, WeightsFolders, embedded_heads};

/// Uniform numbers in (−bound, bound) from a seed and their position, as `oracle/seeded.py`.
#[cfg(test)]
pub(crate) fn uniform(seed: u64, count: usize, bound: f64) -> Vec<f32> {
    use atsplat_numeric::{SPLIT_MIX_STEP, split_mix, unit_of_bits};

    #[expect(clippy::cast_possible_truncation, reason = "weights are f32")]
    let number = |position: u64| {
        let bits = split_mix(seed.wrapping_add(position + 1).wrapping_mul(SPLIT_MIX_STEP));
        ((2.0 * unit_of_bits(bits) - 1.0) * bound) as f32
    };
    (0..count as u64).map(number).collect()
}
