//! The part of a scene that an overview shows.

use atsplat_camera::Sphere;
use atsplat_numeric::{logit, sigmoid};
use glam::{DMat3, DQuat, DVec3};

use crate::{Gaussians, LOG_SCALE_LIMIT};

/// Gaussians with a smaller opacity are drawn nowhere, with the constants of published rasterizers.
const MIN_OPACITY: f64 = 1.0 / 255.0;
/// Gaussians with a smaller opacity logit are ignored, if the others have most of the opacity.
const VISIBLE_LOGIT: f32 = -2.0;
/// Extent of a Gaussian in standard deviations.
const SIGMAS: f64 = 2.0;
/// Share of the scene inside the frame; the rest are floaters and far background.
const SHARE: f64 = 0.98;
/// Factor on the radius.
const MARGIN: f64 = 1.1;

/// A sphere in scene units around the bulk of the visible Gaussians; `None` if no opacity is at least 1/255.
///
/// Faint Gaussians are left out of a scene whose opaque ones have at least half of the opacity that is drawn.
pub fn visible_bulk(gaussians: &Gaussians) -> Option<Sphere> {
    let parts = gaussians.parts();
    let least = least_logit(gaussians);
    let shapes = parts.quaternions.iter().zip(&parts.log_scales).zip(&parts.opacity_logits);
    let visible = parts
        .means
        .iter()
        .zip(shapes)
        .filter(|(_, ((_, log_scales), logit))| **logit >= least && can_be_drawn(log_scales));
    let ends = visible.flat_map(|(mean, ((quaternion, log_scales), _))| axis_ends(mean, quaternion, log_scales));
    let sphere = Sphere::around_bulk(ends, SHARE).filter(|sphere| sphere.radius > 0.0)?;
    Some(Sphere { radius: MARGIN * sphere.radius, ..sphere })
}

/// Both ends of a Gaussian's axes, x, y and z, each [`SIGMAS`] standard deviations from its mean.
fn axis_ends(mean: &[f32; 3], wxyz: &[f32; 4], log_scales: &[f32; 3]) -> [DVec3; 6] {
    let (mean, axes) = (DVec3::from_array(mean.map(f64::from)), rotation(wxyz));
    let [x, y, z] = log_scales.map(|log| SIGMAS * f64::from(log).exp());
    let [x, y, z] = [axes.x_axis * x, axes.y_axis * y, axes.z_axis * z];
    [mean + x, mean - x, mean + y, mean - y, mean + z, mean - z]
}

/// The rotation of a Gaussian, by its quaternion of any length but 0.
fn rotation(wxyz: &[f32; 4]) -> DMat3 {
    let [w, x, y, z] = wxyz.map(f64::from);
    DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize())
}

/// The smallest opacity logit of the Gaussians that are framed.
fn least_logit(gaussians: &Gaussians) -> f32 {
    let parts = gaussians.parts();
    let drawn_at_all = logit(MIN_OPACITY);
    let (mut all, mut visible) = (0.0, 0.0);
    for (log_scales, logit) in parts.log_scales.iter().zip(&parts.opacity_logits) {
        if *logit >= drawn_at_all && can_be_drawn(log_scales) {
            let opacity = sigmoid(*logit);
            all += opacity;
            visible += if *logit >= VISIBLE_LOGIT { opacity } else { 0.0 };
        }
    }
    if visible >= 0.5 * all { VISIBLE_LOGIT } else { drawn_at_all }
}

