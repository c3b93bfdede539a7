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
    /// Fewest and most context views; each sample draws a number between them, and fewer views get narrower windows
    /// (depthsplat `view_sampler_bounded_v2.py:93-127`).
    pub context: [NonZeroUsize; 2],
    /// Number of target views.
    pub targets: NonZeroUsize,
    /// Gap between the first and the last context view, in frames of the source.
    pub gaps: GapSchedule,
    /// Least distance of targets inside the window from its ends, in frames; with two context views and `outside = 0`, 1 keeps them
    /// from being targets.
    #[serde(default)]
    pub inset: usize,
    /// Largest distance of targets outside the window, in frames.
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
        let [_, most] = self.context;
        let sampler = Bounded {
            context_views: views,
            target_views: self.targets,
            gaps: self.gaps.divided_for(views, most.get(), step),
            min_distance_to_context: self.inset,
            max_distance_outside: self.outside,
            extra_context: self.extra_context,
            repeat_targets: self.repeat_targets,
            seed: 0,
        };
        sampler.draw(scene, step, random)
    }
}

/// Numbers of views and gaps, as provenance states them: `2 to 4 views, gaps 3 to 5, then 6 to 12, targets 4`.
impl fmt::Display for ViewChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [fewest, most] = self.context;
        if fewest < most {
            write!(f, "{fewest} to ")?;
        }
        let GapSchedule { min, max, initial_min, initial_max, warm_up_steps } = self.gaps;
        write!(f, "{most} views, gaps ")?;
        if warm_up_steps > 0 {
            write!(f, "{initial_min} to {initial_max}, then ")?;
        }
        write!(f, "{min} to {max}, targets {}", self.targets)
    }
}
