//! Evaluation indices: the context and target frames of every scene.
//!
//! One file format serves pixelSplat, MVSplat, DepthSplat, NoPoSplat, YoNoSplat and latentSplat
//! (`assets/evaluation_index_*.json`): an object from scene keys to `null`, an entry, or a list of entries. `MVSplat360`'s
//! `target_quantify` lists which frames of `target` are scored: the others are left out.
//! [`EvaluationIndex`] is the content of such a file; [`IndexFile`] is the file itself, with the hash of its bytes,
//! its formatting and its irregularities.

mod content;
mod embedded;
mod file;
mod foreign_entries;
mod layout;
mod mismatch;
mod overlap_mismatch;
mod read;
mod write;

use std::collections::{BTreeMap, BTreeSet};

use atsplat_files::Sha256Digest;
use indexmap::IndexMap;

pub use file::IndexFile;
pub use foreign_entries::ForeignEntries;
pub use layout::{AbsentForm, IndexLayout, SingleEntryForm, Spacing};
pub use mismatch::IndexMismatch;
pub use read::{IndexNotices, OVERLAP_OF_LARGE, OVERLAP_OF_OTHER_WORDS};

/// Context and target frames of one scene.
///
/// Frame numbers are positions in [`atsplat_scene::Scene::frames`], not timestamps or file numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct IndexEntry {
    /// Frames that a method sees, in the index's order.
    pub context: Vec<usize>,
    /// Frames that it is scored on, in the index's order; may include context frames ("leaked").
    pub target: Vec<usize>,
    /// Overlap of the context views, if the index states it (NoPoSplat).
    pub overlap: Option<Overlap>,
}

/// How much of the scene an entry's context views share, and which estimator measured it.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlap {
    /// From 0 to 1.
    pub value: f64,
    /// The estimator's [`crate::overlap::OverlapEstimator::name`]; `None` if the index does not record it, as no
    /// published index does.
    pub estimator: Option<String>,
}

impl From<f64> for Overlap {
    /// An overlap without a recorded estimator.
    fn from(value: f64) -> Self {
        Self { value, estimator: None }
    }
}

impl IndexEntry {
    /// Largest frame number that a file may contain: 92 hours at 30 frames per second. It keeps arithmetic on
    /// frame numbers, and lists of all frames of a window, far from overflow.
    pub const MAX_FRAME: usize = 9_999_999;

    /// First and last context frame by number, the "input window"; `None` without context frames.
    pub fn window(&self) -> Option<(usize, usize)> {
        Some((*self.context.iter().min()?, *self.context.iter().max()?))
    }

    /// Whether `frame` is a context frame.
    pub fn is_context(&self, frame: usize) -> bool {
        self.context.contains(&frame)
    }

    /// The targets that are also context frames, in the index's order, with repetitions.
    pub fn leaked(&self) -> impl Iterator<Item = usize> {
        self.target.iter().copied().filter(|frame| self.is_context(*frame))
    }

    /// Signed distance of `frame` from the window in frames: negative before it, positive after it, 0 inside.
    /// `None` without context frames.
    pub fn frames_outside_window(&self, frame: usize) -> Option<i64> {
        let (first, last) = self.window()?;
        let distance = |from: usize, to: usize| i64::try_from(to.saturating_sub(from)).unwrap_or(i64::MAX);
        Some(if frame < first { -distance(frame, first) } else { distance(last, frame) })
    }
}

/// An evaluation index: scene keys in file order, each with no entry (`null`), one, or several
/// (latentSplat). The format of pixelSplat, NoPoSplat, DepthSplat and latentSplat.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EvaluationIndex {
    /// Scene key → entries. An empty list is the file's `null`: a scene that the protocol omits.
    pub scenes: IndexMap<String, Vec<IndexEntry>>,
}

