use super::{Assessment, Effect, Request, Scene, geometry};
use crate::{Gaussians, RasterMode};

/// Opacity compensation for the screen-space blur of Gaussians smaller than a pixel.
#[derive(Debug)]
pub(super) struct Antialiasing;

impl Effect for Antialiasing {
    fn name(&self) -> &'static str {
        "antialiasing"
    }

    fn is_requested(&self, _: &Gaussians, request: &Request) -> bool {
        request.options.mode == RasterMode::Antialiased
    }

    fn remove_from(&self, request: &mut Request) {
        request.options.mode = RasterMode::Classic;
    }

    fn assess(&self, scene: &Scene<'_>, request: &Request, _: f64) -> Assessment {
        if request.options.constants.blur == 0.0 {
            return Assessment::remove(self, request, 0.0, "nothing is blurred, so nothing is compensated");
        }
        geometry::remove_if_unused(self, scene.gaussians(), request, "it changes no Gaussian that is drawn")
    }
}
