use std::num::NonZeroUsize;

use atsplat_numeric::SplitMix64;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{NoEntry, SceneViews, entry, farthest_points};
use crate::IndexEntry;

/// A random window whose width is between two bounds that grow during training: pixelSplat's
/// `src/dataset/view_sampler/view_sampler_bounded.py`, and DepthSplat's `view_sampler_bounded_v2.py` if
/// targets may be outside the window, extra context is spread out or targets are drawn without repetition.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Bounded {
    /// Number of context frames: the two ends of the window and extra ones between them; ≥ 2.
    pub context_views: NonZeroUsize,
    /// Number of targets.
    pub target_views: NonZeroUsize,
    /// Bounds of the distance from the first to the last context frame over training.
    pub gaps: GapSchedule,
    /// Targets are at least this many frames inside the ends of the window (pixelSplat).
    #[serde(default)]
    pub min_distance_to_context: usize,
    /// Targets are at most this many frames outside the window (DepthSplat).
    #[serde(default)]
    pub max_distance_outside: usize,
    /// How the context frames between the ends are chosen.
    #[serde(default)]
    pub extra_context: ExtraContext,
    /// Whether a target may be drawn twice: pixelSplat, MVSplat, DepthSplat on RE10K.
    #[serde(default)]
    pub repeat_targets: bool,
    /// Seed for [`Bounded::sample`]; training passes its own generator to [`Bounded::draw`].
    pub seed: u64,
}

/// How context frames between the two ends of the window are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExtraContext {
    /// Distinct frames strictly between the ends, uniformly.
    #[default]
    Random,
    /// All context frames, including the ends, by farthest-point sampling inside the window (DepthSplat on DL3DV).
    FarthestPoint,
}

/// Bounds of the context gap, linear in the training step until `warm_up_steps`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct GapSchedule {
    /// Smallest gap after the warm-up.
    pub min: usize,
    /// Largest gap after the warm-up.
    pub max: usize,
    /// Smallest gap at step 0; unused without a warm-up.
    #[serde(default)]
    pub initial_min: usize,
    /// Largest gap at step 0; unused without a warm-up.
    #[serde(default)]
    pub initial_max: usize,
    /// Steps until the final bounds; 0 for no warm-up.
    #[serde(default)]
    pub warm_up_steps: u64,
}

impl GapSchedule {
    /// Smallest and largest gap at a training step; a bound that would fall has its final value from the first step on.
    pub fn at(&self, step: u64) -> (usize, usize) {
        if self.warm_up_steps == 0 {
            return (self.min, self.max);
        }
        // After the warm-up a rising bound is capped by its final value, and a falling one would go on falling.
        let fraction = step.min(self.warm_up_steps) as f64 / self.warm_up_steps as f64;
        (interpolate(self.initial_min, self.min, fraction), interpolate(self.initial_max, self.max, fraction))
    }

    /// Names and initial and final value of a bound that would fall during the warm-up, if one does.
    pub fn falling(&self) -> Option<(&'static str, usize, usize)> {
        let bounds =
            [("initial-min and min", self.initial_min, self.min), ("initial-max and max", self.initial_max, self.max)];
        bounds.into_iter().find(|(_, initial, last)| self.warm_up_steps > 0 && initial > last)
    }

    /// The gaps at a training step for fewer views than the maximum: divided by `⌊most / views⌋` after the interpolation
    /// (depthsplat `view_sampler_bounded_v2.py:93-127`).
    #[must_use]
    pub fn divided_for(&self, views: NonZeroUsize, most: usize, step: u64) -> Self {
        let divisor = (most / views).max(1);
        let (min, max) = self.at(step);
        Self { min: min / divisor, max: max / divisor, initial_min: 0, initial_max: 0, warm_up_steps: 0 }
    }
}

/// `min(initial + int((final − initial) · fraction), final)`, in f64 as Python computes it.
#[expect(clippy::cast_possible_truncation, reason = "int() truncates towards zero; frame counts fit")]
fn interpolate(initial: usize, last: usize, fraction: f64) -> usize {
    let moved = ((last as f64 - initial as f64) * fraction) as i64;
    let moved = isize::try_from(moved).unwrap_or(isize::MAX);
    initial.saturating_add_signed(moved).min(last)
}

