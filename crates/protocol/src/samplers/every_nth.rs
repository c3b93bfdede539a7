use std::num::NonZeroUsize;

use serde::{Deserialize, Serialize};

use super::{NoEntry, SceneViews, entry};
use crate::IndexEntry;

/// Every n-th frame of the scene as a target, from the first on, and context frames evenly spaced over the others: Long-LRM's
/// evaluation on DL3DV with uniform inputs (Long-LRM `data/dataset.py`, `uniform_every` and `uniform`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct EveryNth {
    /// From one target to the next, in frames; at least 2.
    pub every: NonZeroUsize,
    /// Number of context frames.
    pub context_views: NonZeroUsize,
}

impl EveryNth {
    /// One entry, context and targets ascending; no target is a context frame.
    ///
    /// # Errors
    /// [`NoEntry::TooFewFrames`] if fewer frames than context views are not targets.
    pub fn sample(&self, scene: &SceneViews<'_>) -> Result<Vec<IndexEntry>, NoEntry> {
        let (every, needed) = (self.every.get(), self.context_views.get());
        let (target, others): (Vec<usize>, Vec<usize>) =
            (0..scene.cameras.len()).partition(|frame| frame.is_multiple_of(every));
        if others.len() < needed {
            return Err(NoEntry::TooFewFrames { needed, found: others.len() });
        }
        let context = evenly_spaced(others.len() - 1, needed).filter_map(|at| others.get(at).copied()).collect();
        Ok(vec![entry(context, target)])
    }
}

/// `numpy.linspace(0, last, count, dtype=int)`, with its rounding: position 7 of 15 up to 122 is 60, not 61.
fn evenly_spaced(last: usize, count: usize) -> impl Iterator<Item = usize> {
    let step = last as f64 / count.saturating_sub(1).max(1) as f64;
    (0..count).map(move |at| {
        if at > 0 && at + 1 == count {
            return last;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at most `last`; NumPy rounds down"
        )]
        let position = (at as f64 * step) as usize;
        position.min(last)
    })
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::samplers::test_scene::along;

    fn sample(frames: u32, every: usize, context: usize) -> Result<[Vec<usize>; 2], NoEntry> {
        let number = |n| NonZeroUsize::new(n).unwrap();
        let cameras = along((0..frames).map(|n| DVec3::new(f64::from(n), 0.0, 0.0)));
        let sampler = EveryNth { every: number(every), context_views: number(context) };
        let mut entries = sampler.sample(&SceneViews { key: "line", cameras: &cameras })?;
        assert_eq!(entries.len(), 1);
        let IndexEntry { context, target, .. } = entries.remove(0);
        Ok([context, target])
    }

    /// Without the targets 0, 8, 16 and 24, there are 26 frames, of which 0, 6.25, 12.5, 18.75 and 25 are frames 1, 7, 14, 21 and 29.
    #[test]
    fn context_frames_are_spaced_over_the_frames_that_are_no_targets() {
        assert_eq!(sample(30, 8, 5), Ok([vec![1, 7, 14, 21, 29], vec![0, 8, 16, 24]]));
        assert_eq!(sample(20, 4, 3), Ok([vec![1, 10, 19], vec![0, 4, 8, 12, 16]]));
        assert_eq!(sample(9, 8, 7), Ok([vec![1, 2, 3, 4, 5, 6, 7], vec![0, 8]]), "all others");
        assert_eq!(sample(9, 8, 1), Ok([vec![1], vec![0, 8]]), "the first alone");
    }

    /// The step is 122 / 14, of which 7 are just below 61. The frames that are no targets are 1, 3, 5 and so on.
    #[test]
    fn positions_are_rounded_as_in_numpy() {
        let [context, target] = sample(246, 2, 15).unwrap();
        assert_eq!(context, [1, 17, 35, 53, 69, 87, 105, 121, 139, 157, 175, 191, 209, 227, 245]);
        assert_eq!((target.len(), target.last()), (123, Some(&244)));
    }

    #[test]
    fn too_short_scenes_have_no_entry() {
        assert_eq!(sample(9, 8, 8), Err(NoEntry::TooFewFrames { needed: 8, found: 7 }));
        assert_eq!(sample(9, 1, 1), Err(NoEntry::TooFewFrames { needed: 1, found: 0 }), "every frame is a target");
        assert_eq!(sample(0, 8, 1), Err(NoEntry::TooFewFrames { needed: 1, found: 0 }));
    }
}
