//! Evaluation indices: which frames of which scene are given and which are asked for.
//!
//! One file format serves pixelSplat, MVSplat, DepthSplat, NoPoSplat, YoNoSplat and latentSplat
//! (`assets/evaluation_index_*.json`): an object from scene keys to `null`, an entry, or a list of entries.
//! [`EvaluationIndex`] is what such a file says; [`IndexFile`] is the file itself, with its bytes' hash,
//! its layout and what was odd about it.

mod carried;
mod content;
mod file;
mod layout;
mod misfit;
mod overlap;
mod read;
mod write;

use atsplat_files::Sha256Digest;
use indexmap::IndexMap;

pub use file::IndexFile;
pub use layout::{AbsentForm, IndexLayout, LoneEntryForm, Spacing};
pub use misfit::Misfit;
pub use overlap::Overlap;
pub use read::{IndexNotices, OVERLAP_OF_LARGE, OVERLAP_OF_OTHER_WORDS};

use crate::ProtocolError;

/// Which frames of one scene are given and which are asked for.
///
/// Frame numbers are positions in [`atsplat_scene::Scene::frames`], not timestamps or file numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct IndexEntry {
    /// Frames that a method sees, in the index's order.
    pub context: Vec<usize>,
    /// Frames that it is scored on, in the index's order; may repeat a context frame ("leaked").
    pub target: Vec<usize>,
    /// Overlap of the context views, where the index has one (NoPoSplat).
    pub overlap: Option<Overlap>,
}

impl IndexEntry {
    /// Largest frame number that a file may hold: 92 hours at 30 frames a second. It keeps arithmetic on
    /// frame numbers, and lists of all frames of a window, far from overflow.
    pub const MAX_FRAME: usize = 9_999_999;

    /// First and last context frame by number, the "input window"; `None` without context frames.
    pub fn window(&self) -> Option<(usize, usize)> {
        Some((*self.context.iter().min()?, *self.context.iter().max()?))
    }

    /// Whether `frame` is one that the method was given.
    pub fn is_context(&self, frame: usize) -> bool {
        self.context.contains(&frame)
    }

    /// The targets that are also context frames, in the index's order, repeats included.
    pub fn leaked(&self) -> impl Iterator<Item = usize> {
        self.target.iter().copied().filter(|frame| self.is_context(*frame))
    }

    /// How many frames `frame` lies outside the window: negative before it, positive after it, 0 inside.
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
    /// Scene key → entries. An empty list is the file's `null`: a scene that the protocol leaves out.
    pub scenes: IndexMap<String, Vec<IndexEntry>>,
}

impl EvaluationIndex {
    /// Reads an index from JSON text, refusing what [`IndexFile::parse`] bears with a notice: a scene key
    /// that occurs twice.
    ///
    /// # Errors
    /// [`ProtocolError::Malformed`] with scene key, field, line and column.
    pub fn from_json(bytes: &[u8]) -> Result<Self, ProtocolError> {
        IndexFile::parse(bytes)?.into_unambiguous()
    }

    /// Writes the index as JSON. With the layout of the file that it was read from, official files come
    /// out byte for byte.
    pub fn to_json(&self, layout: &IndexLayout) -> String {
        write::to_json(self, *layout)
    }

    /// Hash of what the index asks for, whatever the file looks like: white space, the order of scenes and
    /// of fields, `null` against absent, an entry against a list of one, and the order of targets do not
    /// change it. See `index/content.rs` for the bytes that go in.
    ///
    /// Two indices with equal content hashes define the same trials. Means over scenes are summed in index
    /// order, so two orders of the same content may differ in the last bit of a mean, and in nothing else.
    pub fn content_hash(&self) -> Sha256Digest {
        content::hash(self)
    }

    /// Hash of the scenes and of their context frames, counted from the first of each window: what a split that
    /// shifts windows keeps of the index that it is made from.
    pub fn context_gaps_hash(&self) -> Sha256Digest {
        content::gaps_hash(self)
    }

    /// Entries in index order: scene key, position within the scene, entry.
    pub fn entries(&self) -> impl Iterator<Item = (&str, usize, &IndexEntry)> {
        self.scenes
            .iter()
            .flat_map(|(key, entries)| entries.iter().enumerate().map(move |(n, entry)| (key.as_str(), n, entry)))
    }

    /// How many scenes have at least one entry; the other keys are the file's `null`s.
    pub fn scene_count(&self) -> usize {
        self.scenes.values().filter(|entries| !entries.is_empty()).count()
    }

    /// How many frames are asked for, over all entries.
    pub fn target_count(&self) -> usize {
        self.entries().map(|(_, _, entry)| entry.target.len()).sum()
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
    fn without_context_there_is_no_window() {
        assert_eq!(entry(&[], &[1]).window(), None);
        assert_eq!(entry(&[], &[1]).frames_outside_window(1), None);
    }

    #[test]
    fn leaked_targets_keep_order_and_repeats() {
        assert_eq!(entry(&[3, 9], &[9, 4, 3, 9]).leaked().collect::<Vec<_>>(), [9, 3, 9]);
    }
}
