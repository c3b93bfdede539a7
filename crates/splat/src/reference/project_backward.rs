use atsplat_camera::Lens;
use glam::{DMat2, DMat3, DVec2, DVec3};

use super::composite_backward::SplatGradient;
use super::project::{Intermediates, Shape, Splat};
use crate::constants::{ClampedGradient, ShAxes};
use crate::view::Optics;
use crate::{Gaussians, RasterMode, RenderOptions, sh, sh_coefficients};

/// Gradient of the loss with respect to one Gaussian, and its contribution to that of the camera pose.
pub(crate) struct GaussianGradient {
    pub(crate) mean: DVec3,
    pub(crate) quaternion: [f64; 4],
    pub(crate) log_scales: DVec3,
    pub(crate) logit: f64,
    /// Up to the evaluated degree; zero above.
    pub(crate) sh: [[f64; 3]; 25],
    /// Rotation, then translation.
    pub(crate) pose: [DVec3; 2],
}

/// Propagates a splat's gradient to its Gaussian and the camera.
pub(crate) fn gaussian_gradient(
    gaussians: &Gaussians,
    optics: &Optics,
    options: &RenderOptions,
    splat: &Splat,
    d_splat: &SplatGradient,
) -> GaussianGradient {
    let parts = &splat.parts;
    let mut acc = Accumulated::ZERO;
    through_opacity(options, splat, d_splat, &mut acc);
    let d_jacobian = through_covariance(optics, splat, d_splat, &mut acc);
    through_projection(optics, options, parts, d_splat, d_jacobian, &mut acc);
    let (d_mean, sh) = through_colour(gaussians, options, splat, d_splat);

    let stored = gaussians.parts().quaternions[splat.position].map(f64::from);
    // With a filter f, the effective scale √(s² + f²) has the derivative s²/√(s² + f²) with respect to log s.
    let Shape { scales, unfiltered_share, .. } = parts.shape;
    let log_scales = acc.log_scales + acc.scales * scales * unfiltered_share;
    // The view direction runs from the camera centre, −Rᵀt, to the mean.
    let d_rotation = parts.in_camera.cross(acc.in_camera) + axial(acc.view_rotation * optics.rotation.transpose());
    GaussianGradient {
        mean: d_mean + optics.rotation.transpose() * acc.in_camera,
        quaternion: d_quaternion(stored, &acc.rotation),
        log_scales,
        logit: acc.logit,
        sh,
        pose: [d_rotation, acc.in_camera + optics.rotation * d_mean],
    }
}

/// Gradients of one Gaussian's intermediate values, accumulated step by step.
struct Accumulated {
    in_camera: DVec3,
    view_rotation: DMat3,
    rotation: DMat3,
    scales: DVec3,
    log_scales: DVec3,
    logit: f64,
    cov2d: DMat2,
}

impl Accumulated {
    // glam's default matrix is the identity.
    const ZERO: Self = Self {
        in_camera: DVec3::ZERO,
        view_rotation: DMat3::ZERO,
        rotation: DMat3::ZERO,
        scales: DVec3::ZERO,
        log_scales: DVec3::ZERO,
        logit: 0.0,
        cov2d: DMat2::ZERO,
    };
}

/// `opacity = sigmoid · filter · compensation`.
fn through_opacity(options: &RenderOptions, splat: &Splat, d_splat: &SplatGradient, acc: &mut Accumulated) {
    let Intermediates { shape, covariance, compensation, .. } = splat.parts;
    acc.logit = d_splat.opacity * shape.filter * compensation * shape.sigmoid * shape.one_minus_sigmoid;
    // filter² = Π s²/(s² + f²), whose logarithm has the derivative 2(1 − ratio) with respect to each log s.
    let d_log_filter = d_splat.opacity * splat.opacity;
    acc.log_scales = d_log_filter * (DVec3::ONE - shape.unfiltered_share);
    if options.mode == RasterMode::Antialiased && compensation > options.constants.min_compensation {
        // ½ √(det/det') (Σ⁻¹ − Σ'⁻¹), written so that Σ need not be invertible.
        let d_compensation = d_splat.opacity * shape.sigmoid * shape.filter;
        let [inner, outer] = covariance.determinants;
        let (plain, blurred) = (adjugate(covariance.plain), adjugate(covariance.blurred));
        let ratio = plain * outer.recip() - blurred * (inner / (outer * outer));
        acc.cov2d = ratio * (0.5 * d_compensation / compensation);
    }
}

