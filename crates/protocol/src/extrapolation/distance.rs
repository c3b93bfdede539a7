use serde::{Deserialize, Serialize};

use crate::IndexEntry;

/// What a target frame is to the context frames of its entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct FrameLabel {
    /// The method was given this very frame.
    pub leaked: bool,
    /// Frames outside the window of context frames: negative before it, positive after it, 0 inside it and
    /// where there is no context.
    pub signed_distance: i64,
}

impl FrameLabel {
    /// Labels a frame against an entry's context.
    pub fn of(entry: &IndexEntry, frame: usize) -> Self {
        Self {
            leaked: entry.is_context(frame),
            signed_distance: entry.frames_outside_window(frame).unwrap_or_default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn before_inside_and_after() {
        let entry = IndexEntry { context: vec![20, 10, 15], target: Vec::new(), overlap: None };
        let labels = [0, 9, 10, 12, 20, 21, 30].map(|frame| FrameLabel::of(&entry, frame));
        assert_eq!(labels.map(|label| label.signed_distance), [-10, -1, 0, 0, 0, 1, 10]);
        assert_eq!(labels.map(|label| label.leaked), [false, false, true, false, true, false, false]);
    }
}
