use std::num::NonZeroUsize;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{NoEntry, SceneViews, entry, farthest_points};
use crate::IndexEntry;

/// Context frames by farthest-point sampling over the whole scene, and targets spread evenly over the remaining
/// frames, inside and outside the window of context frames: `MVSplat360`'s DL3DV protocol
/// (`src/scripts/generate_evaluation_index_dl3dv.py:28-96`; published with 5 context and 56 target views).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct EvenlySpaced {
    /// Number of context frames.
    pub context_views: NonZeroUsize,
    /// Number of targets.
    pub target_views: NonZeroUsize,
    /// Only the first `int(frames · ratio)` frames of the scene are used (0.5 is the published `_n150`).
    #[serde(default = "whole_scene")]
    pub ratio: f64,
}

const fn whole_scene() -> f64 {
    1.0
}

impl EvenlySpaced {
    /// One entry, context and targets ascending; no target is a context frame.
    ///
    /// With `r` remaining frames and `n` targets, target `i` is remaining frame `i · ⌊r / n⌋`: as published, the last
    /// frames are never reached if `n` does not divide `r`.
    ///
    /// # Errors
    /// [`NoEntry::TooFewFrames`] and [`NoEntry::TooFewTargets`] for short scenes.
    pub fn sample(&self, scene: &SceneViews<'_>) -> Result<Vec<IndexEntry>, NoEntry> {
        let used = used_frames(scene.cameras.len(), self.ratio);
        let centres: Vec<DVec3> = scene.centres().take(used).collect();
        let mut context = farthest_points(&centres, self.context_views.get())
            .ok_or(NoEntry::TooFewFrames { needed: self.context_views.get(), found: used })?;
        context.sort_unstable();
        let remaining: Vec<usize> = (0..used).filter(|frame| context.binary_search(frame).is_err()).collect();
        let target = spread(remaining, self.target_views)?;
        Ok(vec![entry(context, target)])
    }
}

/// `count` frames in equal steps of whole frames, from the first on.
///
/// # Errors
/// [`NoEntry::TooFewTargets`] if there are fewer frames.
pub(super) fn spread(frames: Vec<usize>, count: NonZeroUsize) -> Result<Vec<usize>, NoEntry> {
    let step = frames.len() / count;
    if step == 0 {
        return Err(NoEntry::TooFewTargets { needed: count.get(), found: frames.len() });
    }
    Ok(frames.into_iter().step_by(step).take(count.get()).collect())
}

/// `int(frames · ratio)`, at most `frames`; 0 for NaN.
fn used_frames(frames: usize, ratio: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Python's int() truncates too")]
    let used = (frames as f64 * ratio) as usize;
    used.min(frames)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samplers::test_scene::along;

    fn sampler(context: usize, targets: usize, ratio: f64) -> EvenlySpaced {
        let number = |n| NonZeroUsize::new(n).unwrap();
        EvenlySpaced { context_views: number(context), target_views: number(targets), ratio }
    }

    #[test]
    fn targets_are_the_first_frames_of_equal_bins() {
        let cameras = along((0..20).map(|n| DVec3::new(f64::from(n), 0.0, 0.0)));
        let scene = SceneViews { key: "line", cameras: &cameras };
        let entries = sampler(2, 4, 1.0).sample(&scene).unwrap();
        assert_eq!(entries[0].context, [0, 19]);
        assert_eq!(entries[0].target, [1, 5, 9, 13], "eighteen frames remain, every fourth of them");
        let half = sampler(2, 4, 0.5).sample(&scene).unwrap();
        assert_eq!((half[0].context.clone(), half[0].target.clone()), (vec![0, 9], vec![1, 3, 5, 7]));
    }

    #[test]
    fn handles_short_scenes_and_invalid_ratios() {
        let cameras = along((0..6).map(|n| DVec3::new(f64::from(n), 0.0, 0.0)));
        let scene = SceneViews { key: "line", cameras: &cameras };
        assert_eq!(sampler(2, 5, 1.0).sample(&scene), Err(NoEntry::TooFewTargets { needed: 5, found: 4 }));
        assert_eq!(sampler(7, 1, 1.0).sample(&scene), Err(NoEntry::TooFewFrames { needed: 7, found: 6 }));
        assert_eq!(sampler(2, 4, f64::INFINITY).sample(&scene), sampler(2, 4, 1.0).sample(&scene));
        for ratio in [f64::NAN, -1.0, 0.0] {
            assert_eq!(sampler(2, 1, ratio).sample(&scene), Err(NoEntry::TooFewFrames { needed: 2, found: 0 }));
        }
    }
}
