use atsplat_camera::ImageSize;
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};

use crate::constants::LARGEST_CHANNEL;
use crate::reach::reach;
use crate::rendering::Culled;
use crate::view::Optics;
use crate::{Gaussians, LOG_SCALE_LIMIT, RasterMode, RenderOptions, sh, sh_coefficients};

/// A projected Gaussian.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Splat {
    /// Index of the Gaussian.
    pub(crate) position: usize,
    /// Depth along the optical axis.
    pub(crate) depth: f64,
    /// Projected centre in pixels.
    pub(crate) centre: DVec2,
    /// Inverse 2D covariance, blur included: `(a, b, c)` of `½(a·dx² + c·dy²) + b·dx·dy`.
    pub(crate) conic: DVec3,
    /// Its Cholesky factor `(l₁₁, l₁₂, l₂₂)`: the same is `½((l₁₁·dx + l₁₂·dy)² + (l₂₂·dy)²)`, which does not cancel far from the
    /// centre of a needle.
    pub(crate) whitener: DVec3,
    /// After the sigmoid, the 3D filter and anti-aliasing.
    pub(crate) opacity: f64,
    pub(crate) rgb: DVec3,
    /// The Gaussian's scalar; 0 if there are none.
    pub(crate) scalar: f64,
    /// Half-open range of columns, then rows, that it may reach.
    pub(crate) reach: [[u32; 2]; 2],
    pub(crate) parts: Intermediates,
}

impl Splat {
    /// A vector in the image in standard deviations: half its square is the exponent.
    pub(crate) fn whitened(&self, offset: DVec2) -> DVec2 {
        let DVec3 { x: along, y: shear, z: down } = self.whitener;
        DVec2::new(along * offset.x + shear * offset.y, down * offset.y)
    }
}

/// Intermediate values for the backward pass.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Intermediates {
    pub(crate) shape: Shape,
    /// Mean in camera coordinates.
    pub(crate) in_camera: DVec3,
    pub(crate) near_mean: Linearisation,
    pub(crate) covariance: Covariance,
    /// Opacity factor of anti-aliasing.
    pub(crate) compensation: f64,
    /// Unit view direction, in the axis order of the spherical harmonics.
    pub(crate) direction: DVec3,
    /// Distance to the camera.
    pub(crate) distance: f64,
    /// Colour before clamping at 0.
    pub(crate) raw_rgb: DVec3,
}

pub(crate) fn project(
    gaussians: &Gaussians,
    position: usize,
    optics: &Optics,
    size: ImageSize,
    options: &RenderOptions,
) -> Result<Box<Splat>, Culled> {
    let constants = &options.constants;
    let shape = shape(gaussians, position).ok_or(Culled::Invalid)?;
    let in_camera = optics.rotation * shape.mean + optics.translation;
    if !in_camera.is_finite() {
        return Err(Culled::Invalid);
    }
    if !constants.keeps_depth(in_camera.z) {
        return Err(Culled::OutsideDepth);
    }
    let (centre, near_mean) = linearise(in_camera, optics).ok_or(Culled::OutsideImage)?;
    let covariance = Covariance::project(&shape, near_mean.jacobian, optics, constants.blur);
    let [_, determinant] = covariance.determinants;
    if !(determinant > 0.0 && determinant.is_finite() && centre.is_finite()) {
        return Err(Culled::Invalid);
    }
    let compensation = covariance.compensation(options);
    let opacity = shape.sigmoid * shape.filter * compensation;
    if !(opacity >= constants.min_alpha) {
        return Err(Culled::Faint);
    }
    let blurred = covariance.blurred;
    let blurred = [blurred.x_axis.x, blurred.x_axis.y, blurred.y_axis.y];
    let reach = reach(centre, blurred, opacity, size, constants).ok_or(Culled::OutsideImage)?;

    let offset = shape.mean - optics.centre;
    let distance = offset.length();
    let direction = if distance > 0.0 { offset / distance } else { DVec3::Z };
    let direction = constants.sh_axes.permuted(direction);
    let raw_rgb = colour(gaussians, position, direction, options).ok_or(Culled::Invalid)?;
    let scalar = gaussians.parts().scalars.as_ref().map_or(0.0, |scalars| f64::from(scalars[position]));
    if !(scalar.abs() <= LARGEST_CHANNEL) {
        return Err(Culled::Invalid);
    }
    Ok(Box::new(Splat {
        position,
        depth: in_camera.z,
        centre,
        conic: covariance.conic(),
        whitener: covariance.whitener(),
        opacity,
        rgb: DVec3::from_array(raw_rgb.to_array().map(|value| if value < 0.0 { 0.0 } else { value })),
        scalar,
        reach,
        parts: Intermediates { shape, in_camera, near_mean, covariance, compensation, direction, distance, raw_rgb },
    }))
}

