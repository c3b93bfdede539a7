use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::IndexEntry;

/// The position of a target frame relative to the context frames of its entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct FrameLabel {
    /// Whether the frame is also a context frame.
    pub leaked: bool,
    /// Distance from the window of context frames: negative before it, positive after it, 0 inside it.
    pub signed_distance: i64,
}

impl FrameLabel {
    /// Labels a frame against an entry's context; `None` without context frames.
    pub fn of(entry: &IndexEntry, frame: usize) -> Option<Self> {
        Some(Self { leaked: entry.is_context(frame), signed_distance: entry.frames_outside_window(frame)? })
    }
}

/// The number of targets at each [`FrameLabel::signed_distance`]. Scores fall with the distance, so a mean over an
/// extrapolation index means little without it. `Display` summarises it by side.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct TargetDistances(pub BTreeMap<i64, u64>);

impl TargetDistances {
    /// Counts the targets of some entries; entries without context are skipped.
    pub fn of<'a>(entries: impl IntoIterator<Item = &'a IndexEntry>) -> Self {
        let mut counts = BTreeMap::new();
        for entry in entries {
            for distance in entry.target.iter().filter_map(|frame| entry.frames_outside_window(*frame)) {
                *counts.entry(distance).or_default() += 1;
            }
        }
        Self(counts)
    }
}

impl fmt::Display for TargetDistances {
    /// `-10 to -1: 140 each, 0: 7, 1 to 10: 140 each`, or the range of the counts if they differ:
    /// `-45 to -1: 96 to 240 each`, from 0 if no target is at one of these distances.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sides: [fn(i64) -> bool; 3] = [|d| d < 0, |d| d == 0, |d| d > 0];
        let mut separator = "";
        for side in sides {
            let on_side = || self.0.iter().filter(|(distance, _)| side(**distance));
            let distances = (on_side().next(), on_side().next_back());
            let counts = (on_side().map(|(_, n)| n).min(), on_side().map(|(_, n)| n).max());
            let ((Some((near, _)), Some((far, _))), (Some(fewest), Some(most))) = (distances, counts) else { continue };
            let is_complete = on_side().count() as u64 > far.abs_diff(*near);
            let fewest = if is_complete { *fewest } else { 0 };
            write!(f, "{separator}{near}")?;
            if near != far {
                write!(f, " to {far}")?;
            }
            write!(f, ": {fewest}")?;
            if fewest != *most {
                write!(f, " to {most}")?;
            }
            if near != far {
                write!(f, " each")?;
            }
            separator = ", ";
        }
        if separator.is_empty() { f.write_str("none") } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_frames_before_inside_and_after_the_window() {
        let entry = IndexEntry { context: vec![20, 10, 15], target: Vec::new(), overlap: None };
        let labels = [0, 9, 10, 12, 20, 21, 30].map(|frame| FrameLabel::of(&entry, frame).unwrap());
        assert_eq!(labels.map(|label| label.signed_distance), [-10, -1, 0, 0, 0, 1, 10]);
        assert_eq!(labels.map(|label| label.leaked), [false, false, true, false, true, false, false]);
        let without_context = IndexEntry { context: Vec::new(), ..entry };
        assert_eq!(FrameLabel::of(&without_context, 9), None);
    }

    #[test]
    fn counts_by_distance_and_displays_by_side() {
        let entry = |context: &[usize], target: &[usize]| IndexEntry {
            context: context.to_vec(),
            target: target.to_vec(),
            overlap: None,
        };
        let entries = [entry(&[10, 20], &[8, 9, 10, 15, 21]), entry(&[5], &[4, 6, 7]), entry(&[], &[1])];
        let distances = TargetDistances::of(&entries);
        assert_eq!(distances.0, BTreeMap::from([(-2, 1), (-1, 2), (0, 2), (1, 2), (2, 1)]));
        assert_eq!(distances.to_string(), "-2 to -1: 1 to 2 each, 0: 2, 1 to 2: 1 to 2 each");
        assert_eq!(TargetDistances::of(&entries[2..]).to_string(), "none");
        let sparse = TargetDistances::of(&[entry(&[10, 20], &[0, 9, 21, 22])]);
        assert_eq!(sparse.to_string(), "-10 to -1: 0 to 1 each, 1 to 2: 1 each", "two of the ten distances before");
        assert_eq!(serde_json::to_string(&TargetDistances::of(&entries[1..2])).unwrap(), r#"{"-1":1,"1":1,"2":1}"#);
    }
}
