use atsplat_numeric::Extremes as _;

use super::{Assessment, Effect, Request, Scene};
use crate::{Exposure, Gaussians};

/// An affine map of colours after compositing.
#[derive(Debug)]
pub(super) struct ExposureEffect;

impl Effect for ExposureEffect {
    fn name(&self) -> &'static str {
        "exposure"
    }

    fn is_requested(&self, _: &Gaussians, request: &Request) -> bool {
        request.options.exposure.is_some()
    }

    fn remove_from(&self, request: &mut Request) {
        request.options.exposure = None;
    }

    fn assess(&self, scene: &Scene<'_>, request: &Request, budget: f64) -> Assessment {
        let Some(exposure) = request.options.exposure else { return Assessment::keep("not requested") };
        if exposure == Exposure::IDENTITY {
            return Assessment::remove(self, request, 0.0, "it is the identity");
        }
        let mut difference = exposure;
        for (row, one) in difference.matrix.iter_mut().zip(Exposure::IDENTITY.matrix) {
            row.iter_mut().zip(one).for_each(|(entry, one)| *entry -= one);
        }
        let offset = exposure.offset.iter().map(|value| value.abs()).fold(0.0, f64::maximum_of);
        let white_change = difference.gain() + offset;
        if !(white_change <= budget) {
            return Assessment::keep(format!("it changes white by up to {white_change:.2e}"));
        }
        let background = request.options.background.iter().map(|value| value.abs()).fold(0.0, f64::maximum_of);
        let brightest = scene.brightest(request.degree(scene.gaussians())).maximum_of(background);
        if !brightest.is_finite() {
            return Assessment::keep("a colour is not finite or too large to be drawn");
        }
        let bound = difference.gain() * brightest + offset;
        if bound <= budget {
            let reason = format!("it changes no colour of this scene by more than {bound:.1e}");
            Assessment::remove(self, request, bound, reason)
        } else {
            Assessment::keep(format!("it may change the brightest colour by {bound:.2e}"))
        }
    }
}
