use std::collections::HashMap;

use atsplat_files::Sha256Digest;
use atsplat_numeric::spread;
use atsplat_protocol::EvaluationIndex;
use atsplat_results::Shard;

use super::Dataset;

/// Which scenes of an index are run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// At most this many scenes, spread over the index ([`spread`]).
    pub limit: Option<u64>,
    /// Which part of them, if the run is divided.
    pub shard: Option<Shard>,
}

/// The part of an index that a run evaluates on a dataset.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Selected {
    /// Scenes to run, in the index's order.
    pub(crate) index: EvaluationIndex,
    /// Scenes with entries that the dataset lacks.
    pub(super) missing: Vec<String>,
    /// As [`atsplat_results::PresetRecord::scenes_sha256`].
    pub(super) scenes_sha256: Sha256Digest,
}

impl Selection {
    /// The part of a dataset's index that is run: scenes with entries that are in the data.
    pub fn index_of(self, dataset: &Dataset) -> EvaluationIndex {
        self.select(&dataset.index.index, dataset.source.keys()).index
    }

    /// Scenes with entries that a dataset lacks, whatever the limit.
    pub fn missing_in(self, dataset: &Dataset) -> Vec<String> {
        self.select(&dataset.index.index, dataset.source.keys()).missing
    }

    /// Scenes with entries that are in the dataset, limited to the requested number, of which a shard takes neighbours in the
    /// dataset: it opens no more chunks than it needs. All entries of a scene stay in one shard.
    pub(super) fn select(self, index: &EvaluationIndex, keys: &[String]) -> Selected {
        let known: HashMap<&str, usize> =
            keys.iter().enumerate().map(|(position, key)| (key.as_str(), position)).collect();
        let with_entries = index.scenes.iter().filter(|(_, entries)| !entries.is_empty());
        let (present, missing): (Vec<_>, Vec<_>) = with_entries.partition(|(key, _)| known.contains_key(key.as_str()));
        let in_index = present.iter().map(|(key, _)| *key);
        let mut in_data: Vec<&String> = in_index.clone().collect();
        in_data.sort_by_key(|key| known.get(key.as_str()));
        let lines = in_index.chain(in_data).flat_map(|key| [key.as_bytes(), b"\n"]);
        let scenes_sha256 = Sha256Digest::of_parts(lines);
        let limit = self.limit.and_then(|limit| usize::try_from(limit).ok()).unwrap_or(present.len());
        let positions = spread(present.len(), limit);
        let mut scenes: Vec<_> =
            positions.into_iter().filter_map(|position| present.get(position)).enumerate().collect();
        scenes.sort_by_key(|(_, (key, _))| known.get(key.as_str()));
        let mut scenes = self.part_of(&scenes).to_vec();
        // In the index's order again.
        scenes.sort_by_key(|(position, _)| *position);
        let scenes = scenes.into_iter().map(|(_, (key, entries))| ((*key).clone(), (*entries).clone()));
        let index = EvaluationIndex { scenes: scenes.collect() };
        Selected { index, missing: missing.into_iter().map(|(key, _)| key.clone()).collect(), scenes_sha256 }
    }

    /// The part of a list that belongs to the shard: each item to one shard, those of the first shard first.
    pub(super) fn part_of<T>(self, list: &[T]) -> &[T] {
        let [start, end] = self.borders(list.len() as u64);
        let position = |border| usize::try_from(border).unwrap_or(usize::MAX);
        list.get(position(start)..position(end)).unwrap_or_default()
    }

    /// How many of `count` belong to the shard.
    pub(super) fn share_of(self, count: u64) -> u64 {
        let [start, end] = self.borders(count);
        end - start
    }

    /// The first of `count` positions that belong to the shard, and the first after them.
    fn borders(self, count: u64) -> [u64; 2] {
        let Shard { number, count: shards } = self.shard.unwrap_or(Shard { number: 1, count: 1 });
        [number.saturating_sub(1), number].map(|part| u64::from(part) * count / u64::from(shards.max(1)))
    }
}