impl EvaluationIndex {
    /// Reads an index from JSON text, which must list each scene once.
    #[cfg(test)]
    pub(crate) fn from_json(bytes: &[u8]) -> Result<Self, crate::ProtocolError> {
        IndexFile::parse(bytes)?.into_unambiguous()
    }

    /// The index as JSON text. With the layout that was read, official files are reproduced byte for byte.
    pub fn to_json(&self, layout: &IndexLayout) -> String {
        write::to_json(self, *layout)
    }

    /// Hash of the index's content, independent of the file's formatting: of white space, the order of scenes, fields
    /// and targets, `null` or absent scenes, and an entry or a list of one. See `index/content.rs` for the hashed bytes.
    ///
    /// Two indices with equal content hashes define the same trials. Means over scenes are summed in index
    /// order, so two orders of the same content may differ in the last bit of a mean, and in nothing else.
    pub fn content_hash(&self) -> Sha256Digest {
        content::hash(self)
    }

    /// Entries in index order: scene key, position within the scene, entry.
    pub fn entries(&self) -> impl Iterator<Item = (&str, usize, &IndexEntry)> {
        self.scenes
            .iter()
            .flat_map(|(key, entries)| entries.iter().enumerate().map(move |(n, entry)| (key.as_str(), n, entry)))
    }

    /// Position of each scene's first entry among all entries, for scenes that have one.
    pub fn first_positions(&self) -> BTreeMap<&str, usize> {
        let first = self.entries().enumerate().filter(|(_, (_, entry, _))| *entry == 0);
        first.map(|(position, (scene, ..))| (scene, position)).collect()
    }

    /// Number of scenes with at least one entry; the other keys are the file's `null`s.
    pub fn scene_count(&self) -> usize {
        self.scenes.values().filter(|entries| !entries.is_empty()).count()
    }

    /// Number of target frames over all entries.
    pub fn target_count(&self) -> usize {
        self.entries().map(|(_, _, entry)| entry.target.len()).sum()
    }

    /// Every overlap, in index order.
    pub fn overlaps(&self) -> impl Iterator<Item = &Overlap> {
        self.entries().filter_map(|(_, _, entry)| entry.overlap.as_ref())
    }

    /// Names of the estimators that the index records, sorted and distinct.
    pub fn overlap_estimators(&self) -> Vec<String> {
        let recorded = self.overlaps().filter_map(|overlap| overlap.estimator.clone());
        recorded.collect::<BTreeSet<_>>().into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(context: &[usize], target: &[usize]) -> IndexEntry {
        IndexEntry { context: context.to_vec(), target: target.to_vec(), overlap: None }
    }

    #[test]
    fn the_window_spans_unsorted_context_frames() {
        let entry = entry(&[30, 10, 20], &[]);
        assert_eq!(entry.window(), Some((10, 30)));
        let labels = [0, 9, 10, 15, 30, 31, 45].map(|frame| entry.frames_outside_window(frame));
        assert_eq!(labels, [-10, -1, 0, 0, 0, 1, 15].map(Some));
    }

    #[test]
    fn an_entry_without_context_has_no_window() {
        assert_eq!(entry(&[], &[1]).window(), None);
        assert_eq!(entry(&[], &[1]).frames_outside_window(1), None);
    }

    #[test]
    fn positions_count_the_entries_of_earlier_scenes() {
        let scenes = [("z", 2), ("null", 0), ("a", 1), ("m", 3)];
        let scenes = scenes.map(|(key, entries)| (key.to_owned(), vec![entry(&[0], &[1]); entries]));
        let index = EvaluationIndex { scenes: scenes.into_iter().collect() };
        assert_eq!(index.first_positions().into_iter().collect::<Vec<_>>(), [("a", 2), ("m", 3), ("z", 0)]);
    }

    #[test]
    fn leaked_targets_keep_order_and_repetitions() {
        assert_eq!(entry(&[3, 9], &[9, 4, 3, 9]).leaked().collect::<Vec<_>>(), [9, 3, 9]);
    }
}
