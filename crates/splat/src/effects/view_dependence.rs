use super::{Effect, Judgement, Request, amplitude};
use crate::Gaussians;

/// Spherical harmonics above degree 0: colour that depends on the side a Gaussian is seen from.
///
/// Weights of compositing sum to at most 1, so no pixel changes by more than the colour of some Gaussian does.
#[derive(Debug)]
pub(super) struct ViewDependence;

impl Effect for ViewDependence {
    fn name(&self) -> &'static str {
        "view-dependence"
    }

    fn is_asked_for(&self, gaussians: &Gaussians, request: &Request) -> bool {
        amplitude::degree(gaussians, request.options.max_sh_degree) > 0
    }

    fn leave_out(&self, request: &mut Request) {
        request.options.max_sh_degree = 0;
    }

    fn judge(&self, gaussians: &Gaussians, request: &Request, budget: f64) -> Judgement {
        let degree = amplitude::degree(gaussians, request.options.max_sh_degree);
        let gain = request.gain();
        let last = usize::from(degree);
        let above = amplitude::above(gaussians, degree, |above| {
            above.get(last).is_some_and(|change| !(change * gain <= budget))
        });
        let kept = (0..degree).find_map(|kept| {
            let change = above.get(usize::from(kept) + 1)? * gain;
            (change <= budget).then_some((kept, change))
        });
        let Some((kept, change)) = kept else {
            let change = above.get(last).copied().unwrap_or_default() * gain;
            return Judgement::runs(if change.is_finite() {
                format!("degree {degree} alone may change a colour by {change:.2}")
            } else {
                format!("a coefficient up to degree {degree} is not finite or too large to be drawn")
            });
        };
        let mut reduced = request.clone();
        reduced.options.max_sh_degree = kept;
        let reason = format!("no colour changes by more than {change:.1e} above degree {kept}");
        Judgement { reduced: Some(reduced), bound: Some(change), reason }
    }
}
