use super::{Assessment, Effect, EffectPlan, Request, Scene};
use crate::Gaussians;

/// Gaussians behind others that leave almost no transmittance.
///
/// What follows at a pixel has weights that sum to the transmittance left: [`crate::RenderOptions::hidden`] says how
/// much colour, and at most as much alpha, a renderer may leave out for it.
#[derive(Debug)]
pub(super) struct Hidden;

impl Effect for Hidden {
    fn name(&self) -> &'static str {
        "hidden"
    }

    fn is_requested(&self, gaussians: &Gaussians, request: &Request) -> bool {
        request.options.hidden == 0.0 && !gaussians.is_empty()
    }

    fn remove_from(&self, request: &mut Request) {
        request.options.hidden = EffectPlan::TOLERANCE / request.gain();
    }

    fn assess(&self, _: &Scene<'_>, request: &Request, budget: f64) -> Assessment {
        let (channels, gain) = (request.options.channels, request.gain());
        if channels.depth || channels.scalar {
            return Assessment::keep("depths and scalars are requested, and composited in full");
        }
        let bound = if budget < EffectPlan::UNLIMITED { budget } else { EffectPlan::TOLERANCE };
        let hidden = bound / gain;
        if !(hidden > 0.0 && hidden.is_finite()) {
            return Assessment::keep("no tolerance is left for it");
        }
        let mut reduced = request.clone();
        reduced.options.hidden = hidden;
        let reason = format!("what follows shows no more than {bound:.1e} of its colour");
        Assessment { reduced: Some(reduced), bound: Some(bound), reason }
    }
}
