use atsplat_numeric::Extremes as _;

use super::{Effect, Judgement, Request};
use crate::Gaussians;

/// A colour behind everything.
#[derive(Debug)]
pub(super) struct Background;

impl Effect for Background {
    fn name(&self) -> &'static str {
        "background"
    }

    fn is_asked_for(&self, _: &Gaussians, request: &Request) -> bool {
        request.options.background.iter().any(|channel| *channel != 0.0)
    }

    fn leave_out(&self, request: &mut Request) {
        request.options.background = [0.0; 3];
    }

    fn judge(&self, _: &Gaussians, request: &Request, budget: f64) -> Judgement {
        let brightest = request.options.background.iter().map(|channel| channel.abs()).fold(0.0, f64::maximum_of);
        let bound = brightest * request.gain();
        if bound <= budget {
            Judgement::leaves_out(self, request, bound, format!("an empty pixel shows no more than {bound:.1e} of it"))
        } else {
            Judgement::runs(format!("an empty pixel shows {bound:.2} of it"))
        }
    }
}
