use std::sync::Arc;

use super::{Assessment, Effect, EffectPlan, Request, Scene, amplitude};
use crate::{Gaussians, LARGEST_CHANNEL, PackedHarmonics};

/// Spherical harmonics above degree 0: view-dependent colour.
///
/// Decided for each Gaussian, once for all views: which bands it needs, see [`PackedHarmonics`].
#[derive(Debug)]
pub(super) struct ViewDependence;

/// Share of the remaining tolerance: the rest is for what follows.
const SHARE: f64 = 0.5;

impl Effect for ViewDependence {
    fn name(&self) -> &'static str {
        "view-dependence"
    }

    fn is_requested(&self, gaussians: &Gaussians, request: &Request) -> bool {
        request.degree(gaussians) > 0
    }

    fn remove_from(&self, request: &mut Request) {
        request.options.max_sh_degree = 0;
        request.options.harmonics = None;
    }

    fn assess(&self, scene: &Scene<'_>, request: &Request, budget: f64) -> Assessment {
        let degree = request.degree(scene.gaussians());
        let gain = request.gain();
        if !(budget < EffectPlan::UNLIMITED) {
            return of_removal(self, scene, request, degree);
        }
        if scene.views() < Scene::MIN_VIEWS {
            let few = scene.views();
            return Assessment::keep(format!(
                "for {few} views, finding the visible bands would take longer than skipping the others saves"
            ));
        }
        match scene.harmonics(degree, before_exposure(SHARE * budget, gain)) {
            Some(packed) => packed_into(request, packed, gain),
            None => Assessment::keep(format!("bands up to degree {degree} are visible in nearly every Gaussian")),
        }
    }
}

/// The change of composited colour that exposure makes a change of at most `budget`. Larger ones than any colour has count
/// as equal: an exposure to black makes nothing of all of them.
fn before_exposure(budget: f64, gain: f64) -> f64 {
    let change = budget / gain;
    if change < LARGEST_CHANNEL { change } else { LARGEST_CHANNEL }
}

fn packed_into(request: &Request, packed: Arc<PackedHarmonics>, gain: f64) -> Assessment {
    let bound = packed.bound() * gain;
    let all = packed.len() as f64;
    let shares = (0u8..).zip(packed.kept()).filter(|(_, count)| *count > 0);
    let shares: Vec<String> =
        shares.map(|(degree, count)| format!("{:.0} % to degree {degree}", 100.0 * count as f64 / all)).collect();
    let mut reduced = request.clone();
    reduced.options.max_sh_degree = packed.degree();
    reduced.options.harmonics = Some(packed);
    let reason = format!("of the Gaussians, {} show: no colour changes by more than {bound:.1e}", shares.join(", "));
    Assessment { reduced: Some(reduced), bound: Some(bound), reason }
}

/// All of it, whatever that changes.
fn of_removal(effect: &dyn Effect, scene: &Scene<'_>, request: &Request, degree: u8) -> Assessment {
    let [_, change, ..] = amplitude::band_bounds(scene.gaussians(), degree);
    let change = change * request.gain();
    if change.is_finite() {
        Assessment::remove(
            effect,
            request,
            change,
            format!("no colour changes by more than {change:.1e} above degree 0"),
        )
    } else {
        Assessment::keep(format!("a coefficient up to degree {degree} is not finite or too large to be drawn"))
    }
}
