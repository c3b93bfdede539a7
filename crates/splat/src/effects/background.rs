use atsplat_numeric::Extremes as _;

use super::{Assessment, Effect, Request, Scene};
use crate::Gaussians;

/// A colour behind everything.
#[derive(Debug)]
pub(super) struct Background;

impl Effect for Background {
    fn name(&self) -> &'static str {
        "background"
    }

    fn is_requested(&self, _: &Gaussians, request: &Request) -> bool {
        request.options.background.iter().any(|channel| *channel != 0.0)
    }

    fn remove_from(&self, request: &mut Request) {
        request.options.background = [0.0; 3];
    }

    fn assess(&self, _: &Scene<'_>, request: &Request, budget: f64) -> Assessment {
        let brightest = request.options.background.iter().map(|channel| channel.abs()).fold(0.0, f64::maximum_of);
        let bound = brightest * request.gain();
        if bound <= budget {
            Assessment::remove(self, request, bound, format!("an empty pixel shows no more than {bound:.1e} of it"))
        } else {
            Assessment::keep(format!("an empty pixel shows {bound:.2} of it"))
        }
    }
}