#[cfg(test)]
mod tests {
    use atsplat_protocol::IndexEntry;

    use super::*;

    fn index(scenes: u32) -> EvaluationIndex {
        let entry = IndexEntry { context: vec![0], target: vec![1], overlap: None };
        let mut index = EvaluationIndex::default();
        for scene in 0..scenes {
            index.scenes.insert(format!("s{scene}"), vec![entry.clone(); 1 + scene as usize % 2]);
        }
        index.scenes.insert("null".to_owned(), Vec::new());
        index
    }

    #[test]
    fn shards_partition_the_limited_index() {
        let index = index(11);
        let keys: Vec<String> = index.scenes.keys().filter(|key| *key != "s3").cloned().collect();
        let selected = |shard| Selection { limit: Some(7), shard }.select(&index, &keys);
        let whole = selected(None);
        assert_eq!((whole.index.scenes.len(), whole.missing.as_slice()), (7, &["s3".to_owned()][..]));
        let parts = (1..=3).map(|number| selected(Some(Shard { number, count: 3 })).index);
        let mut together: Vec<String> = parts.flat_map(|part| part.scenes.into_keys()).collect();
        together.sort();
        let mut expected: Vec<String> = whole.index.scenes.into_keys().collect();
        expected.sort();
        assert_eq!(together, expected);
        let absent = ["a", "b", "c", "d"];
        let counted = (1..=3).flat_map(|number| {
            let shard = Some(Shard { number, count: 3 });
            Selection { limit: None, shard }.part_of(&absent).to_vec()
        });
        assert_eq!(counted.collect::<Vec<_>>(), absent, "each missing scene is counted by one shard");
        let shares =
            (1..=3).map(|number| Selection { limit: None, shard: Some(Shard { number, count: 3 }) }.share_of(4));
        assert_eq!(shares.collect::<Vec<_>>(), [1, 1, 2]);
        assert_eq!(Selection::default().share_of(4), 4);
    }

    /// The same for all limits and shards, and another for another order.
    #[test]
    fn the_scenes_that_parts_are_taken_of_have_a_hash() {
        let index = index(3);
        let mut reversed = index.clone();
        reversed.scenes.reverse();
        let keys = ["s2", "s0", "s1"].map(str::to_owned);
        let of = |index: &EvaluationIndex, keys: &[String], limit, shard| {
            Selection { limit, shard }.select(index, keys).scenes_sha256
        };
        let whole = of(&index, &keys, None, None);
        assert_eq!(whole, Sha256Digest::of(b"s0\ns1\ns2\ns2\ns0\ns1\n"));
        assert_eq!(of(&index, &keys, Some(2), Some(Shard { number: 2, count: 2 })), whole);
        assert_eq!(of(&reversed, &keys, None, None), Sha256Digest::of(b"s2\ns1\ns0\ns2\ns0\ns1\n"));
        assert_eq!(of(&index, &keys[1..], None, None), Sha256Digest::of(b"s0\ns1\ns0\ns1\n"), "s2 is not in the data");
    }

    /// The index is in another order than the data, whose chunks contain two scenes each.
    #[test]
    fn a_shard_takes_scenes_that_are_neighbours_in_the_data() {
        let index = index(8);
        let keys: Vec<String> = [3, 1, 7, 5, 0, 2, 4, 6].map(|scene| format!("s{scene}")).to_vec();
        let parts = (1..=4).map(|number| Selection { limit: None, shard: Some(Shard { number, count: 4 }) });
        let parts: Vec<Vec<String>> =
            parts.map(|selection| selection.select(&index, &keys).index.scenes.into_keys().collect()).collect();
        assert_eq!(parts, [["s1", "s3"], ["s5", "s7"], ["s0", "s2"], ["s4", "s6"]]);
        let uneven = (1..=3).map(|number| Selection { limit: None, shard: Some(Shard { number, count: 3 }) });
        let sizes: Vec<usize> = uneven.map(|selection| selection.select(&index, &keys).index.scenes.len()).collect();
        assert_eq!(sizes, [2, 3, 3]);
    }
}
