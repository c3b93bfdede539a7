use std::num::NonZeroUsize;

use atsplat_numeric::SplitMix64;
use serde::{Deserialize, Serialize};

use super::{NoEntry, SceneViews, entry};
use crate::IndexEntry;
use crate::overlap::EpipolarRays;

/// Two context frames at a bounded distance whose views overlap: the generator behind pixelSplat's RE10K
/// and ACID indices (`src/evaluation/evaluation_index_generator.py`) and latentSplat's extrapolation index
/// (its file of the same name), whose overlap is that of the images' crops. Pure camera geometry.
///
/// First frames are tried in random order. Candidate partners are visited in both directions, first forwards, starting
/// at `min_distance`, until the overlap falls below `min_overlap`; as published, the partner one frame *beyond*
/// `max_distance` is still accepted (pixelSplat's gaps range from 45 to 136). One of the accepted partners is drawn.
/// Defaults are pixelSplat's `config/generate_evaluation_index.yaml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct OverlapPairs {
    /// Smallest distance of the two context frames, in frames.
    #[serde(default = "published::min_distance")]
    pub min_distance: NonZeroUsize,
    /// Distance beyond which no further partner is tried.
    #[serde(default = "published::max_distance")]
    pub max_distance: usize,
    /// Smallest two-way overlap in [0, 1].
    #[serde(default = "published::min_overlap")]
    pub min_overlap: f64,
    /// Largest two-way overlap in [0, 1].
    #[serde(default = "published::max_overlap")]
    pub max_overlap: f64,
    /// How overlap is measured.
    #[serde(default)]
    pub overlap: EpipolarRays,
    /// Which frames become targets.
    pub targets: PairTargets,
    /// Entries per scene, each of another pair (latentSplat's `num_context_pairs_per_scene`, whose pairs have different first frames,
    /// so that the same two frames may come twice, in either order).
    #[serde(default = "published::pairs")]
    pub pairs_per_scene: NonZeroUsize,
    /// Seed; each scene derives its own stream from it.
    pub seed: u64,
}

mod published {
    use std::num::NonZeroUsize;

    const FORTY_FIVE: NonZeroUsize = NonZeroUsize::MIN.saturating_add(44);

    pub(super) const fn min_distance() -> NonZeroUsize {
        FORTY_FIVE
    }
    pub(super) const fn max_distance() -> usize {
        135
    }
    pub(super) const fn min_overlap() -> f64 {
        0.6
    }
    pub(super) const fn max_overlap() -> f64 {
        1.0
    }
    pub(super) const fn pairs() -> NonZeroUsize {
        NonZeroUsize::MIN
    }
}

/// On which side of the window of context frames `[a, b]` the distinct targets are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "side", rename_all = "kebab-case", rename_all_fields = "kebab-case", deny_unknown_fields)]
pub enum PairTargets {
    /// From `a..=b`, including context frames: pixelSplat, three targets.
    Inside {
        /// Number of targets.
        count: NonZeroUsize,
    },
    /// From `a − reach .. a` and `b + 1 ..= b + reach`: latentSplat, three targets within 45 frames.
    Outside {
        /// Number of targets.
        count: NonZeroUsize,
        /// Largest distance from the window, in frames.
        reach: usize,
    },
}

impl OverlapPairs {
    /// Up to `pairs_per_scene` entries, context and targets ascending.
    ///
    /// A pair with too few frames for its targets is skipped, as in latentSplat; pixelSplat's loop would not terminate.
    ///
    /// # Errors
    /// [`NoEntry::NoPair`], [`NoEntry::TooFewFrames`] or [`NoEntry::Geometry`]; [`NoEntry::TooFewTargets`] if every pair has
    /// too few frames for its targets.
    pub fn sample(&self, scene: &SceneViews<'_>) -> Result<Vec<IndexEntry>, NoEntry> {
        let frames = scene.cameras.len();
        if frames <= self.min_distance.get() {
            return Err(NoEntry::TooFewFrames { needed: self.min_distance.get().saturating_add(1), found: frames });
        }
        let mut random = SplitMix64::for_scene(self.seed, scene.key);
        let mut entries = Vec::new();
        let mut reason = NoEntry::NoPair;
        for first in random.permutation(frames) {
            let partners = self.partners(scene, first)?;
            let Some(partner) = random.distinct(&partners, 1).and_then(|drawn| drawn.first().copied()) else {
                continue;
            };
            let (left, right) = (first.min(partner), first.max(partner));
            if entries.iter().any(|entry: &IndexEntry| entry.context == [left, right]) {
                continue;
            }
            match self.targets.draw(left, right, frames, &mut random) {
                Ok(target) => entries.push(entry(vec![left, right], target)),
                Err(too_few) => reason = too_few,
            }
            if entries.len() == self.pairs_per_scene.get() {
                break;
            }
        }
        if entries.is_empty() { Err(reason) } else { Ok(entries) }
    }

