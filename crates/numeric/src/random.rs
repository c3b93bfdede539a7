use std::ops::RangeInclusive;

use sha2::{Digest, Sha256};

use crate::{SPLIT_MIX_STEP, split_mix};

/// `SplitMix64` (Steele, Lea, Flood: "Fast splittable pseudorandom number generators", OOPSLA 2014):
/// sixty-four bits of state, the same numbers on every platform and in every version of this crate.
///
/// The papers draw from PyTorch's generator, whose sequence is an implementation detail; an index that is
/// drawn here is therefore *distributed* as theirs, not equal to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SplitMix64 {
    state: u64,
}

impl SplitMix64 {
    /// The reference generator started at `seed`.
    pub const fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// A stream of its own for one scene, so that the order and the number of scenes change nothing:
    /// the state is the first eight bytes, little-endian, of SHA-256(seed as eight little-endian bytes ‖ key).
    pub fn for_scene(seed: u64, key: &str) -> Self {
        let digest = Sha256::new().chain_update(seed.to_le_bytes()).chain_update(key.as_bytes()).finalize();
        let state = digest.iter().take(8).rev().fold(0, |state, byte| state << 8 | u64::from(*byte));
        Self { state }
    }

    /// The next sixty-four bits.
    pub const fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(SPLIT_MIX_STEP);
        split_mix(self.state)
    }

    /// A uniform number of `range`, without modulo bias (Lemire: "Fast random integer generation in an
    /// interval", 2019); `None` where the range is empty.
    pub fn within(&mut self, range: RangeInclusive<usize>) -> Option<usize> {
        let (first, last) = range.into_inner();
        let span = (last as u64).checked_sub(first as u64)?;
        let offset = match span.checked_add(1) {
            Some(bound) => self.below(bound),
            None => self.next_u64(),
        };
        usize::try_from(first as u64 + offset).ok()
    }

    /// All of `0..length` in random order: Fisher–Yates from the back, as Knuth's algorithm P.
    pub fn permutation(&mut self, length: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..length).collect();
        for last in (1..length).rev() {
            if let Some(other) = self.within(0..=last) {
                order.swap(last, other);
            }
        }
        order
    }

    /// `count` different elements of `candidates`, every subset equally likely, in random order;
    /// `None` where there are fewer.
    pub fn distinct<T: Copy>(&mut self, candidates: &[T], count: usize) -> Option<Vec<T>> {
        if count > candidates.len() {
            return None;
        }
        let order = self.permutation(candidates.len());
        order.iter().take(count).map(|position| candidates.get(*position).copied()).collect()
    }

    /// Uniform in `0..bound`; `bound` > 0.
    fn below(&mut self, bound: u64) -> u64 {
        let rejected_below = bound.wrapping_neg() % bound;
        loop {
            let product = u128::from(self.next_u64()) * u128::from(bound);
            #[expect(clippy::cast_possible_truncation, reason = "the two halves of the product are wanted")]
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
    fn reference_sequence() {
        let mut random = SplitMix64::new(1_234_567);
        let expected = [
            6_457_827_717_110_365_317,
            3_203_168_211_198_807_973,
            9_817_491_932_198_370_423,
            4_593_380_528_125_082_431,
            16_408_922_859_458_223_821,
        ];
        assert_eq!(expected.map(|_| random.next_u64()), expected);
    }

    /// Written by `crates/protocol/tests/fixtures/make_oracles.py`, which shares no code with this file.
    #[test]
    fn same_draws_on_every_platform() {
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
    fn empty_and_whole_ranges() {
        let mut random = SplitMix64::new(0);
        #[expect(clippy::reversed_empty_ranges, reason = "an empty range is what is tested")]
        let empty = 3..=2;
        assert_eq!(random.within(empty), None);
        assert_eq!(random.within(7..=7), Some(7));
        assert!(random.within(0..=usize::MAX).is_some());
        assert_eq!(random.distinct(&[1, 2], 3), None);
    }

    /// χ² with 9 degrees of freedom exceeds 27.9 once in a thousand fair draws; the seed is fixed.
    #[test]
    fn draws_are_even() {
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
        fn a_permutation_holds_everything_once(seed: u64, length in 0usize..200) {
            let mut order = SplitMix64::new(seed).permutation(length);
            order.sort_unstable();
            prop_assert_eq!(order, (0..length).collect::<Vec<_>>());
        }

        #[test]
        fn draws_stay_inside(seed: u64, first in 0usize..1000, span in 0usize..1000) {
            let drawn = SplitMix64::new(seed).within(first..=first + span).unwrap();
            prop_assert!((first..=first + span).contains(&drawn));
        }
    }
}
