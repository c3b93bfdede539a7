use super::{Effect, Judgement, Request};
use crate::Gaussians;

/// Depth along the optical axis.
#[derive(Debug)]
pub(super) struct Depth;

impl Effect for Depth {
    fn name(&self) -> &'static str {
        "depth"
    }

    fn is_asked_for(&self, _: &Gaussians, request: &Request) -> bool {
        request.options.channels.depth
    }

    fn leave_out(&self, request: &mut Request) {
        request.options.channels.depth = false;
    }

    fn judge(&self, gaussians: &Gaussians, request: &Request, _: f64) -> Judgement {
        unless_empty(self, gaussians, request)
    }
}

/// The Gaussians' own scalar, as ATSplat's uncertainty.
#[derive(Debug)]
pub(super) struct Scalar;

impl Effect for Scalar {
    fn name(&self) -> &'static str {
        "scalar"
    }

    fn is_asked_for(&self, _: &Gaussians, request: &Request) -> bool {
        request.options.channels.scalar
    }

    fn leave_out(&self, request: &mut Request) {
        request.options.channels.scalar = false;
    }

    fn judge(&self, gaussians: &Gaussians, request: &Request, _: f64) -> Judgement {
        // What is NaN is culled, and shows in no image.
        let shows = |scalar: &f32| *scalar != 0.0 && !scalar.is_nan();
        match &gaussians.parts().scalars {
            None => Judgement::leaves_out(self, request, 0.0, "the Gaussians have none: the image is zero"),
            Some(scalars) if !scalars.iter().any(shows) => {
                Judgement::leaves_out(self, request, 0.0, "every scalar is zero, and so is the image")
            }
            Some(_) => Judgement::runs("its image was asked for"),
        }
    }
}

/// Depth at which half of the light is blocked.
#[derive(Debug)]
pub(super) struct MedianDepth;

impl Effect for MedianDepth {
    fn name(&self) -> &'static str {
        "median-depth"
    }

    fn is_asked_for(&self, _: &Gaussians, request: &Request) -> bool {
        request.options.channels.median_depth
    }

    fn leave_out(&self, request: &mut Request) {
        request.options.channels.median_depth = false;
    }

    fn judge(&self, gaussians: &Gaussians, request: &Request, _: f64) -> Judgement {
        unless_empty(self, gaussians, request)
    }
}

fn unless_empty(effect: &dyn Effect, gaussians: &Gaussians, request: &Request) -> Judgement {
    if gaussians.is_empty() {
        Judgement::leaves_out(effect, request, 0.0, "without Gaussians the image is zero")
    } else {
        Judgement::runs("its image was asked for")
    }
}
