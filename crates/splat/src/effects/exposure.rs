use atsplat_numeric::Extremes as _;

use super::{Effect, Judgement, Request, amplitude};
use crate::{Exposure, Gaussians};

/// An affine map of colours after compositing.
#[derive(Debug)]
pub(super) struct ExposureEffect;

impl Effect for ExposureEffect {
    fn name(&self) -> &'static str {
        "exposure"
    }

    fn is_asked_for(&self, _: &Gaussians, request: &Request) -> bool {
        request.options.exposure.is_some()
    }

    fn leave_out(&self, request: &mut Request) {
        request.options.exposure = None;
    }

    fn judge(&self, gaussians: &Gaussians, request: &Request, budget: f64) -> Judgement {
        let Some(exposure) = request.options.exposure else { return Judgement::runs("not asked for") };
        if exposure == Exposure::IDENTITY {
            return Judgement::leaves_out(self, request, 0.0, "it is the identity");
        }
        let mut apart = exposure;
        for (row, one) in apart.matrix.iter_mut().zip(Exposure::IDENTITY.matrix) {
            row.iter_mut().zip(one).for_each(|(entry, one)| *entry -= one);
        }
        let offset = exposure.offset.iter().map(|value| value.abs()).fold(0.0, f64::maximum_of);
        let of_white = apart.gain() + offset;
        if !(of_white <= budget) {
            return Judgement::runs(format!("it changes white by up to {of_white:.2e}"));
        }
        let background = request.options.background.iter().map(|value| value.abs()).fold(0.0, f64::maximum_of);
        let brightest = amplitude::of_colour(gaussians, request.options.max_sh_degree).maximum_of(background);
        let bound = apart.gain() * brightest + offset;
        if bound <= budget {
            let reason = format!("it changes no colour of this scene by more than {bound:.1e}");
            Judgement::leaves_out(self, request, bound, reason)
        } else {
            Judgement::runs(format!("it may change the brightest colour by {bound:.2e}"))
        }
    }
}
