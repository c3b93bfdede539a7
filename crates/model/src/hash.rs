//! Pseudo-random numbers as a hash of keys: `SplitMix64` (Steele, Lea, Flood 2014). `oracle/hashed.py` gives the same.

use atsplat_numeric::{SPLIT_MIX_STEP as GOLDEN, split_mix as mix};

/// An endless sequence with random access.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stream {
    start: u64,
}

impl Stream {
    /// The sequence of a list of keys; their order matters.
    pub(crate) fn of(keys: &[u64]) -> Self {
        Self { start: keys.iter().fold(0, |start, &key| mix(start.wrapping_add(key).wrapping_add(GOLDEN))) }
    }

    /// The sequence of a seed and a name, which is hashed by FNV-1a of its UTF-8 bytes.
    pub(crate) fn named(seed: u64, name: &str) -> Self {
        let hash = name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        });
        Self::of(&[seed, hash])
    }

    /// The 64 bits at a position.
    pub(crate) const fn bits(self, at: u64) -> u64 {
        mix(self.start.wrapping_add(GOLDEN.wrapping_mul(at.wrapping_add(1))))
    }

    /// A number in [−1, 1) in steps of 2⁻²³: exact in f32.
    pub(crate) fn signed_unit(self, at: u64) -> f64 {
        (self.bits(at) >> 40) as f64 / f64::from(1u32 << 23) - 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    #[test]
    fn agrees_with_the_reference_values() {
        assert_eq!(mix(0), 0);
        // The reference generator from seed 0 starts with this number.
        assert_eq!(Stream { start: 0 }.bits(0), 0xe220_a839_7b1d_cdaf);
        assert_eq!(Stream::of(&[]).bits(0), 0xe220_a839_7b1d_cdaf);
        // Printed by `oracle/hashed.py`.
        let stream = Stream::named(7, "coarse.fuse.weight");
        assert_eq!([stream.bits(0), stream.bits(1), stream.bits(1000)], NUMBERS);
        Tolerance::EXACT.assert([stream.signed_unit(0)], [SIGNED], "signed");
    }

    const NUMBERS: [u64; 3] = [0x8a70_0cfd_7685_4ac6, 0xe164_ec76_738d_3e87, 0x0d03_e424_e09f_c8b8];
    const SIGNED: f64 = 0.081_544_399_261_474_61;
}
