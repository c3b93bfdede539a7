use super::bins::{Bins, Entry};

const DIGIT_BITS: u32 = 8;
const DIGITS: usize = 1 << DIGIT_BITS;

/// Sorts a tile's splats by depth, nearest first, and ties by index: the result of a stable sort of f32 keys, as in
/// every published rasterizer.
#[derive(Debug, Default)]
pub(super) struct Sorter {
    entries: Vec<Entry>,
    spare: Vec<Entry>,
}

impl Sorter {
    /// A tile's splats in compositing order.
    pub(super) fn by_depth(&mut self, bins: &[Bins], tile: usize) -> &[Entry] {
        self.gather(bins, tile);
        self.sort();
        &self.entries
    }

    /// As [`Sorter::by_depth`], with indices into the tile's unsorted list instead of splats; that list is appended to
    /// `splats`.
    pub(super) fn indices_by_depth(&mut self, bins: &[Bins], tile: usize, splats: &mut Vec<u32>) -> &[Entry] {
        self.gather(bins, tile);
        for (entry, index) in self.entries.iter_mut().zip(0..) {
            splats.push(entry.splat);
            entry.splat = index;
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

    /// Stable radix sort; skips digits that are equal in all keys.
    fn sort(&mut self) {
        let mut counts = [[0u32; DIGITS]; 4];
        for entry in &self.entries {
            for (pass, counts) in (0..).zip(&mut counts) {
                counts[digit(entry.key, pass)] += 1;
            }
        }
        self.spare.resize(self.entries.len(), Entry::default());
        for (pass, offsets) in (0..).zip(&mut counts) {
            if offsets.iter().any(|count| *count as usize == self.entries.len()) {
                continue;
            }
            let mut next = 0;
            for offset in offsets.iter_mut() {
                next += std::mem::replace(offset, next);
            }
            for entry in &self.entries {
                let offset = &mut offsets[digit(entry.key, pass)];
                self.spare[*offset as usize] = *entry;
                *offset += 1;
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
    use super::super::project::Splat;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn depth_keys_preserve_order(a in any::<f32>(), b in any::<f32>()) {
            prop_assume!(!a.is_nan() && !b.is_nan());
            prop_assert_eq!(depth_key(a).cmp(&depth_key(b)), a.partial_cmp(&b).unwrap());
        }

        #[test]
        fn sorts_stably_by_depth(depths in prop::collection::vec(prop_oneof![0.0f32..2.0, Just(1.0), Just(-0.0), -3.0f32..1e9], 0..600), run in 1usize..300) {
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
            let indices: Vec<u32> = Sorter::default().indices_by_depth(&bins, 0, &mut unsorted).iter().map(|entry| unsorted[entry.splat as usize]).collect();
            prop_assert_eq!(&indices, &expected);
        }
    }
}