    /// The accepted partners of `first`, in the order visited.
    fn partners(&self, scene: &SceneViews<'_>, first: usize) -> Result<Vec<usize>, NoEntry> {
        let frames = scene.cameras.len();
        let min = self.min_distance.get();
        let forwards = first.saturating_add(min)..frames;
        let backwards = (0..(first + 1).saturating_sub(min)).rev();
        let mut partners = Vec::new();
        for walk in [&mut forwards.into_iter() as &mut dyn Iterator<Item = usize>, &mut backwards.into_iter()] {
            for frame in walk {
                let overlap = self.overlap_of(scene, first, frame)?;
                if overlap >= self.min_overlap && overlap <= self.max_overlap {
                    partners.push(frame);
                }
                let panned_away = overlap.is_nan() || overlap < self.min_overlap;
                if panned_away || frame.abs_diff(first) > self.max_distance {
                    break;
                }
            }
        }
        Ok(partners)
    }

    fn overlap_of(&self, scene: &SceneViews<'_>, first: usize, second: usize) -> Result<f64, NoEntry> {
        match (scene.cameras.get(first), scene.cameras.get(second)) {
            (Some(a), Some(b)) => self.overlap.overlap(a, b).map_err(|error| NoEntry::Geometry(error.to_string())),
            _ => Err(NoEntry::TooFewFrames { needed: first.max(second) + 1, found: scene.cameras.len() }),
        }
    }
}