/// From the exponent to 2D covariance, then to rotation, scales and view rotation; returns the gradient of the Jacobian's
/// rows.
fn through_covariance(optics: &Optics, splat: &Splat, d_splat: &SplatGradient, acc: &mut Accumulated) -> [DVec3; 2] {
    let Intermediates { shape, near_mean, .. } = splat.parts;
    let (whitener, moments) = (splat.whitener, d_splat.moments);
    // The exponent is half the square of L d; its gradient with respect to the covariance is −½ Lᵀ (L d)(L d)ᵀ L.
    let whitener = DMat2::from_cols(DVec2::new(whitener.x, 0.0), DVec2::new(whitener.y, whitener.z));
    let moments = DMat2::from_cols(DVec2::new(moments.x, moments.y), DVec2::new(moments.y, moments.z));
    let d_covariance = acc.cov2d - whitener.transpose() * moments * whitener * 0.5;

    // cov2d = V Vᵀ with V = J W R S.
    let axes = shape.rotation * DMat3::from_diagonal(shape.scales);
    let world = near_mean.jacobian.map(|row| optics.rotation.transpose() * row);
    let screen = world.map(|row| axes.transpose() * row);
    let d_screen = [
        2.0 * (d_covariance.x_axis.x * screen[0] + d_covariance.x_axis.y * screen[1]),
        2.0 * (d_covariance.x_axis.y * screen[0] + d_covariance.y_axis.y * screen[1]),
    ];
    // Rows: screen = axesᵀ · world, so d_axes = world ⊗ d_screen.
    let d_axes = outer(world[0], d_screen[0]) + outer(world[1], d_screen[1]);
    acc.rotation = d_axes * DMat3::from_diagonal(shape.scales);
    let columns = |m: &DMat3| [m.x_axis, m.y_axis, m.z_axis];
    let of_scale: Vec<f64> =
        columns(&shape.rotation).iter().zip(columns(&d_axes)).map(|(axis, gradient)| axis.dot(gradient)).collect();
    acc.scales = DVec3::from_slice(&of_scale);

    let d_world = d_screen.map(|row| axes * row);
    acc.view_rotation = outer(near_mean.jacobian[0], d_world[0]) + outer(near_mean.jacobian[1], d_world[1]);
    d_world.map(|row| optics.rotation * row)
}

/// From projected centre, depth and Jacobian to the mean in camera coordinates.
fn through_projection(
    optics: &Optics,
    options: &RenderOptions,
    parts: &Intermediates,
    d_splat: &SplatGradient,
    d_jacobian: [DVec3; 2],
    acc: &mut Accumulated,
) {
    let Intermediates { in_camera, near_mean, .. } = *parts;
    let depth = in_camera.z;
    acc.in_camera.z += d_splat.depth;

    let true_slope = in_camera.truncate() / depth;
    let lens_jacobian = match &optics.lens {
        None => DMat2::from_diagonal(optics.focal),
        // A drawn Gaussian is inside the lens, except for the last bit of a fisheye's largest angle.
        Some(lens) => DMat2::from_diagonal(optics.focal) * lens.jacobian(true_slope).unwrap_or(DMat2::ZERO),
    };
    let d_true_slope = lens_jacobian.transpose() * d_splat.centre;
    acc.in_camera += (d_true_slope / depth).extend(-d_true_slope.dot(true_slope) / depth);

    // J = A/z · [1 | −slope]
    let [first, second] = d_jacobian;
    let along = first.dot(near_mean.jacobian[0]) + second.dot(near_mean.jacobian[1]);
    acc.in_camera.z -= along / depth;
    let d_last = DVec2::new(first.z, second.z);
    let mut d_slope = -(near_mean.pixel_from_slope.transpose() * d_last) / depth;
    if let Some(lens) = &optics.lens {
        let rows = [first, second].map(|row| (row.truncate() - near_mean.slope * row.z) / depth);
        d_slope += through_lens(lens, near_mean.slope, optics.focal, rows);
    }
    let pairs = [
        (near_mean.clamped[0], d_slope.x, true_slope.x, near_mean.slope.x),
        (near_mean.clamped[1], d_slope.y, true_slope.y, near_mean.slope.y),
    ];
    for (axis, (clamped, d_slope, true_slope, slope)) in pairs.into_iter().enumerate() {
        if !clamped {
            acc.in_camera[axis] += d_slope / depth;
            acc.in_camera.z -= d_slope * true_slope / depth;
        } else if options.constants.clamped_gradient == ClampedGradient::Inria {
            acc.in_camera.z -= d_slope * slope / depth;
        }
    }
}

