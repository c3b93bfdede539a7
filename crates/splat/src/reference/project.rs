use atsplat_camera::ImageSize;
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};

use crate::constants::{LARGEST_CHANNEL, ShAxes};
use crate::reach::reach;
use crate::view::Optics;
use crate::{Gaussians, LOG_SCALE_LIMIT, RasterMode, RenderOptions, sh, sh_coefficients};

/// One Gaussian as the picture sees it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Splat {
    /// In the list of Gaussians.
    pub(crate) position: usize,
    /// Along the optical axis.
    pub(crate) depth: f64,
    /// Projected centre in pixels.
    pub(crate) centre: DVec2,
    /// Inverse covariance on the screen, `(a, b, c)` of `½(a·dx² + c·dy²) + b·dx·dy`.
    pub(crate) conic: DVec3,
    /// After the sigmoid, the 3D filter and anti-aliasing.
    pub(crate) opacity: f64,
    pub(crate) rgb: DVec3,
    /// Its own scalar, 0 where there is none.
    pub(crate) scalar: f64,
    /// First and one past the last pixel that it may reach, columns and rows.
    pub(crate) reach: [[u32; 2]; 2],
    pub(crate) parts: Parts,
}

/// What the derivative needs again.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Parts {
    /// Centre in the camera's frame.
    pub(crate) in_camera: DVec3,
    /// World from Gaussian.
    pub(crate) rotation: DMat3,
    /// Standard deviations, after the 3D filter.
    pub(crate) scales: DVec3,
    /// Share of the variances that the 3D filter left to the Gaussian.
    pub(crate) own_share: DVec3,
    /// Opacity after the sigmoid, before everything else.
    pub(crate) sigmoid: f64,
    /// What it leaves to 1, which f64 would round away.
    pub(crate) rest: f64,
    /// What the 3D filter multiplied it with.
    pub(crate) filter: f64,
    /// What anti-aliasing multiplied it with.
    pub(crate) compensation: f64,
    /// `x/z` and `y/z` where the Jacobian is taken, and whether each was clamped.
    pub(crate) slope: DVec2,
    pub(crate) clamped: [bool; 2],
    /// Lens and focal lengths: pixels by slope, where the Jacobian is taken.
    pub(crate) pixel_from_slope: DMat2,
    /// Rows of the Jacobian, pixels by camera coordinates.
    pub(crate) jacobian: [DVec3; 2],
    /// On the screen without and with the blur.
    pub(crate) sharp: DMat2,
    pub(crate) blurred: DMat2,
    /// Of the two, without the cancellation of taking them from the matrices.
    pub(crate) determinants: [f64; 2],
    /// Unit direction from the camera, in the axes that the harmonics are evaluated on.
    pub(crate) direction: DVec3,
    /// Distance to the camera.
    pub(crate) distance: f64,
    /// Colour before it was clamped at 0.
    pub(crate) raw_rgb: DVec3,
}

pub(crate) enum Outcome {
    Drawn(Box<Splat>),
    Invalid,
    OutsideDepth,
    Faint,
    OutsidePicture,
}

pub(crate) fn project(
    gaussians: &Gaussians,
    position: usize,
    optics: &Optics,
    size: ImageSize,
    options: &RenderOptions,
) -> Outcome {
    let constants = &options.constants;
    let Some(Shape { mean, rotation, scales, own_share, sigmoid, rest, filter }) = shape(gaussians, position) else {
        return Outcome::Invalid;
    };
    let in_camera = optics.rotation * mean + optics.translation;
    if !in_camera.is_finite() {
        return Outcome::Invalid;
    }
    if !constants.keeps_depth(in_camera.z) {
        return Outcome::OutsideDepth;
    }
    let true_slope = in_camera.truncate() / in_camera.z;
    let slope = true_slope.clamp(optics.jacobian_range[0], optics.jacobian_range[1]);
    let within = true_slope.cmpge(optics.jacobian_range[0]) & true_slope.cmple(optics.jacobian_range[1]);
    let clamped = [!within.test(0), !within.test(1)];
    let focal = DMat2::from_diagonal(optics.focal);
    let (centre, pixel_from_slope) = match &optics.lens {
        None => (focal * true_slope + optics.principal, focal),
        Some(lens) => match (lens.distorted_from_undistorted(true_slope), lens.jacobian(slope)) {
            (Ok(bent), Ok(jacobian)) => (focal * bent + optics.principal, focal * jacobian),
            _ => return Outcome::OutsidePicture,
        },
    };
    let jacobian = jacobian(pixel_from_slope, slope, in_camera.z);

    let axes = rotation * DMat3::from_diagonal(scales);
    let screen = jacobian.map(|row| axes.transpose() * (optics.rotation.transpose() * row));
    let sharp = DMat2::from_cols(
        DVec2::new(screen[0].dot(screen[0]), screen[0].dot(screen[1])),
        DVec2::new(screen[0].dot(screen[1]), screen[1].dot(screen[1])),
    );
    let blurred = sharp + DMat2::from_diagonal(DVec2::splat(constants.blur));
    // |u|²|v|² − (u·v)² cancels for needles; the cross product does not.
    let sharp_determinant = screen[0].cross(screen[1]).length_squared();
    let trace = sharp.x_axis.x + sharp.y_axis.y;
    let determinant = sharp_determinant + constants.blur * trace + constants.blur * constants.blur;
    if !(determinant > 0.0 && determinant.is_finite() && centre.is_finite()) {
        return Outcome::Invalid;
    }
    let conic = DVec3::new(blurred.y_axis.y, -blurred.x_axis.y, blurred.x_axis.x) / determinant;

    let ratio = (sharp_determinant / determinant).sqrt();
    let compensation = match options.mode {
        RasterMode::Classic => 1.0,
        RasterMode::Antialiased if ratio < constants.min_compensation => constants.min_compensation,
        RasterMode::Antialiased => ratio,
    };
    let opacity = sigmoid * filter * compensation;
    if !(opacity >= constants.min_alpha) {
        return Outcome::Faint;
    }
    let covariance = [blurred.x_axis.x, blurred.x_axis.y, blurred.y_axis.y];
    let Some(reach) = reach(centre, covariance, opacity, size, constants) else { return Outcome::OutsidePicture };

    let away = mean - optics.centre;
    let distance = away.length();
    let direction = if distance > 0.0 { away / distance } else { DVec3::Z };
    let direction = match constants.sh_axes {
        ShAxes::Standard => direction,
        ShAxes::E3nn => DVec3::new(direction.z, direction.x, direction.y),
    };
    let Some(raw_rgb) = colour(gaussians, position, direction, options) else { return Outcome::Invalid };
    let scalar = gaussians.parts().scalars.as_ref().and_then(|scalars| scalars.get(position).copied());
    let scalar = f64::from(scalar.unwrap_or_default());
    if !(scalar.abs() <= LARGEST_CHANNEL) {
        return Outcome::Invalid;
    }
    let parts = Parts {
        in_camera,
        rotation,
        scales,
        own_share,
        sigmoid,
        rest,
        filter,
        compensation,
        slope,
        clamped,
        pixel_from_slope,
        jacobian,
        sharp,
        blurred,
        determinants: [sharp_determinant, determinant],
        direction,
        distance,
        raw_rgb,
    };
    let rgb = DVec3::from_array(raw_rgb.to_array().map(|value| if value < 0.0 { 0.0 } else { value }));
    Outcome::Drawn(Box::new(Splat { position, depth: in_camera.z, centre, conic, opacity, rgb, scalar, reach, parts }))
}