impl Bounded {
    /// One entry at the end of the schedule, drawn from the scene's stream of `seed` among the windows that have room for it.
    ///
    /// # Errors
    /// Those of [`Bounded::draw`].
    pub fn sample(&self, scene: &SceneViews<'_>) -> Result<Vec<IndexEntry>, NoEntry> {
        let mut random = SplitMix64::for_scene(self.seed, scene.key);
        let entry = self.draw_from(self.least_gap(), scene, self.gaps.warm_up_steps, &mut random)?;
        Ok(vec![entry])
    }

    /// One draw at a training step. Context frames are ascending; targets come in the order drawn. Windows without room for
    /// distinct targets are drawn too: training draws again then, and its samples are those of earlier versions.
    ///
    /// # Errors
    /// [`NoEntry::GapsTooSmall`] if no window of an allowed width contains enough context frames and a target;
    /// [`NoEntry::TooFewFrames`] if none fits the scene; [`NoEntry::TooFewTargets`] if targets must be distinct and there are too few frames.
    pub fn draw(&self, scene: &SceneViews<'_>, step: u64, random: &mut SplitMix64) -> Result<IndexEntry, NoEntry> {
        self.draw_from(self.least_drawn_gap(), scene, step, random)
    }

    fn draw_from(
        &self,
        least_gap: usize,
        scene: &SceneViews<'_>,
        step: u64,
        random: &mut SplitMix64,
    ) -> Result<IndexEntry, NoEntry> {
        let frames = scene.cameras.len();
        let (min_gap, max_gap) = self.gaps.at(step);
        let min_gap = min_gap.max(least_gap);
        if max_gap < min_gap {
            return Err(NoEntry::GapsTooSmall { needed: min_gap, most: max_gap });
        }
        let max_gap = max_gap.min(frames.saturating_sub(1));
        let too_short = NoEntry::TooFewFrames { needed: min_gap.saturating_add(1), found: frames };
        let gap = random.within(min_gap..=max_gap).ok_or(too_short.clone())?;
        let left = random.within(0..=(frames - 1 - gap)).ok_or(too_short.clone())?;
        let right = left + gap;
        let target = self.draw_targets(left, right, frames, random)?;
        let extra = self.extra_views();
        let context = match self.extra_context {
            ExtraContext::FarthestPoint if extra > 0 => {
                let window: Vec<DVec3> = scene.centres().take(right + 1).skip(left).collect();
                let mut chosen = farthest_points(&window, extra + 2).ok_or(too_short)?;
                chosen.sort_unstable();
                chosen.into_iter().map(|position| left + position).collect()
            }
            _ => {
                let between: Vec<usize> = (left + 1..right).collect();
                let mut context = random.distinct(&between, extra).ok_or(too_short)?;
                context.extend([left, right]);
                context.sort_unstable();
                context
            }
        };
        Ok(entry(context, target))
    }

    /// The smallest gap that gives an entry in scenes of any length: the insets, the context frames between the ends and distinct
    /// targets need room.
    pub fn least_gap(&self) -> usize {
        let between_insets = if self.repeat_targets { 0 } else { self.target_views.get() - 1 };
        let insets = self.min_distance_to_context.saturating_mul(2);
        let outside = self.max_distance_outside.saturating_mul(2);
        self.least_drawn_gap().max(insets.saturating_add(between_insets).saturating_sub(outside))
    }

    /// The smallest gap that training draws, whatever the schedule: with room for the insets and the context frames.
    fn least_drawn_gap(&self) -> usize {
        self.min_distance_to_context.saturating_mul(2).max(self.extra_views() + 1)
    }

    /// Number of context frames between the ends of the window.
    const fn extra_views(&self) -> usize {
        self.context_views.get().saturating_sub(2)
    }