impl PairTargets {
    fn draw(self, left: usize, right: usize, frames: usize, random: &mut SplitMix64) -> Result<Vec<usize>, NoEntry> {
        let (candidates, count): (Vec<usize>, usize) = match self {
            Self::Inside { count } => ((left..=right).collect(), count.get()),
            Self::Outside { count, reach } => {
                let before = left.saturating_sub(reach)..left;
                let after = right + 1..right.saturating_add(reach).saturating_add(1).min(frames);
                (before.chain(after).collect(), count.get())
            }
        };
        let too_few = NoEntry::TooFewTargets { needed: count, found: candidates.len() };
        let mut target = random.distinct(&candidates, count).ok_or(too_few)?;
        target.sort_unstable();
        Ok(target)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use atsplat_numeric::Tolerance;
    use glam::{DMat3, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::SamplingRule;
    use crate::samplers::Sampler;
    use crate::samplers::test_scene::looking;

    fn pairs(targets: PairTargets, seed: u64) -> OverlapPairs {
        OverlapPairs {
            min_distance: published::min_distance(),
            max_distance: published::max_distance(),
            min_overlap: 0.6,
            max_overlap: 1.0,
            overlap: EpipolarRays::default(),
            targets,
            pairs_per_scene: NonZeroUsize::MIN,
            seed,
        }
    }

    const THREE: NonZeroUsize = NonZeroUsize::MIN.saturating_add(2);

    /// A slow pan to the right with sideways motion.
    fn pan(frames: u32, radians_per_frame: f64) -> Vec<atsplat_camera::Camera> {
        (0..frames)
            .map(|n| {
                let n = f64::from(n);
                looking(DMat3::from_rotation_y(n * radians_per_frame), DVec3::new(0.02 * n, 0.0, 0.0))
            })
            .collect()
    }

    /// The defaults of pixelSplat's `config/generate_evaluation_index.yaml`.
    #[test]
    fn the_bounds_are_pixelsplats_by_default() {
        let found: OverlapPairs =
            serde_json::from_str(r#"{"targets": {"side": "inside", "count": 3}, "seed": 123}"#).unwrap();
        let forty_five = NonZeroUsize::new(45).unwrap();
        let bounds = OverlapPairs { min_distance: forty_five, max_distance: 135, ..found };
        assert_eq!(
            found,
            OverlapPairs { min_overlap: 0.6, max_overlap: 1.0, pairs_per_scene: NonZeroUsize::MIN, ..bounds }
        );
        assert_eq!((found.overlap.grid.width, found.overlap.grid.height), (320, 180));
    }

    #[test]
    fn a_fast_pan_gives_no_pair() {
        let cameras: Vec<_> =
            (0..200).map(|n| looking(DMat3::from_rotation_y(f64::from(n) * 0.02), DVec3::ZERO)).collect();
        let sampler = pairs(PairTargets::Inside { count: THREE }, 1);
        assert_eq!(sampler.sample(&SceneViews { key: "pan", cameras: &cameras }), Err(NoEntry::NoPair));
    }

    /// Images of 640×360 that are turned by 25° overlap by 0.65, and what latentSplat's generator sees of them, their squares of
    /// 256×256, by 0.55.
    #[test]
    fn the_overlap_of_latentsplats_pairs_is_that_of_their_crops() {
        let wide = |n: u32| {
            let turn = f64::from(n) / 45.0 * 25.0_f64.to_radians();
            let mut camera = looking(DMat3::from_rotation_y(turn), DVec3::ZERO);
            (camera.intrinsics.fx, camera.intrinsics.fy) = (0.5, 0.5 * 16.0 / 9.0);
            camera
        };
        let cameras: Vec<_> = (0..46).map(wide).collect();
        let scene = SceneViews { key: "turn", cameras: &cameras };
        let rule = SamplingRule::resolve("re10k-extrapolation").unwrap();
        let Sampler::OverlapPairs(published) = rule.sampler else { panic!("another sampler") };
        let whole_images = OverlapPairs { overlap: EpipolarRays::default(), ..published.clone() };
        assert_eq!(whole_images.partners(&scene, 0), Ok(vec![45]));
        assert_eq!(published.partners(&scene, 0), Ok(Vec::new()));
        let overlaps = [&whole_images, &published].map(|sampler| sampler.overlap_of(&scene, 0, 45).unwrap());
        Tolerance::absolute(0.005).assert(overlaps, [0.645, 0.552], "by testing every ray");
    }

    #[test]
    fn rejects_short_scenes() {
        let cameras = pan(45, 0.0);
        let sampler = pairs(PairTargets::Inside { count: THREE }, 1);
        let outcome = sampler.sample(&SceneViews { key: "short", cameras: &cameras });
        assert_eq!(outcome, Err(NoEntry::TooFewFrames { needed: 46, found: 45 }));
    }

    /// Only the first and the last frame are far enough apart, and no frame is outside their window.
    #[test]
    fn pairs_without_room_for_their_targets_are_not_missing_pairs() {
        let cameras = pan(46, 0.0);
        let sampler = pairs(PairTargets::Outside { count: THREE, reach: 45 }, 1);
        let outcome = sampler.sample(&SceneViews { key: "exact", cameras: &cameras });
        assert_eq!(outcome, Err(NoEntry::TooFewTargets { needed: 3, found: 0 }));
    }

    /// Only the first and the last frame are far enough apart: each is the other's partner.
    #[test]
    fn no_pair_is_drawn_twice() {
        let cameras = pan(46, 0.0);
        let scene = SceneViews { key: "exact", cameras: &cameras };
        let sampler = OverlapPairs { pairs_per_scene: THREE, ..pairs(PairTargets::Inside { count: THREE }, 1) };
        let contexts: Vec<_> = sampler.sample(&scene).unwrap().into_iter().map(|entry| entry.context).collect();
        assert_eq!(contexts, [[0, 45]]);
    }

    /// Cameras at rest always overlap, so that the search ends one frame beyond the largest distance.
    #[test]
    fn the_widest_gap_is_one_frame_beyond_the_largest_distance() {
        let cameras = pan(300, 0.0);
        let sampler = pairs(PairTargets::Inside { count: THREE }, 1);
        let partners = sampler.partners(&SceneViews { key: "still", cameras: &cameras }, 140).unwrap();
        assert_eq!((partners.iter().min(), partners.iter().max()), (Some(&4), Some(&276)));
        assert_eq!(partners.len(), 2 * (136 - 45 + 1));
    }

    /// Also at the first and the last of a scene's 30 frames.
    #[test]
    fn every_frame_of_the_side_is_drawn_as_a_target() {
        let drawn = |targets: PairTargets, [left, right]: [usize; 2]| -> BTreeSet<usize> {
            let mut random = SplitMix64::new(1);
            (0..300).flat_map(|_| targets.draw(left, right, 30, &mut random).unwrap()).collect()
        };
        let outside = PairTargets::Outside { count: THREE, reach: 5 };
        assert_eq!(drawn(PairTargets::Inside { count: THREE }, [12, 16]), (12..=16).collect::<BTreeSet<_>>());
        assert_eq!(drawn(outside, [12, 16]), (7..12).chain(17..=21).collect::<BTreeSet<_>>());
        assert_eq!(drawn(outside, [2, 6]), (0..2).chain(7..=11).collect::<BTreeSet<_>>());
        assert_eq!(drawn(outside, [22, 26]), (17..22).chain(27..30).collect::<BTreeSet<_>>());
    }

    proptest! {
        #[test]
        fn entries_respect_all_bounds(seed: u64, outside: bool, step in 0.0..0.004f64) {
            let cameras = pan(220, step);
            let targets = if outside {
                PairTargets::Outside { count: THREE, reach: 45 }
            } else {
                PairTargets::Inside { count: THREE }
            };
            let scene = SceneViews { key: "property", cameras: &cameras };
            let sampler = OverlapPairs { pairs_per_scene: THREE, ..pairs(targets, seed) };
            for entry in sampler.sample(&scene).unwrap() {
                let (a, b) = (entry.context[0], entry.context[1]);
                prop_assert!((45..=136).contains(&(b - a)));
                let overlap = EpipolarRays::default().overlap(&cameras[a], &cameras[b]).unwrap();
                prop_assert!(overlap >= 0.6);
                prop_assert!(entry.target.is_sorted_by(|x, y| x < y) && entry.target.len() == 3);
                for target in entry.target {
                    let inside = (a..=b).contains(&target);
                    prop_assert_eq!(inside, !outside);
                    prop_assert!(target < 220 && target + 45 >= a && target <= b + 45);
                }
            }
        }
    }
}
