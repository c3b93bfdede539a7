use atsplat_camera::{Distortion, Lens};
use atsplat_numeric::Extremes as _;
use glam::DVec2;

use super::{Effect, Judgement, Request, geometry};
use crate::{Gaussians, View};

/// A lens that bends straight lines.
#[derive(Debug)]
pub(super) struct LensEffect;

impl Effect for LensEffect {
    fn name(&self) -> &'static str {
        "lens"
    }

    fn is_asked_for(&self, _: &Gaussians, request: &Request) -> bool {
        request.view.camera.distortion != Distortion::None
    }

    fn leave_out(&self, request: &mut Request) {
        request.view.camera.distortion = Distortion::None;
    }

    fn judge(&self, gaussians: &Gaussians, request: &Request, _: f64) -> Judgement {
        let straight = Distortion::OpenCv { k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
        if request.view.camera.distortion == straight {
            return Judgement::leaves_out(self, request, 0.0, "its coefficients are zero");
        }
        let Ok(lens) = request.view.camera.distortion.lens() else {
            return Judgement::runs("it cannot be used, which rendering tells");
        };
        let moved = farthest_move(&lens, &request.view);
        if moved != 0.0 {
            return Judgement::runs(format!("it moves the picture's border by {moved:.2e} pixels"));
        }
        let mut reduced = request.clone();
        self.leave_out(&mut reduced);
        match geometry::objection(gaussians, request, &reduced) {
            None => Judgement::leaves_out(self, request, 0.0, "it moves no Gaussian that is drawn"),
            Some(objection) => Judgement::runs(objection),
        }
    }
}

/// How far corners and edges' middles move, in pixels; infinite where the lens does not see them.
fn farthest_move(lens: &Lens, view: &View) -> f64 {
    let size = DVec2::new(f64::from(view.size.width), f64::from(view.size.height));
    let k = view.camera.intrinsics.pixel_from_normalized(view.size);
    let (focal, principal) = (DVec2::new(k.fx, k.fy), DVec2::new(k.cx, k.cy));
    let places = [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (0.0, 0.5), (1.0, 0.5), (0.0, 1.0), (0.5, 1.0), (1.0, 1.0)];
    let moves = places.map(|(x, y)| {
        let slope = (DVec2::new(x, y) * size - principal) / focal;
        lens.distorted_from_undistorted(slope).map_or(f64::INFINITY, |bent| ((bent - slope) * focal).length())
    });
    moves.into_iter().fold(0.0, f64::maximum_of)
}
