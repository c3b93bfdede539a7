use std::num::NonZeroUsize;

use atsplat_camera::no_fields;
use atsplat_numeric::SplitMix64;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::evenly_spaced::spread;
use super::{NoEntry, SceneViews, entry};
use crate::IndexEntry;

/// Context frames spread out by farthest-point sampling of camera centres inside a window of frames: how
/// DepthSplat and YoNoSplat made their DL3DV indices (depthsplat
/// `src/dataset/view_sampler/view_sampler_bounded_v2.py:16-49`).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct FarthestPoint {
    /// First frame of the window.
    #[serde(default)]
    pub start: usize,
    /// Frames in the window; it ends with the scene if that is shorter, as in DepthSplat.
    pub window: NonZeroUsize,
    /// Number of context frames.
    pub context_views: NonZeroUsize,
    /// Which frames become targets.
    pub targets: TargetRule,
}

/// Which frames of a window become targets.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "rule", rename_all = "kebab-case", rename_all_fields = "kebab-case", deny_unknown_fields)]
pub enum TargetRule {
    /// Every frame of the window, including context frames: DepthSplat's 2, 4 and 6 views.
    #[serde(deserialize_with = "no_fields")]
    Window,
    /// Every frame from the first to the last context frame, both included: DepthSplat's 12 views.
    #[serde(deserialize_with = "no_fields")]
    BetweenContext,
    /// Distinct random frames from the first to the last context frame, as in YoNoSplat's file of 12 views and eight targets.
    Sampled {
        /// Number of targets.
        count: NonZeroUsize,
        /// Seed; each scene derives its own stream from it.
        seed: u64,
        /// Whether a context frame may be drawn (YoNoSplat's 12 views: yes).
        allow_context: bool,
    },
    /// Every `⌊r / count⌋`-th of the window's `r` frames that are not context frames, from the first of them on, as
    /// [`EvenlySpaced`](super::EvenlySpaced) chooses over whole scenes. Some are outside the context frames, and the last of the
    /// window are never reached. This gives all targets of YoNoSplat's file of 6 views and eight targets in 50 frames, and of
    /// DepthSplat's of 2 views and four targets in 10 frames.
    Spread {
        /// Number of targets.
        count: NonZeroUsize,
    },
}

impl FarthestPoint {
    /// One entry for the scene, context frames ascending.
    ///
    /// # Errors
    /// [`NoEntry::TooFewFrames`] if the window has fewer frames than context views,
    /// [`NoEntry::TooFewTargets`] if there are fewer candidates than targets.
    pub fn sample(&self, scene: &SceneViews<'_>) -> Result<Vec<IndexEntry>, NoEntry> {
        let end = self.start.saturating_add(self.window.get()).min(scene.cameras.len());
        let centres: Vec<DVec3> = scene.centres().take(end).skip(self.start).collect();
        let chosen = farthest_points(&centres, self.context_views.get())
            .ok_or(NoEntry::TooFewFrames { needed: self.context_views.get(), found: centres.len() })?;
        let mut context: Vec<usize> = chosen.iter().map(|position| self.start + position).collect();
        context.sort_unstable();
        let target = self.targets.choose(scene.key, self.start..end, &context)?;
        Ok(vec![entry(context, target)])
    }
}

impl TargetRule {
    fn choose(&self, key: &str, window: std::ops::Range<usize>, context: &[usize]) -> Result<Vec<usize>, NoEntry> {
        let between = match (context.first(), context.last()) {
            (Some(first), Some(last)) => *first..=*last,
            _ => return Err(NoEntry::TooFewTargets { needed: 1, found: 0 }),
        };
        match self {
            Self::Window => Ok(window.collect()),
            Self::BetweenContext => Ok(between.collect()),
            Self::Sampled { count, seed, allow_context } => {
                let candidates: Vec<usize> =
                    between.filter(|frame| *allow_context || !context.contains(frame)).collect();
                let mut target = SplitMix64::for_scene(*seed, key)
                    .distinct(&candidates, count.get())
                    .ok_or(NoEntry::TooFewTargets { needed: count.get(), found: candidates.len() })?;
                target.sort_unstable();
                Ok(target)
            }
            Self::Spread { count } => spread(window.filter(|frame| !context.contains(frame)).collect(), *count),
        }
    }
}

