use atsplat_camera::Sphere;
use atsplat_splat::Gaussians;
use glam::{DMat3, DQuat, DVec3};

/// Gaussians less opaque than this count for nothing where a scene is framed.
const VISIBLE_LOGIT: f32 = -2.0;
/// Standard deviations to which a Gaussian is taken to reach.
const SIGMAS: f64 = 2.0;
/// Share of the scene that is framed; the rest are floaters and far background.
const SHARE: f64 = 0.98;
/// Air around it.
const MARGIN: f64 = 1.1;

/// A sphere around the bulk of what is visible; `None` where nothing is.
pub(crate) fn bulk(gaussians: &Gaussians) -> Option<Sphere> {
    let parts = gaussians.parts();
    let shapes = parts.quaternions.iter().zip(&parts.log_scales).zip(&parts.opacity_logits);
    let visible = parts.means.iter().zip(shapes).filter(|(_, (_, logit))| **logit > VISIBLE_LOGIT);
    let ends = visible.flat_map(|(mean, ((quaternion, log_scales), _))| {
        let mean = DVec3::from_array(mean.map(f64::from));
        let [w, x, y, z] = quaternion.map(f64::from);
        let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let scales = DVec3::from_array(log_scales.map(|log| SIGMAS * f64::from(log).exp()));
        let half = [axes.x_axis * scales.x, axes.y_axis * scales.y, axes.z_axis * scales.z];
        half.into_iter().flat_map(move |half| [mean + half, mean - half])
    });
    let sphere = Sphere::around_bulk(ends, SHARE).filter(|sphere| sphere.radius > 0.0)?;
    Some(Sphere { radius: MARGIN * sphere.radius, ..sphere })
}
