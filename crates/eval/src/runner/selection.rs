use std::collections::HashSet;

use atsplat_protocol::EvaluationIndex;

use super::Dataset;
use crate::Shard;

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
}

impl Selection {
    /// The part of a dataset's index that is run: scenes with entries that are in the data.
    pub fn index_of(self, dataset: &Dataset) -> EvaluationIndex {
        self.of(&dataset.index.index, dataset.source.keys()).index
    }

    /// Scenes with entries that are in the dataset, limited to the requested number, of which a shard takes every n-th.
    /// All entries of a scene stay in one shard.
    pub(super) fn of(self, index: &EvaluationIndex, keys: &[String]) -> Selected {
        let known: HashSet<&str> = keys.iter().map(String::as_str).collect();
        let with_entries = index.scenes.iter().filter(|(_, entries)| !entries.is_empty());
        let (present, missing): (Vec<_>, Vec<_>) = with_entries.partition(|(key, _)| known.contains(key.as_str()));
        let limit = self.limit.and_then(|limit| usize::try_from(limit).ok()).unwrap_or(present.len());
        let positions = spread(present.len(), limit);
        let Shard { number, of } = self.shard.unwrap_or(Shard { number: 1, of: 1 });
        let selected = positions.into_iter().skip(number.saturating_sub(1) as usize).step_by(of.max(1) as usize);
        let scenes =
            selected.filter_map(|at| present.get(at)).map(|(key, entries)| ((*key).clone(), (*entries).clone()));
        let index = EvaluationIndex { scenes: scenes.collect() };
        Selected { index, missing: missing.into_iter().map(|(key, _)| key.clone()).collect() }
    }
}

/// `count` of `all` positions, evenly spread and including the first: `⌊k · all / count⌋`; all of them if `count ≥ all`.
pub fn spread(all: usize, count: usize) -> Vec<usize> {
    if count >= all {
        return (0..all).collect();
    }
    (0..count).map(|k| k * all / count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_protocol::IndexEntry;

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
    fn positions_are_spread_evenly() {
        assert_eq!(spread(10, 4), [0, 2, 5, 7]);
        assert_eq!(spread(3, 5), [0, 1, 2]);
        assert_eq!((spread(5, 0), spread(0, 3)), (vec![], vec![]));
    }

    #[test]
    fn shards_partition_the_limited_index() {
        let index = index(11);
        let keys: Vec<String> = index.scenes.keys().filter(|key| *key != "s3").cloned().collect();
        let selected = |shard| Selection { limit: Some(7), shard }.of(&index, &keys);
        let whole = selected(None);
        assert_eq!((whole.index.scenes.len(), whole.missing.as_slice()), (7, &["s3".to_owned()][..]));
        let parts = (1..=3).map(|number| selected(Some(Shard { number, of: 3 })).index);
        let mut together: Vec<String> = parts.flat_map(|part| part.scenes.into_keys()).collect();
        together.sort();
        let mut expected: Vec<String> = whole.index.scenes.into_keys().collect();
        expected.sort();
        assert_eq!(together, expected);
    }
}
