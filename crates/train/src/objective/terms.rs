//! What a step reports of its losses, and of the time that it took.

use std::time::Instant;

use serde::{Deserialize, Serialize};

/// The loss of a sample, term by term, unweighted except for the total; a mean over samples in a step's record.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Terms {
    /// Sum of all terms with their weights.
    pub total: f64,
    /// Mean squared error of the final renders, for colours in [0, 1].
    pub mse: f64,
    /// Perceptual loss of the final renders: LPIPS, ST-LPIPS or `1 − SSIM`, whichever is configured.
    pub perceptual: f64,
    /// Mean squared errors of the intermediate renders, summed over the intermediate sets of Gaussians.
    pub intermediate_mse: f64,
    /// `1 − SSIM` of the intermediate renders, summed over these sets.
    pub intermediate_d_ssim: f64,
    /// Loss of the predicted uncertainty, summed over these sets.
    pub uncertainty: f64,
    /// Loss of the logarithms of the anchors' distances; 0 if its weight is 0.
    #[serde(default)]
    pub distance: f64,
}

impl Terms {
    /// Each term by name.
    pub const fn named(&self) -> [(&'static str, f64); 7] {
        let Self { total, mse, perceptual, intermediate_mse, intermediate_d_ssim, uncertainty, distance } = *self;
        [
            ("mse", mse),
            ("perceptual", perceptual),
            ("intermediate-mse", intermediate_mse),
            ("intermediate-d-ssim", intermediate_d_ssim),
            ("uncertainty", uncertainty),
            ("distance", distance),
            ("total", total),
        ]
    }

    /// The mean, summed in the given order.
    pub fn mean(all: &[Self]) -> Self {
        let mean = |term: fn(&Self) -> f64| all.iter().map(term).sum::<f64>() / all.len().max(1) as f64;
        Self {
            total: mean(|terms| terms.total),
            mse: mean(|terms| terms.mse),
            perceptual: mean(|terms| terms.perceptual),
            intermediate_mse: mean(|terms| terms.intermediate_mse),
            intermediate_d_ssim: mean(|terms| terms.intermediate_d_ssim),
            uncertainty: mean(|terms| terms.uncertainty),
            distance: mean(|terms| terms.distance),
        }
    }
}

/// Wall-clock seconds that a group of samples took, by part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct PartSeconds {
    /// Making the samples.
    pub sample: f64,
    /// The network, forward, with the Gaussians of every set.
    pub forward: f64,
    /// The renderer, forward, all sets.
    pub splat: f64,
    /// Losses and their gradients with respect to the images.
    pub losses: f64,
    /// Renderer and network, backward.
    pub backward: f64,
}

impl PartSeconds {
    /// The sum over several groups.
    pub fn sum(all: impl Iterator<Item = Self>) -> Self {
        all.fold(Self::default(), |a, b| Self {
            sample: a.sample + b.sample,
            forward: a.forward + b.forward,
            splat: a.splat + b.splat,
            losses: a.losses + b.losses,
            backward: a.backward + b.backward,
        })
    }
}

/// A stopwatch of consecutive parts.
pub(super) struct Clock(Instant);

impl Clock {
    pub(super) fn start() -> Self {
        Self(Instant::now())
    }

    pub(super) fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let seconds = (now - self.0).as_secs_f64();
        self.0 = now;
        seconds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_are_added_by_part() {
        let parts_from = |first: f64| PartSeconds {
            sample: first,
            forward: first + 1.0,
            splat: first + 2.0,
            losses: first + 4.0,
            backward: first + 8.0,
        };
        let sum = PartSeconds { sample: 12.0, forward: 15.0, splat: 18.0, losses: 24.0, backward: 36.0 };
        assert_eq!(PartSeconds::sum([2.0, 3.0, 7.0].map(parts_from).into_iter()), sum);
    }
}
