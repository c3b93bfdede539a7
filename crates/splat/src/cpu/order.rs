use super::project::Splat;

/// Bytes of the sorter's buffers per splat.
pub(super) const BYTES_EACH: usize = 4 * size_of::<u64>();

const DIGIT_BITS: u32 = 11;
const DIGITS: usize = 1 << DIGIT_BITS;

/// Sorts splats by depth, nearest first, and those of one depth by their position: what a stable sort of f32
/// keys gives, as in every published rasterizer.
#[derive(Debug, Default)]
pub(super) struct Sorter {
    pairs: Vec<(u32, u32)>,
    spare: Vec<(u32, u32)>,
    order: Vec<u32>,
}

impl Sorter {
    /// Positions among `splats` in the order they are composited.
    pub(super) fn by_depth(&mut self, splats: &[Splat]) -> &[u32] {
        self.pairs.clear();
        self.pairs.extend(splats.iter().zip(0..).map(|(splat, at)| (depth_key(splat.depth), at)));
        self.spare.clear();
        self.spare.resize(self.pairs.len(), (0, 0));
        for pass in 0..3 {
            if scatter(&self.pairs, &mut self.spare, pass * DIGIT_BITS) {
                std::mem::swap(&mut self.pairs, &mut self.spare);
            }
        }
        self.order.clear();
        self.order.extend(self.pairs.iter().map(|(_, at)| *at));
        &self.order
    }
}

/// A number whose order is that of the depths, negative ones and both zeros included.
pub(super) const fn depth_key(depth: f32) -> u32 {
    let bits = (depth + 0.0).to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

/// One pass of a stable counting sort; `false`, and nothing written, where all digits are the same.
fn scatter(from: &[(u32, u32)], to: &mut [(u32, u32)], shift: u32) -> bool {
    let digit = |key: u32| (key >> shift) as usize % DIGITS;
    let mut places = [0usize; DIGITS];
    for (key, _) in from {
        places[digit(*key)] += 1;
    }
    if places.contains(&from.len()) {
        return false;
    }
    let mut next = 0;
    for place in &mut places {
        next += std::mem::replace(place, next);
    }
    for pair in from {
        let place = &mut places[digit(pair.0)];
        if let Some(slot) = to.get_mut(*place) {
            *slot = *pair;
        }
        *place += 1;
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn keys_keep_the_order(a in any::<f32>(), b in any::<f32>()) {
            prop_assume!(!a.is_nan() && !b.is_nan());
            prop_assert_eq!(depth_key(a).cmp(&depth_key(b)), a.partial_cmp(&b).unwrap());
        }

        #[test]
        fn stable_and_sorted(depths in prop::collection::vec(prop_oneof![0.0f32..2.0, Just(1.0), Just(-0.0), -3.0f32..1e9], 0..600)) {
            let splats: Vec<Splat> = depths.iter().map(|depth| Splat { depth: *depth, ..Splat::default() }).collect();
            let mut sorter = Sorter::default();
            let order = sorter.by_depth(&splats).to_vec();
            let mut expected: Vec<u32> = (0..).take(depths.len()).collect();
            expected.sort_by_key(|at| depth_key(depths[*at as usize]));
            prop_assert_eq!(order, expected);
        }
    }
}
