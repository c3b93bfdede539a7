use std::ops::RangeInclusive;

use sha2::{Digest, Sha256};

/// The increment of `SplitMix64`'s state for each number (Steele, Lea, Flood: "Fast splittable pseudorandom number
/// generators", OOPSLA 2014).
pub const SPLIT_MIX_STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// The output function of `SplitMix64`: a bijection of 64 bits.
pub const fn split_mix(state: u64) -> u64 {
    let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A number in [0, 1) from the upper 53 bits of a random or hashed number.
pub fn unit_of_bits(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1u64 << 53) as f64
}

/// The random number generator `SplitMix64`, the source of all random choices: the same numbers on every platform and in
/// every version of this crate.
///
/// The papers use PyTorch's generator, whose sequence is an implementation detail; so an index drawn here has the same
/// *distribution* as theirs, but is not equal to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SplitMix64 {
    state: u64,
}

impl SplitMix64 {
    /// The reference generator with the state `seed`.
    pub const fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// A separate stream for one scene, independent of the order and number of scenes: the state is the first eight
    /// bytes, little-endian, of SHA-256(seed as eight little-endian bytes ‖ key).
    pub fn for_scene(seed: u64, key: &str) -> Self {
        let digest = Sha256::new().chain_update(seed.to_le_bytes()).chain_update(key.as_bytes()).finalize();
        let state = digest.iter().take(8).rev().fold(0, |state, byte| state << 8 | u64::from(*byte));
        Self { state }
    }

    /// The next 64 bits.
    pub const fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(SPLIT_MIX_STEP);
        split_mix(self.state)
    }

    /// A uniform number in [0, 1), of 53 bits.
    pub fn unit(&mut self) -> f64 {
        unit_of_bits(self.next_u64())
    }

    /// A uniform number in [0, 1), of 24 bits.
    pub const fn unit_f32(&mut self) -> f32 {
        (self.next_u64() >> 40) as f32 / (1u32 << 24) as f32
    }

    /// A uniform number in `range`, without modulo bias (Lemire: "Fast random integer generation in an interval", 2019);
    /// `None` if the range is empty.
    pub fn within(&mut self, range: RangeInclusive<usize>) -> Option<usize> {
        let (first, last) = range.into_inner();
        let span = (last as u64).checked_sub(first as u64)?;
        let offset = match span.checked_add(1) {
            Some(bound) => self.below(bound),
            None => self.next_u64(),
        };
        usize::try_from(first as u64 + offset).ok()
    }

    /// A random permutation of `0..length`: Fisher–Yates from the back, Knuth's algorithm P.
    pub fn permutation(&mut self, length: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..length).collect();
        for last in (1..length).rev() {
            if let Some(other) = self.within(0..=last) {
                order.swap(last, other);
            }
        }
        order
    }

    /// `count` distinct elements of `candidates`, every subset equally likely, in random order; `None` if there are fewer.
    pub fn distinct<T: Copy>(&mut self, candidates: &[T], count: usize) -> Option<Vec<T>> {
        if count > candidates.len() {
            return None;
        }
        let order = self.permutation(candidates.len());
        order.iter().take(count).map(|position| candidates.get(*position).copied()).collect()
    }

    /// A uniform number in `0..bound`, for `bound` > 0.
    fn below(&mut self, bound: u64) -> u64 {
        let rejected_below = bound.wrapping_neg() % bound;
        loop {
            let product = u128::from(self.next_u64()) * u128::from(bound);
            #[expect(clippy::cast_possible_truncation, reason = "splits the product into its halves")]
            let (high, low) = ((product >> 64) as u64, product as u64);
            if low >= rejected_below {
                return high;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Published outputs of the reference implementation (S. Vigna, `splitmix64.c`), seed 1234567.
    #[test]
    fn matches_the_reference_sequence() {
        let mut random = SplitMix64::new(1_234_567);
        let expected = [
            6_457_827_717_110_365_317,
            3_203_168_211_198_807_973,
            9_817_491_932_198_370_423,
            4_593_380_528_125_082_431,
            16_408_922_859_458_223_821,
        ];
        assert_eq!(expected.map(|_| random.next_u64()), expected);
        assert_eq!(split_mix(0), 0);
    }

    /// Compares with `crates/protocol/tests/fixtures/make_oracles.py`, an independent implementation.
    #[test]
    fn draws_match_an_independent_implementation() {
        let oracle: serde_json::Value =
            serde_json::from_str(include_str!("../tests/fixtures/random_oracle.json")).unwrap();
        for stream in oracle["streams"].as_array().unwrap() {
            let seed = stream["seed"].as_u64().unwrap();
            let mut random = SplitMix64::for_scene(seed, stream["key"].as_str().unwrap());
            for draw in stream["within"].as_array().unwrap() {
                let numbers: Vec<usize> = serde_json::from_value(draw.clone()).unwrap();
                assert_eq!(random.within(numbers[0]..=numbers[1]), Some(numbers[2]), "seed {seed}: {numbers:?}");
            }
            let permutation: Vec<usize> = serde_json::from_value(stream["permutation"].clone()).unwrap();
            assert_eq!(random.permutation(permutation.len()), permutation, "seed {seed}");
        }
    }

    #[test]
    fn units_are_the_upper_bits_of_the_next_number() {
        assert_eq!([0, 1 << 63, 3 << 62].map(|bits| unit_of_bits(bits).to_bits()), [0.0, 0.5, 0.75].map(f64::to_bits));
        assert!(unit_of_bits(u64::MAX) < 1.0);
        let [mut bits, mut wide, mut narrow] = [3; 3].map(SplitMix64::new);
        for _ in 0..1000 {
            let (expected, unit, unit_f32) = (bits.next_u64(), wide.unit(), narrow.unit_f32());
            assert_eq!(unit.to_bits(), ((expected >> 11) as f64 * 2f64.powi(-53)).to_bits());
            assert_eq!(f64::from(unit_f32).to_bits(), ((expected >> 40) as f64 * 2f64.powi(-24)).to_bits());
        }
    }

    #[test]
    fn empty_and_full_ranges() {
        let mut random = SplitMix64::new(0);
        #[expect(clippy::reversed_empty_ranges, reason = "tests an empty range")]
        let empty = 3..=2;
        assert_eq!(random.within(empty), None);
        assert_eq!(random.within(7..=7), Some(7));
        assert!(random.within(0..=usize::MAX).is_some());
        assert_eq!(random.distinct(&[1, 2], 3), None);
    }

    /// χ² with 9 degrees of freedom exceeds 27.9 with a probability of 0.001; the seed is fixed.
    #[test]
    fn draws_are_uniform() {
        let mut random = SplitMix64::new(17);
        let mut counts = [0i32; 10];
        for _ in 0..100_000 {
            counts[random.within(0..=9).unwrap()] += 1;
        }
        let chi_squared: f64 = counts.iter().map(|n| f64::from(n - 10_000).powi(2) / 10_000.0).sum();
        assert!(chi_squared < 27.9, "χ² = {chi_squared}, counts {counts:?}");
    }

    proptest! {
        #[test]
        fn a_permutation_contains_every_number_once(seed: u64, length in 0usize..200) {
            let mut order = SplitMix64::new(seed).permutation(length);
            order.sort_unstable();
            prop_assert_eq!(order, (0..length).collect::<Vec<_>>());
        }

        #[test]
        fn draws_are_in_range(seed: u64, first in 0usize..1000, span in 0usize..1000) {
            let drawn = SplitMix64::new(seed).within(first..=first + span).unwrap();
            prop_assert!((first..=first + span).contains(&drawn));
        }
    }
}