/// Gradient of the slope through the lens's Jacobian, by central differences: the lens's second derivatives have no
/// closed form here, and in f64 the differences are accurate to 1e-9. One-sided at the limit of the lens's field of
/// view.
pub(crate) fn through_lens(lens: &Lens, slope: DVec2, focal: DVec2, d_rows: [DVec2; 2]) -> DVec2 {
    const STEP: f64 = 1e-5;
    let along = |unit: DVec2| {
        let at = |step: f64| lens.jacobian(slope + unit * step).ok().map(|jacobian| (step, jacobian));
        let (Some((to, ahead)), Some((from, behind))) = (at(STEP).or_else(|| at(0.0)), at(-STEP).or_else(|| at(0.0)))
        else {
            return 0.0;
        };
        if to <= from {
            return 0.0;
        }
        let change = DMat2::from_diagonal(focal) * (ahead - behind) * (to - from).recip();
        let rows = change.transpose();
        rows.x_axis.dot(d_rows[0]) + rows.y_axis.dot(d_rows[1])
    };
    DVec2::new(along(DVec2::X), along(DVec2::Y))
}

/// From colour to spherical harmonics; returns the gradient of the mean through the view direction, and of the
/// coefficients.
fn through_colour(
    gaussians: &Gaussians,
    options: &RenderOptions,
    splat: &Splat,
    d_splat: &SplatGradient,
) -> (DVec3, [[f64; 3]; 25]) {
    let parts = gaussians.parts();
    let (intermediates, stored) = (&splat.parts, sh_coefficients(parts.sh_degree));
    let degree = options.sh_degree(parts.sh_degree);
    let through = |raw: f64, gradient: f64| if raw < 0.0 { 0.0 } else { gradient };
    let d_rgb = DVec3::new(
        through(intermediates.raw_rgb.x, d_splat.rgb.x),
        through(intermediates.raw_rgb.y, d_splat.rgb.y),
        through(intermediates.raw_rgb.z, d_splat.rgb.z),
    );
    let from = splat.position * stored;
    let used = from..from + sh_coefficients(degree);
    let basis = sh::basis(degree, intermediates.direction.to_array());
    let d_sh = basis.map(|value| (d_rgb * value).to_array());
    if options.gradients.directions_stop || intermediates.distance <= 0.0 {
        return (DVec3::ZERO, d_sh);
    }
    let slopes = sh::basis_gradient(degree, intermediates.direction.to_array());
    let d_direction = parts.sh[used].iter().zip(slopes).fold(DVec3::ZERO, |sum, (coefficient, slope)| {
        sum + DVec3::from_array(slope) * DVec3::from_array(coefficient.map(f64::from)).dot(d_rgb)
    });
    let tangential =
        (d_direction - intermediates.direction * intermediates.direction.dot(d_direction)) / intermediates.distance;
    let d_mean = match options.constants.sh_axes {
        ShAxes::Standard => tangential,
        ShAxes::E3nn => DVec3::new(tangential.y, tangential.z, tangential.x),
    };
    (d_mean, d_sh)
}

/// Gradient of an unnormalised quaternion `w, x, y, z` from that of its rotation matrix.
fn d_quaternion(stored: [f64; 4], d_rotation: &DMat3) -> [f64; 4] {
    let norm = stored.iter().map(|value| value * value).sum::<f64>().sqrt();
    let [w, x, y, z] = stored.map(|value| value / norm);
    let g = d_rotation.transpose().to_cols_array_2d();
    let unit = [
        2.0 * (x * (g[2][1] - g[1][2]) + y * (g[0][2] - g[2][0]) + z * (g[1][0] - g[0][1])),
        2.0 * (-2.0 * x * (g[1][1] + g[2][2])
            + y * (g[0][1] + g[1][0])
            + z * (g[0][2] + g[2][0])
            + w * (g[2][1] - g[1][2])),
        2.0 * (x * (g[0][1] + g[1][0]) - 2.0 * y * (g[0][0] + g[2][2])
            + z * (g[1][2] + g[2][1])
            + w * (g[0][2] - g[2][0])),
        2.0 * (x * (g[0][2] + g[2][0]) + y * (g[1][2] + g[2][1]) - 2.0 * z * (g[0][0] + g[1][1])
            + w * (g[1][0] - g[0][1])),
    ];
    let radial: f64 = unit.iter().zip([w, x, y, z]).map(|(gradient, value)| gradient * value).sum();
    let mut tangential = [0.0; 4];
    for ((slot, gradient), value) in tangential.iter_mut().zip(unit).zip([w, x, y, z]) {
        *slot = (gradient - radial * value) / norm;
    }
    tangential
}

fn adjugate(m: DMat2) -> DMat2 {
    DMat2::from_cols(DVec2::new(m.y_axis.y, -m.x_axis.y), DVec2::new(-m.y_axis.x, m.x_axis.x))
}

/// `column · rowᵀ`.
fn outer(column: DVec3, row: DVec3) -> DMat3 {
    DMat3::from_cols(column * row.x, column * row.y, column * row.z)
}

/// The vector `a` of which `Σ m ∘ [ω]ₓ = ω · a`.
fn axial(m: DMat3) -> DVec3 {
    DVec3::new(m.y_axis.z - m.z_axis.y, m.z_axis.x - m.x_axis.z, m.x_axis.y - m.y_axis.x)
}
