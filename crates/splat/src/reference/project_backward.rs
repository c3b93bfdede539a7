use atsplat_camera::Lens;
use glam::{DMat2, DMat3, DVec2, DVec3};

use super::backward::SplatGradient;
use super::project::{Parts, Splat};
use crate::constants::{ClampedGradient, ShAxes};
use crate::view::Optics;
use crate::{Gaussians, RasterMode, RenderOptions, sh, sh_coefficients};

/// Derivatives by everything that one Gaussian is made of, and its share of those by the camera's pose.
pub(crate) struct GaussianGradient {
    pub(crate) mean: DVec3,
    pub(crate) quaternion: [f64; 4],
    pub(crate) log_scales: DVec3,
    pub(crate) logit: f64,
    /// Of the degree that was evaluated; the rest is zero.
    pub(crate) sh: [[f64; 3]; 25],
    /// Rotation, then translation.
    pub(crate) pose: [DVec3; 2],
}

/// Carries a splat's derivatives back to its Gaussian and the camera.
pub(crate) fn of_gaussian(
    gaussians: &Gaussians,
    optics: &Optics,
    options: &RenderOptions,
    splat: &Splat,
    of_splat: &SplatGradient,
) -> GaussianGradient {
    let parts = &splat.parts;
    let mut own = Own::ZERO;
    through_opacity(options, splat, of_splat, &mut own);
    let by_jacobian = through_covariance(optics, splat, of_splat, &mut own);
    through_projection(optics, options, parts, of_splat, by_jacobian, &mut own);
    let (by_mean, sh) = through_colour(gaussians, options, splat, of_splat);

    let stored = gaussians.parts().quaternions.get(splat.position).copied().unwrap_or_default().map(f64::from);
    // With a filter f, the scale drawn is √(s² + f²), which grows with log s by s²/√(s² + f²).
    let log_scales = own.log_scales + own.scales * parts.scales * parts.own_share;
    // The colour's direction runs from the camera's centre, −Rᵀt, to the mean.
    let by_rotation = parts.in_camera.cross(own.in_camera) + axial(own.view_rotation * optics.rotation.transpose());
    GaussianGradient {
        mean: by_mean + optics.rotation.transpose() * own.in_camera,
        quaternion: by_quaternion(stored, &own.rotation),
        log_scales,
        logit: own.logit,
        sh,
        pose: [by_rotation, own.in_camera + optics.rotation * by_mean],
    }
}

/// Derivatives by one Gaussian's parts, as they are gathered.
struct Own {
    in_camera: DVec3,
    view_rotation: DMat3,
    rotation: DMat3,
    scales: DVec3,
    log_scales: DVec3,
    logit: f64,
    sharp: DMat2,
}

impl Own {
    // glam's default matrix is the identity.
    const ZERO: Self = Self {
        in_camera: DVec3::ZERO,
        view_rotation: DMat3::ZERO,
        rotation: DMat3::ZERO,
        scales: DVec3::ZERO,
        log_scales: DVec3::ZERO,
        logit: 0.0,
        sharp: DMat2::ZERO,
    };
}

/// `opacity = sigmoid · filter · compensation`.
fn through_opacity(options: &RenderOptions, splat: &Splat, of_splat: &SplatGradient, own: &mut Own) {
    let parts = &splat.parts;
    own.logit = of_splat.opacity * parts.filter * parts.compensation * parts.sigmoid * parts.rest;
    // filter² = Π s²/(s² + f²), whose logarithm grows by 2(1 − share) with each log s.
    let by_log_filter = of_splat.opacity * splat.opacity;
    own.log_scales = by_log_filter * (DVec3::ONE - parts.own_share);
    if options.mode == RasterMode::Antialiased && parts.compensation > options.constants.min_compensation {
        // ½ √(det/det') (Σ⁻¹ − Σ'⁻¹), written so that Σ need not be invertible.
        let by_compensation = of_splat.opacity * parts.sigmoid * parts.filter;
        let [inner, outer] = parts.determinants;
        let ratio = adjugate(parts.sharp) * outer.recip() - adjugate(parts.blurred) * (inner / (outer * outer));
        own.sharp = ratio * (0.5 * by_compensation / parts.compensation);
    }
}

/// Conic → covariance on the screen → rotation, scales, Jacobian and the view's rotation; returns what the
/// Jacobian's rows get.
fn through_covariance(optics: &Optics, splat: &Splat, of_splat: &SplatGradient, own: &mut Own) -> [DVec3; 2] {
    let (parts, conic) = (&splat.parts, splat.conic);
    let DVec3 { x: a, y: b, z: c } = of_splat.conic;
    let by_inverse = DMat2::from_cols(DVec2::new(a, 0.5 * b), DVec2::new(0.5 * b, c));
    let inverse = DMat2::from_cols(DVec2::new(conic.x, conic.y), DVec2::new(conic.y, conic.z));
    let by_covariance = own.sharp - inverse * by_inverse * inverse;

    // sharp = V Vᵀ with V = J W R S.
    let axes = parts.rotation * DMat3::from_diagonal(parts.scales);
    let world = parts.jacobian.map(|row| optics.rotation.transpose() * row);
    let screen = world.map(|row| axes.transpose() * row);
    let by_screen = [
        2.0 * (by_covariance.x_axis.x * screen[0] + by_covariance.x_axis.y * screen[1]),
        2.0 * (by_covariance.x_axis.y * screen[0] + by_covariance.y_axis.y * screen[1]),
    ];
    // Rows: screen = axesᵀ · world, so axes gets world ⊗ by_screen.
    let by_axes = outer(world[0], by_screen[0]) + outer(world[1], by_screen[1]);
    own.rotation = by_axes * DMat3::from_diagonal(parts.scales);
    let columns = |m: &DMat3| [m.x_axis, m.y_axis, m.z_axis];
    let of_scale: Vec<f64> =
        columns(&parts.rotation).iter().zip(columns(&by_axes)).map(|(axis, gradient)| axis.dot(gradient)).collect();
    own.scales = DVec3::from_slice(&of_scale);

    let by_world = by_screen.map(|row| axes * row);
    own.view_rotation = outer(parts.jacobian[0], by_world[0]) + outer(parts.jacobian[1], by_world[1]);
    by_world.map(|row| optics.rotation * row)
}

