use atsplat_numeric::SplitMix64;
use std::num::NonZeroUsize;

use atsplat_protocol::IndexEntry;
use atsplat_protocol::samplers::{Bounded, ExtraContext, GapSchedule, NoEntry, SceneViews};
use serde::{Deserialize, Serialize};

/// Which frames of a scene become context and targets: the papers' bounded window, whose width grows with the step.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ViewChoice {
    /// Fewest and most context views; a number between is drawn for each sample, and fewer views get narrower windows
    /// (depthsplat `view_sampler_bounded_v2.py:93-127`).
    pub context: [NonZeroUsize; 2],
    /// Target views.
    pub targets: NonZeroUsize,
    /// Frames between the first and the last context view, as the source counts frames.
    pub gaps: GapSchedule,
    /// How many frames targets stay away from the ends of the window, inside; 1 keeps context frames from being targets.
    #[serde(default)]
    pub inset: usize,
    /// How many frames targets may lie outside the window.
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
    /// Frames for one sample.
    ///
    /// # Errors
    /// [`NoEntry`] where the scene is too short for it.
    pub fn draw(&self, scene: &SceneViews<'_>, step: u64, random: &mut SplitMix64) -> Result<IndexEntry, NoEntry> {
        let [fewest, most] = self.context;
        let views = random.within(fewest.get()..=most.get()).and_then(NonZeroUsize::new).unwrap_or(fewest);
        let sampler = Bounded {
            context_views: views,
            target_views: self.targets,
            gaps: self.gaps.divided_for(views, most.get()),
            min_distance_to_context: self.inset,
            max_distance_outside: self.outside,
            extra_context: self.extra_context,
            repeat_targets: self.repeat_targets,
            seed: 0,
        };
        sampler.draw(scene, step, random)
    }
}
