use super::{Assessment, Effect, Request};
use crate::Gaussians;

/// Depth along the optical axis.
#[derive(Debug)]
pub(super) struct Depth;

impl Effect for Depth {
    fn name(&self) -> &'static str {
        "depth"
    }

    fn is_requested(&self, _: &Gaussians, request: &Request) -> bool {
        request.options.channels.depth
    }

    fn remove_from(&self, request: &mut Request) {
        request.options.channels.depth = false;
    }

    fn assess(&self, gaussians: &Gaussians, request: &Request, _: f64) -> Assessment {
        unless_empty(self, gaussians, request)
    }
}

/// The per-Gaussian scalar, such as ATSplat's uncertainty.
#[derive(Debug)]
pub(super) struct Scalar;

impl Effect for Scalar {
    fn name(&self) -> &'static str {
        "scalar"
    }

    fn is_requested(&self, _: &Gaussians, request: &Request) -> bool {
        request.options.channels.scalar
    }

    fn remove_from(&self, request: &mut Request) {
        request.options.channels.scalar = false;
    }

    fn assess(&self, gaussians: &Gaussians, request: &Request, _: f64) -> Assessment {
        // A Gaussian with a NaN scalar is culled.
        let shows = |scalar: &f32| *scalar != 0.0 && !scalar.is_nan();
        match &gaussians.parts().scalars {
            None => Assessment::remove(self, request, 0.0, "the Gaussians have none: the image is zero"),
            Some(scalars) if !scalars.iter().any(shows) => {
                Assessment::remove(self, request, 0.0, "every scalar is zero, and so is the image")
            }
            Some(_) => Assessment::keep("its image is requested"),
        }
    }
}

/// Depth at which the transmittance falls to one half.
#[derive(Debug)]
pub(super) struct MedianDepth;

impl Effect for MedianDepth {
    fn name(&self) -> &'static str {
        "median-depth"
    }

    fn is_requested(&self, _: &Gaussians, request: &Request) -> bool {
        request.options.channels.median_depth
    }

    fn remove_from(&self, request: &mut Request) {
        request.options.channels.median_depth = false;
    }

    fn assess(&self, gaussians: &Gaussians, request: &Request, _: f64) -> Assessment {
        unless_empty(self, gaussians, request)
    }
}

fn unless_empty(effect: &dyn Effect, gaussians: &Gaussians, request: &Request) -> Assessment {
    if gaussians.is_empty() {
        Assessment::remove(effect, request, 0.0, "without Gaussians the image is zero")
    } else {
        Assessment::keep("its image is requested")
    }
}