/// Farthest-point sampling: positions of `count` points, first the one farthest from the barycentre, then repeatedly the
/// one farthest from all points taken so far. The result for a smaller `count` is a prefix, so fewer views are a subset
/// of more views. `None` if `count` exceeds the number of points.
///
/// Ties go to the lower position. If all remaining points coincide with taken ones, DepthSplat's code takes position 0
/// again; here the lowest remaining position follows.
pub fn farthest_points(points: &[DVec3], count: usize) -> Option<Vec<usize>> {
    if count > points.len() {
        return None;
    }
    let barycentre = points.iter().sum::<DVec3>() / points.len() as f64;
    let mut distances: Vec<f64> = points.iter().map(|point| point.distance_squared(barycentre)).collect();
    let mut taken = vec![false; points.len()];
    let mut order = Vec::with_capacity(count);
    while order.len() < count {
        let farthest = farthest_untaken(&distances, &taken)?;
        if order.is_empty() {
            distances.fill(f64::INFINITY);
        }
        let centre = *points.get(farthest)?;
        for (distance, point) in distances.iter_mut().zip(points) {
            let to_new = point.distance_squared(centre);
            if to_new < *distance {
                *distance = to_new;
            }
        }
        *taken.get_mut(farthest)? = true;
        order.push(farthest);
    }
    Some(order)
}

