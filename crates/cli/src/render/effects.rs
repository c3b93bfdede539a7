use atsplat_splat::effects::{EffectPlan, EffectSelection, EffectSummary, Scene};
use atsplat_splat::{RenderOptions, Renderer, Rendering, SplatError};

use super::frames::Frame;
use super::views::Shot;
use crate::parse;

/// Which effects run.
#[derive(Debug, clap::Args)]
pub(crate) struct EffectArgs {
    /// Which of the requested effects run: auto (only those that can change an image by more than --tolerance), all, none,
    /// or a list of names; --explain lists the names.
    #[arg(long, value_name = "LIST", default_value = "auto")]
    pub(super) effects: EffectSelection,

    /// Largest change of any colour or opacity sample that `auto` may cause, in units of display range; depth and scalar
    /// never change.
    #[arg(long, value_name = "CHANGE", default_value_t = EffectPlan::TOLERANCE, value_parser = parse::not_negative)]
    tolerance: f64,

    /// Print for each effect the pixels that call for it, its bound, what it takes and saves, and why it runs or not,
    /// measured on the first frame.
    #[arg(long)]
    pub(crate) explain: bool,
}

/// Render options, and which effects may be skipped.
#[derive(Debug)]
pub(crate) struct Look {
    pub(crate) options: RenderOptions,
    effects: EffectSelection,
    tolerance: f64,
}

impl EffectArgs {
    pub(crate) fn look(&self, options: RenderOptions) -> Look {
        Look { options, effects: self.effects.clone(), tolerance: self.tolerance }
    }
}

impl Look {
    /// Plans the effects of a view.
    pub(crate) fn plan(&self, scene: &Scene<'_>, shot: &Shot) -> Result<EffectPlan, SplatError> {
        let options = shot.exposed(&self.options);
        EffectPlan::for_scene(scene, &shot.view, &options, &self.effects, self.tolerance)
    }

    /// Plans and renders a view.
    pub(crate) fn render(
        &self,
        renderer: &mut dyn Renderer,
        scene: &Scene<'_>,
        shot: &Shot,
    ) -> Result<(Rendering<f32>, EffectPlan), SplatError> {
        let plan = self.plan(scene, shot)?;
        Ok((plan.render(renderer, scene.gaussians())?, plan))
    }

    /// Summarises the effects of all frames.
    pub(crate) fn summary(&self, frames: &[Frame]) -> EffectSummary {
        EffectSummary::new(&self.effects, self.tolerance, &frames.iter().map(|frame| frame.decisions.as_slice()))
    }
}