/// Centre on the screen, depth and Jacobian → centre in the camera's frame.
fn through_projection(
    optics: &Optics,
    options: &RenderOptions,
    parts: &Parts,
    of_splat: &SplatGradient,
    by_jacobian: [DVec3; 2],
    own: &mut Own,
) {
    let depth = parts.in_camera.z;
    own.in_camera.z += of_splat.depth;

    let true_slope = parts.in_camera.truncate() / depth;
    let there = match &optics.lens {
        None => DMat2::from_diagonal(optics.focal),
        Some(lens) => DMat2::from_diagonal(optics.focal) * lens.jacobian(true_slope).unwrap_or(DMat2::ZERO),
    };
    let by_true_slope = there.transpose() * of_splat.centre;
    own.in_camera += (by_true_slope / depth).extend(-by_true_slope.dot(true_slope) / depth);

    // J = A/z · [1 | −slope]
    let [first, second] = by_jacobian;
    let along = first.dot(parts.jacobian[0]) + second.dot(parts.jacobian[1]);
    own.in_camera.z -= along / depth;
    let by_last = DVec2::new(first.z, second.z);
    let mut by_slope = -(parts.pixel_from_slope.transpose() * by_last) / depth;
    if let Some(lens) = &optics.lens {
        let rows = [first, second].map(|row| (row.truncate() - parts.slope * row.z) / depth);
        by_slope += through_lens(lens, parts.slope, optics.focal, rows);
    }
    let pairs = [
        (parts.clamped[0], by_slope.x, true_slope.x, parts.slope.x),
        (parts.clamped[1], by_slope.y, true_slope.y, parts.slope.y),
    ];
    for (axis, (clamped, by_slope, true_slope, slope)) in pairs.into_iter().enumerate() {
        if !clamped {
            own.in_camera[axis] += by_slope / depth;
            own.in_camera.z -= by_slope * true_slope / depth;
        } else if options.constants.clamped_gradient == ClampedGradient::Inria {
            own.in_camera.z -= by_slope * slope / depth;
        }
    }
}

/// How the lens's own Jacobian changes with the slope, by central differences: its second derivatives have no
/// closed form here, and in f64 the differences are good to 1e-9. At the rim of what the lens sees they are to one side.
pub(crate) fn through_lens(lens: &Lens, slope: DVec2, focal: DVec2, by_rows: [DVec2; 2]) -> DVec2 {
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
        rows.x_axis.dot(by_rows[0]) + rows.y_axis.dot(by_rows[1])
    };
    DVec2::new(along(DVec2::X), along(DVec2::Y))
}

/// Colour → spherical harmonics; returns what the mean gets through the direction, and they.
fn through_colour(
    gaussians: &Gaussians,
    options: &RenderOptions,
    splat: &Splat,
    of_splat: &SplatGradient,
) -> (DVec3, [[f64; 3]; 25]) {
    let parts = gaussians.parts();
    let (kept, stored) = (&splat.parts, sh_coefficients(parts.sh_degree));
    let degree = if options.max_sh_degree < parts.sh_degree { options.max_sh_degree } else { parts.sh_degree };
    let through = |raw: f64, gradient: f64| if raw < 0.0 { 0.0 } else { gradient };
    let by_rgb = DVec3::new(
        through(kept.raw_rgb.x, of_splat.rgb.x),
        through(kept.raw_rgb.y, of_splat.rgb.y),
        through(kept.raw_rgb.z, of_splat.rgb.z),
    );
    let from = splat.position * stored;
    let used = from..from + sh_coefficients(degree);
    let basis = sh::basis(degree, kept.direction.to_array());
    let by_sh = basis.map(|value| (by_rgb * value).to_array());
    if options.gradients.directions_stop || kept.distance <= 0.0 {
        return (DVec3::ZERO, by_sh);
    }
    let slopes = sh::basis_gradient(degree, kept.direction.to_array());
    let by_direction =
        parts.sh.get(used).unwrap_or_default().iter().zip(slopes).fold(DVec3::ZERO, |sum, (coefficient, slope)| {
            sum + DVec3::from_array(slope) * DVec3::from_array(coefficient.map(f64::from)).dot(by_rgb)
        });
    let tangential = (by_direction - kept.direction * kept.direction.dot(by_direction)) / kept.distance;
    let by_mean = match options.constants.sh_axes {
        ShAxes::Standard => tangential,
        ShAxes::E3nn => DVec3::new(tangential.y, tangential.z, tangential.x),
    };
    (by_mean, by_sh)
}

/// Derivative by a quaternion `w, x, y, z` that is normalised before it becomes a rotation.
fn by_quaternion(stored: [f64; 4], by_rotation: &DMat3) -> [f64; 4] {
    let norm = stored.iter().map(|value| value * value).sum::<f64>().sqrt();
    let [w, x, y, z] = stored.map(|value| value / norm);
    let g = by_rotation.transpose().to_cols_array_2d();
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
