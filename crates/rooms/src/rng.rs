use atsplat_numeric::{SPLIT_MIX_STEP, SplitMix64, split_mix};
use glam::{DVec2, DVec3};

/// The generator of all crates, with the draws that scenes are made of.
#[derive(Clone, Debug)]
pub(crate) struct Rng(SplitMix64);

impl Rng {
    pub(crate) const fn new(seed: u64) -> Self {
        Self(SplitMix64::new(seed))
    }

    /// A separate stream for one part of a scene, so that changing one part does not change others.
    pub(crate) fn for_part(seed: u64, part: &str) -> Self {
        Self::new(part.bytes().fold(mix(seed), |state, byte| mix(state ^ u64::from(byte))))
    }

    pub(crate) const fn next(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        self.0.unit()
    }

    /// Uniform in [low, high).
    pub(crate) fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Uniform in `low..=high`.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small count")]
    pub(crate) fn count(&mut self, low: usize, high: usize) -> usize {
        (low + (self.unit() * (high + 1 - low) as f64) as usize).min(high)
    }

    pub(crate) fn sign(&mut self) -> f64 {
        if self.chance(0.5) { 1.0 } else { -1.0 }
    }

    pub(crate) fn pick<T: Copy>(&mut self, first: T, others: &[T]) -> T {
        let at = self.count(0, others.len());
        at.checked_sub(1).and_then(|at| others.get(at)).copied().unwrap_or(first)
    }

    /// Uniform on the unit sphere.
    pub(crate) fn direction(&mut self) -> DVec3 {
        sphere_point(DVec2::new(self.unit(), self.unit()))
    }
}

/// Uniform on the unit sphere from two uniform numbers.
pub(crate) fn sphere_point(u: DVec2) -> DVec3 {
    let z = 1.0 - 2.0 * u.x;
    let radius = (1.0 - z * z).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * u.y).sin_cos();
    DVec3::new(radius * cos, radius * sin, z)
}

/// A bijection of 64 bits: the first number of the generator with this state.
pub(crate) const fn mix(value: u64) -> u64 {
    split_mix(value.wrapping_add(SPLIT_MIX_STEP))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All scenes depend on these numbers; they were computed from the published algorithm, apart from this code.
    #[test]
    fn numbers_never_change() {
        let two = |mut rng: Rng| [rng.next(), rng.next()];
        assert_eq!(two(Rng::new(1_234_567)), [6_457_827_717_110_365_317, 3_203_168_211_198_807_973]);
        assert_eq!(two(Rng::for_part(3, "furniture")), [18_057_595_012_201_800_469, 12_479_769_624_504_765_040]);
        assert_eq!((mix(7), Rng::new(7).next()), (7_191_089_600_892_374_487, 7_191_089_600_892_374_487));
    }

    #[test]
    fn draws_stay_inside() {
        let mut rng = Rng::for_part(3, "furniture");
        for _ in 0..1000 {
            assert!((0.0..1.0).contains(&rng.unit()));
            assert!((2..=4).contains(&rng.count(2, 4)));
            assert!((rng.direction().length() - 1.0).abs() < 1e-9);
        }
        assert_ne!(Rng::for_part(3, "a").next(), Rng::for_part(3, "b").next());
    }
}