/// The map from camera coordinates to pixels near a mean.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Linearisation {
    /// `x/z` and `y/z` clamped for the Jacobian, and whether each was clamped.
    pub(crate) slope: DVec2,
    pub(crate) clamped: [bool; 2],
    /// `∂pixel/∂slope` (lens and focal lengths) at the clamped slope.
    pub(crate) pixel_from_slope: DMat2,
    /// Rows of the Jacobian `∂pixel/∂(x, y, z)` in camera coordinates.
    pub(crate) jacobian: [DVec3; 2],
}

/// The projected mean in pixels, and the map near it; `None` outside the lens.
fn linearise(in_camera: DVec3, optics: &Optics) -> Option<(DVec2, Linearisation)> {
    let true_slope = in_camera.truncate() / in_camera.z;
    let slope = true_slope.clamp(optics.jacobian_range[0], optics.jacobian_range[1]);
    let within = true_slope.cmpge(optics.jacobian_range[0]) & true_slope.cmple(optics.jacobian_range[1]);
    let clamped = [!within.test(0), !within.test(1)];
    let focal = DMat2::from_diagonal(optics.focal);
    let (centre, pixel_from_slope) = match &optics.lens {
        None => (focal * true_slope + optics.principal, focal),
        Some(lens) => {
            let distorted = lens.distorted_from_undistorted(true_slope).ok()?;
            (focal * distorted + optics.principal, focal * lens.jacobian(slope).ok()?)
        }
    };
    let jacobian = jacobian(pixel_from_slope, slope, in_camera.z);
    Some((centre, Linearisation { slope, clamped, pixel_from_slope, jacobian }))
}

/// `∂pixel/∂(x, y, z)` at a point `slope·z`: `A/z · [1 | −slope]`.
fn jacobian(pixel_from_slope: DMat2, slope: DVec2, depth: f64) -> [DVec3; 2] {
    let rows = pixel_from_slope.transpose();
    [rows.x_axis, rows.y_axis].map(|row| row.extend(-row.dot(slope)) / depth)
}

/// The covariance of a Gaussian in the image.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Covariance {
    /// Without and with the blur.
    pub(crate) plain: DMat2,
    pub(crate) blurred: DMat2,
    /// Determinants of the two, computed without cancellation.
    pub(crate) determinants: [f64; 2],
}

impl Covariance {
    fn project(shape: &Shape, jacobian: [DVec3; 2], optics: &Optics, blur: f64) -> Self {
        let axes = shape.rotation * DMat3::from_diagonal(shape.scales);
        let screen = jacobian.map(|row| axes.transpose() * (optics.rotation.transpose() * row));
        let plain = DMat2::from_cols(
            DVec2::new(screen[0].dot(screen[0]), screen[0].dot(screen[1])),
            DVec2::new(screen[0].dot(screen[1]), screen[1].dot(screen[1])),
        );
        let blurred = plain + DMat2::from_diagonal(DVec2::splat(blur));
        // |u|²|v|² − (u·v)² cancels for needle-shaped Gaussians; the cross product does not.
        let inner = screen[0].cross(screen[1]).length_squared();
        let trace = plain.x_axis.x + plain.y_axis.y;
        Self { plain, blurred, determinants: [inner, inner + blur * trace + blur * blur] }
    }

    /// See [`Splat::conic`].
    fn conic(&self) -> DVec3 {
        let [_, determinant] = self.determinants;
        DVec3::new(self.blurred.y_axis.y, -self.blurred.x_axis.y, self.blurred.x_axis.x) / determinant
    }

