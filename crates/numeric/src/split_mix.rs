/// What `SplitMix64` adds to its state for each number (Steele, Lea, Flood: "Fast splittable pseudorandom number
/// generators", OOPSLA 2014).
pub const SPLIT_MIX_STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// The number that `SplitMix64` makes of a state: a bijection of 64 bits, the same on every platform. Wherever the
/// toolkit draws at random, the draw comes from here, so that it is the same in every version.
pub const fn split_mix(state: u64) -> u64 {
    let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From the reference implementation, seed 1234567.
    #[test]
    fn reference_numbers() {
        let numbers = (1..=5).map(|at: u64| split_mix(SPLIT_MIX_STEP.wrapping_mul(at).wrapping_add(1_234_567)));
        let reference = [
            6_457_827_717_110_365_317,
            3_203_168_211_198_807_973,
            9_817_491_932_198_370_423,
            4_593_380_528_125_082_431,
            16_408_922_859_458_223_821,
        ];
        assert!(numbers.eq(reference));
        assert_eq!(split_mix(0), 0);
    }
}
