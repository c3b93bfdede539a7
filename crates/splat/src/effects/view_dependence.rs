use super::{Assessment, Effect, Request, amplitude};
use crate::Gaussians;

/// Spherical harmonics above degree 0: view-dependent colour.
///
/// Compositing weights sum to at most 1, so no pixel changes by more than the colour of some Gaussian.
#[derive(Debug)]
pub(super) struct ViewDependence;

impl Effect for ViewDependence {
    fn name(&self) -> &'static str {
        "view-dependence"
    }

    fn is_requested(&self, gaussians: &Gaussians, request: &Request) -> bool {
        amplitude::degree(gaussians, request.options.max_sh_degree) > 0
    }

    fn remove_from(&self, request: &mut Request) {
        request.options.max_sh_degree = 0;
    }

    fn assess(&self, gaussians: &Gaussians, request: &Request, budget: f64) -> Assessment {
        let degree = amplitude::degree(gaussians, request.options.max_sh_degree);
        if amplitude::is_flat(gaussians, degree) {
            return Assessment::remove(self, request, 0.0, "every coefficient above degree 0 is zero");
        }
        let gain = request.gain();
        let last_band = |above: &amplitude::Above| above[usize::from(degree)] * gain;
        let above = amplitude::above(gaussians, degree, |above| !(last_band(above) <= budget));
        let kept = (0..degree).find_map(|kept| {
            let change = above.get(usize::from(kept) + 1)? * gain;
            (change <= budget).then_some((kept, change))
        });
        let Some((kept, change)) = kept else {
            let change = last_band(&above);
            return Assessment::keep(if change.is_finite() {
                format!("degree {degree} alone may change a colour by {change:.2}")
            } else {
                format!("a coefficient up to degree {degree} is not finite or too large to be drawn")
            });
        };
        let mut reduced = request.clone();
        reduced.options.max_sh_degree = kept;
        let reason = format!("no colour changes by more than {change:.1e} above degree {kept}");
        Assessment { reduced: Some(reduced), bound: Some(change), reason }
    }
}
