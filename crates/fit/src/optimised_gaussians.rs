use atsplat_numeric::sigmoid;
use atsplat_splat::{GaussianParts, Gaussians, SplatError, sh_coefficients};

/// The optimised Gaussians with Adam's moments, which are arrays of the same lengths.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OptimisedGaussians {
    pub(crate) parts: GaussianParts,
    pub(crate) first_moments: GaussianParts,
    pub(crate) second_moments: GaussianParts,
}

impl OptimisedGaussians {
    /// Gaussians without any history.
    pub fn new(gaussians: Gaussians) -> Self {
        let parts = gaussians.into_parts();
        let zeros = zeros(&parts);
        Self { parts, first_moments: zeros.clone(), second_moments: zeros }
    }

    /// Number of Gaussians.
    pub const fn len(&self) -> usize {
        self.parts.means.len()
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.parts.means.is_empty()
    }

    /// The Gaussians.
    pub fn gaussians(&self) -> Gaussians {
        gaussians_of(self.parts.clone())
    }

    /// Lends the Gaussians, without copying them.
    pub(crate) fn with_gaussians<T>(&mut self, work: impl FnOnce(&Gaussians) -> T) -> T {
        let gaussians = gaussians_of(std::mem::take(&mut self.parts));
        let result = work(&gaussians);
        self.parts = gaussians.into_parts();
        result
    }

    /// Keeps the Gaussians at these positions, with their moments, and appends new ones without any.
    ///
    /// # Errors
    /// [`SplatError::Position`] for a position out of range.
    pub(crate) fn replace(&mut self, kept: &[usize], new: GaussianParts) -> Result<(), SplatError> {
        let none = zeros(&new);
        let Self { parts, first_moments, second_moments } = self;
        for (parts, added) in [(parts, new), (first_moments, none.clone()), (second_moments, none)] {
            *parts = gaussians_of(std::mem::take(parts)).select(kept)?.merge(gaussians_of(added)).into_parts();
        }
        Ok(())
    }

    /// Copies of the Gaussians at these positions.
    ///
    /// # Errors
    /// [`SplatError::Position`] for a position out of range.
    pub(crate) fn copies(&mut self, positions: &[usize]) -> Result<GaussianParts, SplatError> {
        self.with_gaussians(|gaussians| gaussians.select(positions)).map(Gaussians::into_parts)
    }

    /// Sets the moments of the Gaussians at these positions to zero.
    pub(crate) fn reset_moments(&mut self, positions: &[usize]) {
        for parts in [&mut self.first_moments, &mut self.second_moments] {
            let coefficients = sh_coefficients(parts.sh_degree);
            for &position in positions {
                set(&mut parts.means, position, [0.0; 3]);
                set(&mut parts.quaternions, position, [0.0; 4]);
                set(&mut parts.log_scales, position, [0.0; 3]);
                set(&mut parts.opacity_logits, position, 0.0);
                parts.sh.iter_mut().skip(position * coefficients).take(coefficients).for_each(|slot| *slot = [0.0; 3]);
            }
        }
    }

    /// Opacity of every Gaussian.
    pub(crate) fn opacities(&self) -> impl Iterator<Item = f64> + '_ {
        self.parts.opacity_logits.iter().map(|logit| sigmoid(*logit))
    }
}

/// Gaussians of arrays whose lengths are known to match.
#[expect(clippy::expect_used, reason = "every change keeps the lengths of all arrays equal")]
pub(crate) fn gaussians_of(parts: GaussianParts) -> Gaussians {
    Gaussians::new(parts).expect("arrays of matching lengths")
}

/// All zero, without scalars and filters.
fn zeros(parts: &GaussianParts) -> GaussianParts {
    let count = parts.means.len();
    GaussianParts {
        means: vec![[0.0; 3]; count],
        quaternions: vec![[0.0; 4]; count],
        log_scales: vec![[0.0; 3]; count],
        opacity_logits: vec![0.0; count],
        sh_degree: parts.sh_degree,
        sh: vec![[0.0; 3]; parts.sh.len()],
        scalars: None,
        filter_3d: None,
    }
}

/// Replaces a value at the position of a Gaussian.
#[expect(clippy::expect_used, reason = "positions are those of Gaussians, of which each array has one value")]
pub(crate) fn set<T>(values: &mut [T], position: usize, value: T) {
    *values.get_mut(position).expect("a Gaussian at the position") = value;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[should_panic(expected = "a Gaussian at the position")]
    fn a_position_of_no_gaussian_does_not_pass_unnoticed() {
        set(&mut [1.0, 2.0], 2, 0.0);
    }

    #[test]
    fn gaussians_are_empty_if_there_are_none() {
        let none = OptimisedGaussians::default();
        assert_eq!((none.len(), none.is_empty()), (0, true));
        let parts = GaussianParts {
            means: vec![[0.0; 3]; 2],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]; 2],
            log_scales: vec![[0.0; 3]; 2],
            opacity_logits: vec![0.0; 2],
            sh: vec![[0.0; 3]; 2],
            ..GaussianParts::default()
        };
        let two = OptimisedGaussians::new(gaussians_of(parts));
        assert_eq!((two.len(), two.is_empty()), (2, false));
    }
}
