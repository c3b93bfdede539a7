use serde::{Deserialize, Serialize};

use crate::IndexEntry;

/// What a target frame is to the context frames of its entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct FrameLabel {
    /// The method was given this very frame.
    pub leaked: bool,
    /// Frames outside the window of context frames: negative before it, positive after it, 0 inside.
    pub signed_distance: i64,
}

/// Labels one frame against an entry's context.
pub fn label(entry: &IndexEntry, frame: usize) -> FrameLabel {
    FrameLabel { leaked: entry.context.contains(&frame), signed_distance: signed_distance(&entry.context, frame) }
}

/// Signed distance of a frame from the window `[min context, max context]`, in frames; 0 inside the window
/// and where there is no context.
pub fn signed_distance(context: &[usize], frame: usize) -> i64 {
    let frames = |n: usize| i64::try_from(n).unwrap_or(i64::MAX);
    match (context.iter().min(), context.iter().max()) {
        (Some(first), _) if frame < *first => -frames(first - frame),
        (_, Some(last)) if frame > *last => frames(frame - last),
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn before_inside_and_after() {
        let context = [20, 10, 15];
        assert_eq!([0, 9, 10, 12, 20, 21, 30].map(|frame| signed_distance(&context, frame)), [-10, -1, 0, 0, 0, 1, 10]);
        assert_eq!(signed_distance(&[], 5), 0);
        assert_eq!(signed_distance(&[0], usize::MAX), i64::MAX, "saturates");
    }

    #[test]
    fn a_context_frame_is_leaked() {
        let entry = IndexEntry { context: vec![3, 9], target: vec![3, 5], overlap: None };
        assert_eq!(label(&entry, 3), FrameLabel { leaked: true, signed_distance: 0 });
        assert_eq!(label(&entry, 5), FrameLabel { leaked: false, signed_distance: 0 });
    }
}