    /// See [`Splat::whitener`].
    fn whitener(&self) -> DVec3 {
        let [_, determinant] = self.determinants;
        let (xy, yy) = (self.blurred.x_axis.y, self.blurred.y_axis.y);
        let along = (yy / determinant).sqrt();
        DVec3::new(along, -xy / yy * along, yy.sqrt().recip())
    }

    /// Opacity factor of anti-aliasing.
    fn compensation(&self, options: &RenderOptions) -> f64 {
        let [inner, outer] = self.determinants;
        let (ratio, least) = ((inner / outer).sqrt(), options.constants.min_compensation);
        match options.mode {
            RasterMode::Classic => 1.0,
            RasterMode::Antialiased if ratio < least => least,
            RasterMode::Antialiased => ratio,
        }
    }
}

/// The camera-independent values of a Gaussian.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shape {
    pub(crate) mean: DVec3,
    /// `world_from_gaussian`.
    pub(crate) rotation: DMat3,
    /// Standard deviations, after the 3D filter.
    pub(crate) scales: DVec3,
    /// Ratio of the Gaussian's own variances to the filtered ones.
    pub(crate) unfiltered_share: DVec3,
    /// Opacity after the sigmoid alone.
    pub(crate) sigmoid: f64,
    /// `1 − sigmoid`, computed without cancellation.
    pub(crate) one_minus_sigmoid: f64,
    /// Opacity factor of the 3D filter.
    pub(crate) filter: f64,
}

/// [`Shape`]; `None` if a parameter is invalid.
fn shape(gaussians: &Gaussians, position: usize) -> Option<Shape> {
    let parts = gaussians.parts();
    let mean = parts.means[position].map(f64::from);
    let [w, x, y, z] = parts.quaternions[position].map(f64::from);
    let log_scales = parts.log_scales[position];
    let scales = DVec3::from_array(log_scales.map(|log| f64::from(log).exp()));
    let logit = f64::from(parts.opacity_logits[position]);
    let filter_3d = parts.filter_3d.as_ref().map_or(0.0, |filter| f64::from(filter[position]));
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    let norm = quaternion.length();
    let valid = DVec3::from_array(mean).is_finite()
        && norm.is_finite()
        && norm > 0.0
        && log_scales.iter().all(|log| *log <= LOG_SCALE_LIMIT)
        && !logit.is_nan()
        && filter_3d.is_finite();
    if !valid {
        return None;
    }
    let variances = scales * scales;
    let total = variances + DVec3::splat(filter_3d * filter_3d);
    let unfiltered_share = if filter_3d == 0.0 { DVec3::ONE } else { variances / total };
    Some(Shape {
        mean: DVec3::from_array(mean),
        rotation: DMat3::from_quat(quaternion / norm),
        scales: if filter_3d == 0.0 { scales } else { DVec3::from_array(total.to_array().map(f64::sqrt)) },
        unfiltered_share,
        sigmoid: 1.0 / (1.0 + (-logit).exp()),
        one_minus_sigmoid: 1.0 / (1.0 + logit.exp()),
        filter: (unfiltered_share.x * unfiltered_share.y * unfiltered_share.z).sqrt(),
    })
}

/// Unclamped colour of a Gaussian in a direction; `None` if it is not finite or too large.
fn colour(gaussians: &Gaussians, position: usize, direction: DVec3, options: &RenderOptions) -> Option<DVec3> {
    let parts = gaussians.parts();
    let degree = options.sh_degree(parts.sh_degree);
    let basis = sh::basis(degree, direction.to_array());
    let add = |sum, (coefficient, value): ([f64; 3], f64)| sum + value * DVec3::from_array(coefficient);
    let stored = sh_coefficients(parts.sh_degree);
    let used = &parts.sh[position * stored..][..sh_coefficients(degree)];
    let (first, upper) = match &options.harmonics {
        Some(packed) => packed.coefficients(position)?,
        None => (used[0], &used[1..]),
    };
    let coefficients = std::iter::once(&first).chain(upper).map(|coefficient| coefficient.map(f64::from));
    let sum = coefficients.zip(basis).fold(DVec3::splat(0.5), add);
    (sum.abs().max_element() <= LARGEST_CHANNEL && sum.is_finite()).then_some(sum)
}
