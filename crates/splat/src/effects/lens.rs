use atsplat_camera::{Distortion, Lens};
use atsplat_numeric::Extremes as _;
use glam::DVec2;

use super::{Assessment, Effect, Request, Scene, geometry};
use crate::{Gaussians, View};

/// Lens distortion.
#[derive(Debug)]
pub(super) struct LensEffect;

impl Effect for LensEffect {
    fn name(&self) -> &'static str {
        "lens"
    }

    fn is_requested(&self, _: &Gaussians, request: &Request) -> bool {
        request.view.camera.distortion != Distortion::None
    }

    fn remove_from(&self, request: &mut Request) {
        request.view.camera.distortion = Distortion::None;
    }

    fn assess(&self, scene: &Scene<'_>, request: &Request, _: f64) -> Assessment {
        let zero_distortion = Distortion::OpenCv { k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
        if request.view.camera.distortion == zero_distortion {
            return Assessment::remove(self, request, 0.0, "its coefficients are zero");
        }
        let Ok(lens) = request.view.camera.distortion.lens() else {
            return Assessment::keep("the lens is invalid; rendering will report why");
        };
        let moved = farthest_move(&lens, &request.view);
        if moved != 0.0 {
            return Assessment::keep(format!("it moves the image border by {moved:.2e} pixels"));
        }
        geometry::remove_if_unused(self, scene.gaussians(), request, "it moves no Gaussian that is drawn")
    }
}

/// Largest displacement of the image corners and edge midpoints, in pixels; infinite if the lens cannot map one.
fn farthest_move(lens: &Lens, view: &View) -> f64 {
    let size = DVec2::new(f64::from(view.size.width), f64::from(view.size.height));
    let k = view.camera.intrinsics.pixel_from_normalized(view.size);
    let (focal, principal) = (DVec2::new(k.fx, k.fy), DVec2::new(k.cx, k.cy));
    let border_points =
        [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (0.0, 0.5), (1.0, 0.5), (0.0, 1.0), (0.5, 1.0), (1.0, 1.0)];
    let displacements = border_points.map(|(x, y)| {
        let slope = (DVec2::new(x, y) * size - principal) / focal;
        lens.distorted_from_undistorted(slope).map_or(f64::INFINITY, |distorted| ((distorted - slope) * focal).length())
    });
    displacements.into_iter().fold(0.0, f64::maximum_of)
}
