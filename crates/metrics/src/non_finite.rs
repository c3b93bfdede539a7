use std::fmt;

use serde::Serialize;

/// Number of NaN or infinite samples of a pair of images. Counted before anything is computed, because comparisons such as
/// `f32::max` would hide them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct NonFinite {
    /// Samples of the render.
    pub render: u64,
    /// Samples of the ground truth.
    pub truth: u64,
    /// Column, row and channel of the first one in row-major order, in either image.
    pub first: Option<[u32; 3]>,
}

impl NonFinite {
    /// Counts the samples of interleaved RGB rows of `width` pixels.
    #[expect(clippy::expect_used, reason = "sides of images are u32")]
    pub(crate) fn count(render: &[f32], truth: &[f32], width: usize) -> Self {
        // Fast path for finite images: one pass without branches.
        if all_finite(render) && all_finite(truth) {
            return Self::default();
        }
        let mut counted = Self::default();
        for sample in 0..render.len().max(truth.len()) {
            let broken = |samples: &[f32]| samples.get(sample).is_some_and(|value| !value.is_finite());
            counted.render += u64::from(broken(render));
            counted.truth += u64::from(broken(truth));
            if counted.first.is_none() && counted.total() > 0 {
                let position = [sample / 3 % width, sample / 3 / width, sample % 3];
                counted.first = Some(position.map(|part| u32::try_from(part).expect("sides of images are u32")));
            }
        }
        counted
    }

    /// Number in both images.
    pub const fn total(&self) -> u64 {
        self.render + self.truth
    }
}

fn all_finite(samples: &[f32]) -> bool {
    const EXPONENT: u32 = 0x7f80_0000;
    samples.iter().fold(0, |broken, sample| broken | u32::from(sample.to_bits() & EXPONENT == EXPONENT)) == 0
}

impl fmt::Display for NonFinite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} in the render and {} in the truth that are NaN or infinite", self.render, self.truth)?;
        match self.first {
            Some([column, row, channel]) => write!(f, ", first at column {column}, row {row}, channel {channel}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_broken_sample_is_counted() {
        let count = |render: &[f32], truth: &[f32]| NonFinite::count(render, truth, 2);
        let counted = |render, truth, first| NonFinite { render, truth, first };
        assert_eq!(count(&[0.5; 12], &[f32::MAX; 12]), NonFinite::default());
        assert_eq!(count(&[f32::NAN; 12], &[f32::INFINITY; 12]), counted(12, 12, Some([0, 0, 0])), "nothing is finite");
        let mut one = [0.5; 12];
        one[10] = f32::NEG_INFINITY;
        assert_eq!(count(&[0.5; 12], &one), counted(0, 1, Some([1, 1, 1])), "the last pixel's green");
    }
}