/// Renderers cull wider ones as invalid.
fn can_be_drawn(log_scales: &[f32; 3]) -> bool {
    log_scales.iter().all(|log| *log <= LOG_SCALE_LIMIT)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GaussianParts;
    use atsplat_numeric::Tolerance;

    /// Gaussians on a grid, and far away others that are invisible.
    fn scene(logit: f32) -> Gaussians {
        let mut means: Vec<[f32; 3]> = (0..125u8).map(|i| [i % 5, i / 5 % 5, i / 25].map(f32::from)).collect();
        let mut opacity_logits = vec![logit; means.len()];
        means.extend([[1e6, 0.0, 0.0]; 50]);
        opacity_logits.extend([-6.0; 50]);
        let count = means.len();
        Gaussians::new(GaussianParts {
            means,
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]; count],
            log_scales: vec![[-3.0; 3]; count],
            opacity_logits,
            sh: vec![[0.0; 3]; count],
            ..GaussianParts::default()
        })
        .unwrap()
    }

    /// Of the grid's 750 ends of axes, the 98 % within the radius leave out 15 of the 24 that point outwards at the corners.
    fn assert_frames_the_grid(sphere: &Sphere) {
        let outwards = 2.0 + SIGMAS * (-3.0f64).exp();
        let expected = [2.0, 2.0, 2.0, MARGIN * (outwards * outwards + 8.0).sqrt()];
        let found = sphere.centre.to_array().into_iter().chain([sphere.radius]);
        Tolerance::relative(1e-9).assert(found, expected, "centre and radius");
    }

    #[test]
    fn invisible_gaussians_are_not_framed() {
        let sphere = visible_bulk(&scene(1.0)).unwrap();
        assert_frames_the_grid(&sphere);
        assert_eq!(visible_bulk(&scene(-6.0)), None);
        assert_eq!(visible_bulk(&Gaussians::default()), None);
    }

    /// As at the start of an optimisation: logits of −2.1 are drawn too.
    #[test]
    fn a_faint_scene_is_framed() {
        let sphere = visible_bulk(&scene(-2.1)).unwrap();
        assert_frames_the_grid(&sphere);
        // 1/255 is a logit of −5.54.
        assert!(visible_bulk(&scene(-5.5)).is_some());
        assert_eq!(visible_bulk(&scene(-5.6)), None);
    }

    /// One opaque Gaussian in a faint grid is no scene; twenty of 125 are, because they have more opacity than the others.
    #[test]
    fn the_opaque_part_is_framed_only_if_it_has_most_of_the_opacity() {
        let radius = |opaque: usize| {
            let mut parts = scene(-3.0).into_parts();
            for (mean, logit) in parts.means.iter_mut().zip(&mut parts.opacity_logits).take(opaque) {
                (*mean, *logit) = ([4.0, 0.0, 4.0], 5.0);
            }
            visible_bulk(&Gaussians::new(parts).unwrap()).unwrap().radius
        };
        assert!(radius(1) > 2.0, "{}", radius(1));
        assert!(radius(20) < 0.5, "{}", radius(20));
    }

    #[test]
    fn gaussians_that_are_never_drawn_are_not_framed() {
        let mut parts = scene(1.0).into_parts();
        parts.log_scales[..20].fill([-3.0, LOG_SCALE_LIMIT + 1.0, -3.0]);
        let sphere = visible_bulk(&Gaussians::new(parts).unwrap()).unwrap();
        assert!(sphere.radius < 4.0, "{sphere:?}");
    }

    /// Turned by 53.13° about z (cosine 3⁄5), then by 36.87° about x (cosine 4⁄5): the product of the quaternions 3 + i and 2 + k.
    #[test]
    fn axes_are_scaled_then_turned() {
        let standard_deviations = [1.0f32, 0.5, 0.25];
        let found = axis_ends(&[10.0, 20.0, 30.0], &[6.0, 2.0, -1.0, 3.0], &standard_deviations.map(f32::ln));
        let expected = [
            [11.2, 21.28, 30.96],
            [8.8, 18.72, 29.04],
            [9.2, 20.48, 30.36],
            [10.8, 19.52, 29.64],
            [10.0, 19.7, 30.4],
            [10.0, 20.3, 29.6],
        ];
        let found = found.map(|end| end.to_array());
        Tolerance::absolute(1e-6).assert(found.into_iter().flatten(), expected.into_iter().flatten(), "ends");
    }

    /// A single Gaussian has the extent of its ellipsoid.
    #[test]
    fn one_gaussian_is_framed_by_its_extent() {
        let one = scene(1.0).select(&[0]).unwrap();
        let sphere = visible_bulk(&one).unwrap();
        let reach = MARGIN * SIGMAS * (-3.0f64).exp();
        Tolerance::relative(1e-6).assert([sphere.radius], [reach], "two standard deviations and the margin");
    }
}
