/// Uniform numbers in (−bound, bound) from a seed and their place: `SplitMix64`'s finaliser, as `oracle/seeded.py`.
pub(crate) fn uniform(seed: u64, count: usize, bound: f64) -> Vec<f32> {
    #[expect(clippy::cast_possible_truncation, reason = "weights are f32")]
    let number = |place: u64| {
        let mut z = (seed.wrapping_add(place.wrapping_add(1))).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let unit = ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64;
        ((2.0 * unit - 1.0) * bound) as f32
    };
    (0..count as u64).map(number).collect()
}