/// `∂pixel/∂(x, y, z)` of a point at `slope·z`: `A/z · [1 | −slope]`.
fn jacobian(pixel_from_slope: DMat2, slope: DVec2, depth: f64) -> [DVec3; 2] {
    let rows = pixel_from_slope.transpose();
    [rows.x_axis, rows.y_axis].map(|row| row.extend(-row.dot(slope)) / depth)
}

struct Shape {
    mean: DVec3,
    rotation: DMat3,
    scales: DVec3,
    own_share: DVec3,
    sigmoid: f64,
    rest: f64,
    filter: f64,
}

/// A Gaussian's numbers, `None` where one of them cannot be used.
fn shape(gaussians: &Gaussians, position: usize) -> Option<Shape> {
    let parts = gaussians.parts();
    let mean = parts.means.get(position)?.map(f64::from);
    let [w, x, y, z] = parts.quaternions.get(position)?.map(f64::from);
    let log_scales = *parts.log_scales.get(position)?;
    let scales = DVec3::from_array(log_scales.map(|log| f64::from(log).exp()));
    let logit = f64::from(*parts.opacity_logits.get(position)?);
    let filter_3d = parts.filter_3d.as_ref().map_or(Some(0.0), |filter| filter.get(position).map(|f| f64::from(*f)))?;
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    let norm = quaternion.length();
    let usable = DVec3::from_array(mean).is_finite()
        && norm.is_finite()
        && norm > 0.0
        && log_scales.iter().all(|log| *log <= LOG_SCALE_LIMIT)
        && !logit.is_nan()
        && filter_3d.is_finite();
    if !usable {
        return None;
    }
    let own = scales * scales;
    let total = own + DVec3::splat(filter_3d * filter_3d);
    let own_share = if filter_3d == 0.0 { DVec3::ONE } else { own / total };
    Some(Shape {
        mean: DVec3::from_array(mean),
        rotation: DMat3::from_quat(quaternion / norm),
        scales: if filter_3d == 0.0 { scales } else { DVec3::from_array(total.to_array().map(f64::sqrt)) },
        own_share,
        sigmoid: 1.0 / (1.0 + (-logit).exp()),
        rest: 1.0 / (1.0 + logit.exp()),
        filter: (own_share.x * own_share.y * own_share.z).sqrt(),
    })
}

/// Colour of a Gaussian in a direction, not clamped; `None` where a coefficient is not finite.
fn colour(gaussians: &Gaussians, position: usize, direction: DVec3, options: &RenderOptions) -> Option<DVec3> {
    let parts = gaussians.parts();
    let degree = if options.max_sh_degree < parts.sh_degree { options.max_sh_degree } else { parts.sh_degree };
    let stored = sh_coefficients(parts.sh_degree);
    let coefficients = parts.sh.get(position * stored..)?.iter().take(sh_coefficients(degree));
    let basis = sh::basis(degree, direction.to_array());
    let sum = coefficients.zip(basis).fold(DVec3::splat(0.5), |sum, (coefficient, value)| {
        sum + value * DVec3::from_array(coefficient.map(f64::from))
    });
    (sum.abs().max_element() <= LARGEST_CHANNEL && sum.is_finite()).then_some(sum)
}
