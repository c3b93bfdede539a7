use super::bins::{Bins, Entry};

const DIGIT_BITS: u32 = 8;
const DIGITS: usize = 1 << DIGIT_BITS;

/// Sorts a tile's splats by depth, nearest first, and those of one depth by their position: what a stable sort of
/// f32 keys gives, as in every published rasterizer.
#[derive(Debug, Default)]
pub(super) struct Sorter {
    entries: Vec<Entry>,
    spare: Vec<Entry>,
}

impl Sorter {
    /// A tile's splats in the order they are composited.
    pub(super) fn by_depth(&mut self, bins: &[Bins], tile: usize) -> &[Entry] {
        self.gather(bins, tile);
        self.sort();
        &self.entries
    }

    /// As [`Sorter::by_depth`], with the places of the splats in the tile's unsorted list instead of themselves;
    /// the unsorted list is appended to `splats`.
    pub(super) fn places_by_depth(&mut self, bins: &[Bins], tile: usize, splats: &mut Vec<u32>) -> &[Entry] {
        self.gather(bins, tile);
        for (entry, place) in self.entries.iter_mut().zip(0..) {
            splats.push(entry.splat);
            entry.splat = place;
        }
        self.sort();
        &self.entries
    }

    fn gather(&mut self, bins: &[Bins], tile: usize) {
        self.entries.clear();
        for run in bins {
            self.entries.extend_from_slice(run.list(tile));
        }
    }

    /// A stable counting sort by each digit on which keys differ.
    fn sort(&mut self) {
        let mut counts = [[0u32; DIGITS]; 4];
        for entry in &self.entries {
            for (pass, counts) in (0..).zip(&mut counts) {
                counts[digit(entry.key, pass)] += 1;
            }
        }
        self.spare.resize(self.entries.len(), Entry::default());
        for (pass, places) in (0..).zip(&mut counts) {
            if places.iter().any(|count| *count as usize == self.entries.len()) {
                continue;
            }
            let mut next = 0;
            for place in places.iter_mut() {
                next += std::mem::replace(place, next);
            }
            for entry in &self.entries {
                let place = &mut places[digit(entry.key, pass)];
                if let Some(slot) = self.spare.get_mut(*place as usize) {
                    *slot = *entry;
                }
                *place += 1;
            }
            std::mem::swap(&mut self.entries, &mut self.spare);
        }
    }
}

const fn digit(key: u32, pass: u32) -> usize {
    (key >> (pass * DIGIT_BITS)) as usize % DIGITS
}

#[cfg(test)]
mod tests {
    use super::super::bins::{Tiling, depth_key};
    use super::super::splat::Splat;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn keys_keep_the_order(a in any::<f32>(), b in any::<f32>()) {
            prop_assume!(!a.is_nan() && !b.is_nan());
            prop_assert_eq!(depth_key(a).cmp(&depth_key(b)), a.partial_cmp(&b).unwrap());
        }

        #[test]
        fn stable_and_sorted(depths in prop::collection::vec(prop_oneof![0.0f32..2.0, Just(1.0), Just(-0.0), -3.0f32..1e9], 0..600), run in 1usize..300) {
            let splat = |depth: &f32| Splat { depth: *depth, reach: [[0, 1]; 2], ..Splat::default() };
            let splats: Vec<Splat> = depths.iter().map(splat).collect();
            let tiling = Tiling { side: 16, columns: 1, rows: 1 };
            let bins: Vec<Bins> = splats.chunks(run).enumerate().map(|(at, splats)| {
                let mut bins = Bins::default();
                assert_eq!(bins.count(splats, tiling), splats.len() as u64);
                bins.fill(at * run, splats, tiling);
                bins
            }).collect();
            let mut expected: Vec<u32> = (0..).take(depths.len()).collect();
            expected.sort_by_key(|at| depth_key(depths[*at as usize]));
            let order: Vec<u32> = Sorter::default().by_depth(&bins, 0).iter().map(|entry| entry.splat).collect();
            prop_assert_eq!(&order, &expected);
            let mut unsorted = Vec::new();
            let places: Vec<u32> = Sorter::default().places_by_depth(&bins, 0, &mut unsorted).iter().map(|entry| unsorted[entry.splat as usize]).collect();
            prop_assert_eq!(&places, &expected);
        }
    }
}
