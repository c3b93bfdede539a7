use super::{Effect, Judgement, Request, geometry};
use crate::{Gaussians, RasterMode};

/// Opacity that falls as the blur spreads what is smaller than a pixel.
#[derive(Debug)]
pub(super) struct Antialiasing;

impl Effect for Antialiasing {
    fn name(&self) -> &'static str {
        "antialiasing"
    }

    fn is_asked_for(&self, _: &Gaussians, request: &Request) -> bool {
        request.options.mode == RasterMode::Antialiased
    }

    fn leave_out(&self, request: &mut Request) {
        request.options.mode = RasterMode::Classic;
    }

    fn judge(&self, gaussians: &Gaussians, request: &Request, _: f64) -> Judgement {
        if request.options.constants.blur == 0.0 {
            return Judgement::leaves_out(self, request, 0.0, "nothing is blurred, so nothing is compensated");
        }
        let mut reduced = request.clone();
        self.leave_out(&mut reduced);
        match geometry::objection(gaussians, request, &reduced) {
            None => Judgement::leaves_out(self, request, 0.0, "it changes no Gaussian that is drawn"),
            Some(objection) => Judgement::runs(objection),
        }
    }
}