    fn draw_targets(
        &self,
        left: usize,
        right: usize,
        frames: usize,
        random: &mut SplitMix64,
    ) -> Result<Vec<usize>, NoEntry> {
        let inset = self.min_distance_to_context;
        let first = (left + inset).saturating_sub(self.max_distance_outside);
        let last = (right - inset).saturating_add(self.max_distance_outside).min(frames - 1);
        let needed = self.target_views.get();
        let too_few = NoEntry::TooFewTargets { needed, found: (last + 1).saturating_sub(first) };
        if self.repeat_targets {
            (0..needed).map(|_| random.within(first..=last).ok_or_else(|| too_few.clone())).collect()
        } else {
            random.distinct(&(first..=last).collect::<Vec<_>>(), needed).ok_or(too_few)
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;
    use crate::samplers::test_scene::along;

    /// DepthSplat and iLRM on RE10K: 25–45 → 45–135 over 30 000 steps.
    const DEPTHSPLAT_RE10K: GapSchedule =
        GapSchedule { min: 45, max: 135, initial_min: 25, initial_max: 45, warm_up_steps: 30_000 };

    fn bounded() -> Bounded {
        Bounded {
            context_views: NonZeroUsize::new(2).unwrap(),
            target_views: NonZeroUsize::new(4).unwrap(),
            gaps: DEPTHSPLAT_RE10K,
            min_distance_to_context: 0,
            max_distance_outside: 0,
            extra_context: ExtraContext::Random,
            repeat_targets: true,
            seed: 1,
        }
    }

    #[test]
    fn schedules_are_linear_until_the_end_of_the_warm_up() {
        let gaps = DEPTHSPLAT_RE10K;
        assert_eq!(
            [0, 7_499, 7_500, 15_000, 30_000, 90_000].map(|step| gaps.at(step)),
            [(25, 45), (29, 67), (30, 67), (35, 90), (45, 135), (45, 135)]
        );
        assert_eq!(GapSchedule { warm_up_steps: 0, ..gaps }.at(0), (45, 135));
        let shrinking = GapSchedule { initial_min: 50, ..gaps };
        assert_eq!(
            [0, 15_000, 30_000, 60_000, 300_000].map(|step| shrinking.at(step).0),
            [45; 5],
            "min(…, final) ends a falling schedule at once, as in pixelSplat, and it falls no further"
        );
        assert_eq!(gaps.at(u64::MAX), (45, 135));
    }

    #[test]
    fn fewer_views_get_narrower_windows() {
        // DepthSplat on DL3DV: 15–30 → 20–50 over 10 000 steps.
        let gaps = GapSchedule { min: 20, max: 50, initial_min: 15, initial_max: 30, warm_up_steps: 10_000 };
        let of = |views: usize, step: u64| gaps.divided_for(NonZeroUsize::new(views).unwrap(), 6, step).at(step);
        assert_eq!([0, 10_000, 20_000].map(|step| of(2, step)), [(5, 10), (6, 16), (6, 16)]);
        // 15 → 15.75 and 30 → 33 by step 1500; 16 and 34 by step 2000.
        assert_eq!([of(2, 1500), of(3, 2000)], [(5, 11), (8, 17)]);
        assert_eq!(of(10, 1500), gaps.at(1500));
    }

    #[test]
    fn rejects_a_scene_one_frame_too_short() {
        let cameras = along((0..45).map(|n| DVec3::new(f64::from(n), 0.0, 0.0)));
        let scene = SceneViews { key: "short", cameras: &cameras };
        assert_eq!(bounded().sample(&scene), Err(NoEntry::TooFewFrames { needed: 46, found: 45 }));
    }

    /// However long the scene is: five frames do not hold an inset of three on both sides, nor do they hold eight views.
    #[test]
    fn gaps_that_are_too_small_are_not_the_scenes_fault() {
        let cameras = along((0..20).map(|n| DVec3::new(f64::from(n), 0.0, 0.0)));
        let scene = SceneViews { key: "long enough", cameras: &cameras };
        let gaps = GapSchedule { min: 4, max: 5, initial_min: 0, initial_max: 0, warm_up_steps: 0 };
        let with = |views: usize, inset: usize| {
            let context_views = NonZeroUsize::new(views).unwrap();
            Bounded { context_views, gaps, min_distance_to_context: inset, ..bounded() }.sample(&scene)
        };
        assert_eq!(with(2, 3), Err(NoEntry::GapsTooSmall { needed: 6, most: 5 }));
        assert_eq!(with(8, 0), Err(NoEntry::GapsTooSmall { needed: 7, most: 5 }));
        assert!(with(6, 2).is_ok());
    }

    /// Eight distinct targets need a gap of seven: half of the gaps from four to nine have no room for them.
    #[test]
    fn every_scene_with_room_for_the_targets_has_an_entry() {
        let cameras = along((0..40).map(|n| DVec3::new(f64::from(n), 0.0, 0.0)));
        let gaps = GapSchedule { min: 4, max: 9, initial_min: 0, initial_max: 0, warm_up_steps: 0 };
        let with = |max: usize, seed: u64| {
            let gaps = GapSchedule { max, ..gaps };
            let target_views = NonZeroUsize::new(8).unwrap();
            let sampler = Bounded { target_views, gaps, repeat_targets: false, seed, ..bounded() };
            sampler.sample(&SceneViews { key: "long", cameras: &cameras })
        };
        let widths = (0..100).map(|seed| {
            let context = with(9, seed).unwrap().remove(0).context;
            context[1] - context[0]
        });
        assert_eq!(widths.collect::<BTreeSet<_>>(), [7, 8, 9].into());
        assert_eq!(with(6, 1), Err(NoEntry::GapsTooSmall { needed: 7, most: 6 }));
    }

    /// Places of the targets from the first context frame, which the last one follows by six frames.
    #[test]
    fn targets_reach_as_far_as_they_may_and_no_farther() {
        let cameras = along((0..40).map(|n| DVec3::new(f64::from(n), 0.0, 0.0)));
        let gaps = GapSchedule { min: 6, max: 6, initial_min: 0, initial_max: 0, warm_up_steps: 0 };
        let reached = |outside: usize, inset: usize| -> BTreeSet<i32> {
            let drawn = (0..500).map(|seed| {
                let bounds = Bounded { max_distance_outside: outside, min_distance_to_context: inset, ..bounded() };
                let scene = SceneViews { key: "long", cameras: &cameras };
                Bounded { gaps, seed, ..bounds }.sample(&scene).unwrap().remove(0)
            });
            let places = drawn.map(|IndexEntry { context, target, .. }| {
                let frame = |frame: usize| i32::try_from(frame).unwrap();
                target.into_iter().map(|target| frame(target) - frame(context[0])).collect::<Vec<_>>()
            });
            places.flatten().collect()
        };
        assert_eq!(reached(0, 0), (0..=6).collect::<BTreeSet<_>>());
        assert_eq!(reached(3, 0), (-3..=9).collect::<BTreeSet<_>>());
        assert_eq!(reached(0, 2), (2..=4).collect::<BTreeSet<_>>());
        assert_eq!(reached(3, 1), (-2..=8).collect::<BTreeSet<_>>());
    }

    proptest! {
        #[test]
        fn draws_respect_all_bounds(
            seed: u64,
            frames in 60u32..200,
            views in 2usize..8,
            outside in 0usize..20,
            inset in 0usize..10,
            farthest: bool,
            repeat_targets: bool,
        ) {
            let cameras = along((0..frames).map(|n| DVec3::new(f64::from(n).sin(), f64::from(n) * 0.1, 0.0)));
            let scene = SceneViews { key: "property", cameras: &cameras };
            let sampler = Bounded {
                context_views: NonZeroUsize::new(views).unwrap(),
                max_distance_outside: outside,
                min_distance_to_context: inset,
                extra_context: if farthest { ExtraContext::FarthestPoint } else { ExtraContext::Random },
                repeat_targets,
                seed,
                ..bounded()
            };
            let drawn = sampler.sample(&scene).unwrap().remove(0);
            prop_assert_eq!(&sampler.sample(&scene).unwrap()[0], &drawn, "the same seed draws the same");
            prop_assert_eq!(drawn.context.len(), views);
            prop_assert!(drawn.context.is_sorted_by(|a, b| a < b), "{:?}", drawn.context);
            let (left, right) = (drawn.context[0], drawn.context[views - 1]);
            prop_assert!(right < frames as usize && right - left <= 135);
            if !farthest || views == 2 {
                prop_assert!(right - left >= 45);
                for target in &drawn.target {
                    prop_assert!(*target + outside >= left + inset && *target + inset <= right + outside);
                }
            }
            if !repeat_targets {
                let mut target = drawn.target.clone();
                target.sort_unstable();
                target.dedup();
                prop_assert_eq!(target.len(), 4);
            }
        }
    }
}
