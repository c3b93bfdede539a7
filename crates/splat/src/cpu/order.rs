use super::bins::{Bins, Entry};
use super::splat::Splat;

const DIGIT_BITS: u32 = 8;
const DIGITS: usize = 1 << DIGIT_BITS;

/// Splats of a tile that are copied together: 256 KiB, so that they stay in a core's second cache.
const NEAR: usize = 4096;

/// Sorts a tile's splats by depth, nearest first, and those of one depth by their position: what a stable sort of
/// f32 keys gives, as in every published rasterizer.
#[derive(Debug, Default)]
pub(super) struct Sorter {
    entries: Vec<Entry>,
    spare: Vec<Entry>,
    list: Vec<u32>,
    near: Vec<Splat>,
}

/// Bytes of a [`Sorter`] whose longest tile has so many splats.
pub(super) fn bytes(longest: usize) -> usize {
    let near = if longest < NEAR { longest } else { NEAR };
    (2 * size_of::<Entry>() + size_of::<u32>()) * longest + size_of::<Splat>() * near
}

/// One tile's splats in the order in which they are composited.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sorted<'a> {
    /// Places in the tile's unsorted list, in which splats stand in the order of the Gaussians.
    pub(super) order: &'a [Entry],
    splats: Splats<'a>,
}

#[derive(Clone, Copy, Debug)]
enum Splats<'a> {
    /// Those of the list.
    Near(&'a [Splat]),
    /// Places of the list's among all.
    Far(&'a [u32], &'a [Splat]),
}

impl Sorted<'_> {
    /// The splat at a place of the unsorted list.
    #[inline(always)]
    pub(super) fn at(&self, place: u32) -> &Splat {
        match self.splats {
            Splats::Near(splats) => splats.get(place as usize),
            Splats::Far(list, splats) => list.get(place as usize).and_then(|splat| splats.get(*splat as usize)),
        }
        .unwrap_or(&Splat::NONE)
    }
}

impl Sorter {
    /// A tile's splats in the order they are composited.
    ///
    /// Splats are copied in the order they are stored in, which memory delivers ahead of time, and not in the order
    /// of their depths, in which each would be waited for.
    pub(super) fn by_depth<'a>(&'a mut self, bins: &[Bins], tile: usize, splats: &'a [Splat]) -> Sorted<'a> {
        self.entries.clear();
        self.list.clear();
        self.near.clear();
        for run in bins {
            let list = run.list(tile);
            self.list.extend(list.iter().map(|entry| entry.splat));
            let places = (self.entries.len()..).zip(list);
            #[expect(clippy::cast_possible_truncation, reason = "a tile lists fewer than 2³² splats")]
            self.entries.extend(places.map(|(place, entry)| Entry { key: entry.key, splat: place as u32 }));
        }
        self.sort();
        if self.list.len() > NEAR {
            return Sorted { order: &self.entries, splats: Splats::Far(&self.list, splats) };
        }
        self.near.extend(self.list.iter().map(|splat| splats.get(*splat as usize).copied().unwrap_or_default()));
        Sorted { order: &self.entries, splats: Splats::Near(&self.near) }
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
            let mut sorter = Sorter::default();
            let sorted = sorter.by_depth(&bins, 0, &splats);
            let order: Vec<u32> = sorted.order.iter().map(|entry| entry.splat).collect();
            prop_assert_eq!(&order, &expected);
            let found: Vec<f32> = sorted.order.iter().map(|entry| sorted.at(entry.splat).depth).collect();
            prop_assert!(found.is_sorted());
        }
    }
}
