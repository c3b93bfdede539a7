use std::fmt;
use std::num::NonZeroUsize;

use atsplat_numeric::SplitMix64;
use atsplat_protocol::IndexEntry;
use atsplat_protocol::samplers::{Bounded, ExtraContext, GapSchedule, NoEntry, SceneViews};
use serde::{Deserialize, Serialize};

/// How context and target frames of a scene are drawn: the papers' bounded window, whose width grows with the step.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ViewChoice {
    /// Smallest and largest number of context views; each sample draws a number between them, and fewer views get narrower windows
    /// (depthsplat `view_sampler_bounded_v2.py:93-127`).
    pub context: [NonZeroUsize; 2],
    /// Number of target views.
    pub targets: NonZeroUsize,
    /// Gap between the first and the last context view, in frames of the source.
    pub gaps: GapSchedule,
    /// Smallest distance of targets inside the window from its ends, in frames; with two context views, 1 keeps them from being targets.
    /// Not together with `outside`.
    #[serde(default)]
    pub inset: usize,
    /// Largest distance of targets outside the window, in frames. Not together with `inset`.
    #[serde(default)]
    pub outside: usize,
    /// How context views between the ends are chosen.
    #[serde(default)]
    pub extra_context: ExtraContext,
    /// Whether a frame may be a target twice.
    #[serde(default)]
    pub repeat_targets: bool,
}

impl ViewChoice {
    /// The steps at which gaps are at their smallest and at their largest, each with every allowed number of context views.
    pub(crate) fn extremes(&self) -> impl Iterator<Item = (u64, NonZeroUsize)> {
        let [fewest, most] = self.context;
        let last = self.gaps.warm_up_steps;
        let steps = std::iter::once(0).chain((last > 0).then_some(last));
        let numbers = (fewest.get()..=most.get()).filter_map(NonZeroUsize::new);
        steps.flat_map(move |step| numbers.clone().map(move |views| (step, views)))
    }

    /// The sampler of this many context views at a step.
    pub(crate) fn sampler(&self, views: NonZeroUsize, step: u64) -> Bounded {
        let [_, most] = self.context;
        Bounded {
            context_views: views,
            target_views: self.targets,
            gaps: self.gaps.divided_for(views, most.get(), step),
            min_distance_to_context: self.inset,
            max_distance_outside: self.outside,
            extra_context: self.extra_context,
            repeat_targets: self.repeat_targets,
            seed: 0,
        }
    }

    /// Draws the frames of one sample.
    ///
    /// # Errors
    /// [`NoEntry`] if the scene is too short.
    pub fn draw(&self, scene: &SceneViews<'_>, step: u64, random: &mut SplitMix64) -> Result<IndexEntry, NoEntry> {
        let [fewest, most] = self.context;
        #[expect(clippy::expect_used, reason = "configurations with an empty range are rejected when they are read")]
        let views =
            random.within(fewest.get()..=most.get()).and_then(NonZeroUsize::new).expect("fewest to most context views");
        self.draw_with(views, scene, step, random)
    }

    /// Draws the frames of one sample with this many context views.
    ///
    /// # Errors
    /// As [`Self::draw`].
    pub(crate) fn draw_with(
        &self,
        views: NonZeroUsize,
        scene: &SceneViews<'_>,
        step: u64,
        random: &mut SplitMix64,
    ) -> Result<IndexEntry, NoEntry> {
        self.sampler(views, step).draw(scene, step, random)
    }
}

/// Numbers of views and gaps, as provenance states them: `2 to 4 views, gaps 3 to 5, then 6 to 12, targets 4`. Gaps are those of the most
/// views, without those that give no sample.
impl fmt::Display for ViewChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [fewest, most] = self.context;
        if fewest < most {
            write!(f, "{fewest} to ")?;
        }
        let GapSchedule { min, max, initial_min, initial_max, warm_up_steps } = self.gaps;
        write!(f, "{most} views, gaps ")?;
        let least = self.sampler(most, warm_up_steps).least_gap();
        let drawn = |smallest: usize| smallest.max(least);
        // No initial gap may give a sample of the most views, as in runs of earlier versions.
        if warm_up_steps > 0 && drawn(initial_min) <= initial_max {
            write!(f, "{} to {initial_max}, then ", drawn(initial_min))?;
        }
        write!(f, "{} to {max}, targets {}", drawn(min), self.targets)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Insets of three leave targets in gaps of six and more, and four views need gaps of three.
    #[test]
    fn gaps_that_give_no_sample_are_not_stated() {
        let stated = |views: &str| toml::from_str::<ViewChoice>(views).unwrap().to_string();
        let with = |context: &str, more: &str| {
            stated(&format!("context = {context}\ntargets = 1\ngaps = {{ min = 1, max = 8{more}"))
        };
        assert_eq!(with("[2, 2]", " }\ninset = 3"), "2 views, gaps 6 to 8, targets 1");
        assert_eq!(with("[2, 2]", " }\noutside = 3"), "2 views, gaps 1 to 8, targets 1");
        let growing = ", initial-min = 1, initial-max = 7, warm-up-steps = 9 }";
        assert_eq!(with("[2, 4]", growing), "2 to 4 views, gaps 3 to 7, then 3 to 8, targets 1");
        assert_eq!(with("[2, 8]", growing), "2 to 8 views, gaps 7 to 7, then 7 to 8, targets 1");
        let too_small = growing.replace('7', "6");
        assert_eq!(with("[2, 8]", &too_small), "2 to 8 views, gaps 7 to 8, targets 1");
    }
}