fn farthest_untaken(distances: &[f64], taken: &[bool]) -> Option<usize> {
    let mut best: Option<(usize, f64)> = None;
    for (position, (distance, taken)) in distances.iter().zip(taken).enumerate() {
        if !taken && best.is_none_or(|(_, far)| *distance > far) {
            best = Some((position, *distance));
        }
    }
    best.map(|(position, _)| position)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::SamplingRule;
    use crate::samplers::Sampler;
    use crate::samplers::test_scene::along;

    fn number(n: usize) -> NonZeroUsize {
        NonZeroUsize::new(n).unwrap()
    }

    /// A straight dolly: both ends are equally far from the middle, so the first frame wins the tie.
    #[test]
    fn samples_a_straight_line_as_computed_by_hand() {
        let points: Vec<DVec3> = (0..9).map(|x| DVec3::new(f64::from(x), 0.0, 0.0)).collect();
        assert_eq!(farthest_points(&points, 5).unwrap(), [0, 8, 4, 2, 6]);
    }

    #[test]
    fn coincident_points_are_taken_in_order() {
        assert_eq!(farthest_points(&[DVec3::ONE; 4], 3).unwrap(), [0, 1, 2]);
        assert_eq!(farthest_points(&[DVec3::ONE; 2], 3), None);
        assert_eq!(farthest_points(&[], 0).unwrap(), Vec::<usize>::new());
    }

    /// Written by `tests/fixtures/make_oracles.py` with NumPy.
    #[test]
    fn agrees_with_the_numpy_oracle() {
        let oracle: serde_json::Value =
            serde_json::from_str(include_str!("../../tests/fixtures/farthest_oracle.json")).unwrap();
        for case in oracle["cases"].as_array().unwrap() {
            let points: Vec<[f64; 3]> = serde_json::from_value(case["points"].clone()).unwrap();
            let expected: Vec<usize> = serde_json::from_value(case["order"].clone()).unwrap();
            let points: Vec<DVec3> = points.into_iter().map(DVec3::from_array).collect();
            assert_eq!(farthest_points(&points, expected.len()).unwrap(), expected);
        }
    }

    #[test]
    fn chooses_targets_by_rule_within_the_window() {
        let cameras = along((0..60).map(|n| DVec3::new(f64::from(n) * 0.1, 0.0, 0.0)));
        let scene = SceneViews { key: "scene", cameras: &cameras };
        let sampler = |targets| FarthestPoint { start: 5, window: number(11), context_views: number(3), targets };
        let entries = sampler(TargetRule::Window).sample(&scene).unwrap();
        assert_eq!((entries[0].context.clone(), entries[0].target.clone()), (vec![5, 10, 15], (5..16).collect()));
        let sampled = |seed, allow_context| TargetRule::Sampled { count: number(8), seed, allow_context };
        let target = sampler(sampled(1, false)).sample(&scene).unwrap()[0].target.clone();
        assert_eq!(target, [6, 7, 8, 9, 11, 12, 13, 14], "all frames between the context frames");
        assert_eq!(
            sampler(TargetRule::Sampled { count: number(9), seed: 1, allow_context: false }).sample(&scene),
            Err(NoEntry::TooFewTargets { needed: 9, found: 8 })
        );
        let late =
            FarthestPoint { start: 58, window: number(50), context_views: number(3), targets: TargetRule::Window };
        assert_eq!(late.sample(&scene), Err(NoEntry::TooFewFrames { needed: 3, found: 2 }));
    }

    /// Frames 5 to 24 without three context frames are seventeen: every fourth of them. Where the camera turns round at frame 15, that
    /// is the last context frame of two, and frames 16 to 24 are outside.
    #[test]
    fn spreads_targets_over_the_window_inside_and_outside_the_context() {
        let there_and_back = |n: u32| f64::from(if n <= 15 { n } else { 30 - n });
        let turning = along((0..40).map(|n| DVec3::new(there_and_back(n), 0.0, 0.0)));
        let straight = along((0..40).map(|n| DVec3::new(f64::from(n), 0.0, 0.0)));
        let sampler = |views, count| FarthestPoint {
            start: 5,
            window: number(20),
            context_views: number(views),
            targets: TargetRule::Spread { count: number(count) },
        };
        let entry = |cameras: &[_], views, count| {
            let entries = sampler(views, count).sample(&SceneViews { key: "scene", cameras });
            entries.map(|mut entries| {
                let IndexEntry { context, target, .. } = entries.remove(0);
                (context, target)
            })
        };
        assert_eq!(entry(&straight, 3, 4), Ok((vec![5, 14, 24], vec![6, 10, 15, 19])));
        assert_eq!(entry(&turning, 2, 4), Ok((vec![5, 15], vec![6, 10, 14, 19])), "frame 19 is outside");
        assert_eq!(entry(&straight, 3, 17).unwrap().1.len(), 17, "all of them");
        assert_eq!(entry(&straight, 3, 18), Err(NoEntry::TooFewTargets { needed: 18, found: 17 }));
    }

    /// Contexts and targets of YoNoSplat's file of 6 views: an ordinary scene, one whose window begins before its context, and the only
    /// one with a target after it.
    #[test]
    fn spread_targets_are_those_of_the_published_file() {
        let sampler = SamplingRule::resolve("dl3dv-6v-8t").unwrap().sampler;
        let Sampler::FarthestPoint(FarthestPoint { start, window, targets, .. }) = sampler else {
            panic!("{sampler:?}")
        };
        for (context, target) in [
            ([0, 19, 29, 33, 39, 49], [1, 6, 11, 16, 22, 27, 34, 40]),
            ([7, 26, 30, 34, 42, 49], [0, 5, 11, 16, 21, 27, 33, 39]),
            ([0, 14, 19, 24, 28, 38], [1, 6, 11, 17, 23, 30, 35, 41]),
        ] {
            let chosen = targets.choose("scene", start..start + window.get(), &context);
            assert_eq!(chosen.unwrap(), target, "{context:?}");
        }
    }

    proptest! {
        #[test]
        fn fewer_views_are_a_prefix_of_more_views(points in prop::collection::vec(prop::array::uniform3(-10.0..10.0f64), 1..60)) {
            let points: Vec<DVec3> = points.into_iter().map(DVec3::from_array).collect();
            let all = farthest_points(&points, points.len()).unwrap();
            for count in 0..points.len() {
                prop_assert_eq!(&farthest_points(&points, count).unwrap()[..], &all[..count]);
            }
        }

        #[test]
        fn is_invariant_under_translation(
            points in prop::collection::vec(prop::array::uniform3(-10i32..10), 32),
            shift in prop::array::uniform3(-100i32..100),
        ) {
            // Thirty-two integer points: barycentre, distances and ties are exact before and after.
            let points: Vec<DVec3> = points.iter().map(|p| DVec3::from_array(p.map(f64::from))).collect();
            let shift = DVec3::from_array(shift.map(f64::from));
            let moved: Vec<DVec3> = points.iter().map(|p| *p + shift).collect();
            prop_assert_eq!(farthest_points(&points, 12), farthest_points(&moved, 12));
        }
    }
}
