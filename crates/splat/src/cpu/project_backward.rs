//! Backward pass of projection, in chunks: from gradients of splats to gradients of Gaussians.

use bytemuck::Zeroable;
use pulp::Simd;

use super::colour::view_direction;
use super::project::{HALF_LOG2_E, Screen, dot_each, jacobian, to_world};
use super::shape::{Shapes, rotation};
use super::wide::{CHUNK, Row, Wide, combine, cross, dot, load2, load3, splat3, store2, store3};
use crate::constants::{ClampedGradient, ShAxes};
use crate::reference::project_backward::through_lens;
use crate::view::Optics;
use crate::{RasterMode, RenderOptions};
use glam::DVec2;

/// Gradients of a chunk of splats.
#[derive(Debug, Zeroable)]
pub(super) struct SplatGradients {
    /// Moments over pixels, see [`super::pixel_sums`]: `e, ex, ey`, then `exx, exy, eyy`.
    pub(super) moments: [[Row; 3]; 2],
    /// 1 where `u` takes the place of `x`, otherwise 0.
    pub(super) is_slanted: Row,
    /// From the centre to the base, in pixels.
    pub(super) from_centre: [Row; 2],
    pub(super) depth: Row,
    /// With respect to the view direction.
    pub(super) direction: [Row; 3],
}

/// Gradients of the parameters of a chunk of Gaussians.
#[derive(Debug, Zeroable)]
pub(super) struct GaussianGradients {
    pub(super) mean: [Row; 3],
    pub(super) quaternion: [Row; 4],
    pub(super) log_scales: [Row; 3],
    pub(super) logit: Row,
    pub(super) centre: [Row; 2],
    pub(super) conic: [Row; 3],
    /// Rotation, then translation.
    pub(super) pose: [[Row; 3]; 2],
    /// With respect to the Jacobian's rows.
    d_jacobian: [[Row; 3]; 2],
    /// Extra gradient of the clamped slope through a lens, and the lens's `∂pixel/∂slope` at the true slope.
    d_slope: [Row; 2],
    lens_jacobian: [[Row; 2]; 2],
}

/// The forward values at which the gradient is evaluated.
pub(super) struct ForwardState<'a> {
    pub(super) shapes: &'a Shapes,
    pub(super) screen: &'a Screen,
    pub(super) optics: &'a Optics,
    pub(super) options: &'a RenderOptions,
}

impl SplatGradients {
    /// The moments with whitened coordinates, `e, eu, ev` and `euu, euv, evv`, in standard deviations from the centre: neither a
    /// needle's length nor its distance makes them large.
    #[inline(always)]
    fn whitened<S: Simd>(&self, simd: S, screen: &Screen, vector: usize) -> [[Wide<S>; 3]; 2] {
        let [first, second] = &self.moments;
        let ([e, ex, ey], [exx, exy, eyy]) = (load3(simd, first, vector), load3(simd, second, vector));
        let [x, y] = load2(simd, &self.from_centre, vector);
        let [a, b, c] = whitener(simd, screen, vector);
        let (shift_u, shift_v) = (a.mul_add(x, b * y), c * y);
        // Of a moment, those with a column, a row, and u or v.
        let with_u = |e: Wide<S>, ex: Wide<S>, ey: Wide<S>| a.mul_add(ex, b.mul_add(ey, shift_u * e));
        let with_v = |e: Wide<S>, ey: Wide<S>| c.mul_add(ey, shift_v * e);
        let (eu, eux, euy) = (with_u(e, ex, ey), with_u(ex, exx, exy), with_u(ey, exy, eyy));
        let euu = with_u(eu, eux, euy);
        // A slanted needle's moments with u are in the unit of splats.
        let (is_slanted, zero) = (Wide::load(simd, &self.is_slanted, vector), e.of(0.0));
        let unit = e.of(1.0 / HALF_LOG2_E);
        let eu = (ex * unit).where_above(is_slanted, zero, eu);
        let euu = (exx * unit * unit).where_above(is_slanted, zero, euu);
        let euy = (exy * unit).where_above(is_slanted, zero, euy);
        let ev = with_v(e, ey);
        [[e, eu, ev], [euu, with_v(eu, euy), with_v(ev, with_v(ey, eyy))]]
    }
}

/// `L = [a, b; 0, c]`, of which `Lᵀ L` is the inverse covariance.
#[inline(always)]
fn whitener<S: Simd>(simd: S, screen: &Screen, vector: usize) -> [Wide<S>; 3] {
    let [along, shear, down] = load3(simd, &screen.whitener, vector);
    let unit = along.of(1.0 / HALF_LOG2_E);
    [along * unit, shear * unit, down * unit]
}

impl GaussianGradients {
    #[inline(always)]
    pub(super) fn compute<S: Simd>(&mut self, simd: S, at: &ForwardState<'_>, d_splat: &SplatGradients) {
        for vector in 0..CHUNK / S::F64_LANES {
            self.through_covariance(simd, at, d_splat, vector);
        }
        if at.optics.lens.is_some() {
            self.through_lens(at);
        }
        for vector in 0..CHUNK / S::F64_LANES {
            self.through_projection(simd, at, d_splat, vector);
        }
    }

    /// From splats to opacity and 2D covariance, then to rotation, scales and Jacobian.
    #[inline(always)]
    fn through_covariance<S: Simd>(&mut self, simd: S, at: &ForwardState<'_>, d_splat: &SplatGradients, vector: usize) {
        let ForwardState { shapes, screen, optics, options } = *at;
        let splat = |value| Wide::splat(simd, value);
        let one = splat(1.0);
        let [[e, eu, ev], [euu, euv, evv]] = d_splat.whitened(simd, screen, vector);
        let [uu, uv, vv] = load3(simd, &screen.cov2d, vector);
        let [inner, outer] = load2(simd, &screen.determinants, vector);
        let blur = splat(options.constants.blur);
        let (xx, yy) = (uu + blur, vv + blur);
        // The inverse covariance is Lᵀ L, with L = [a, b; 0, c]. Distances are (u − b/c·v) / a and v / c.
        let [a, b, c] = whitener(simd, screen, vector);
        store2([-(a * eu), -b.mul_add(eu, c * ev)], &mut self.centre, vector);
        let (per_a, per_c) = (one / a, one / c);
        let slope = b * per_c;
        let exv = (euv - slope * evv) * per_a;
        let exx = (euu - slope * euv) * per_a * per_a - slope * exv * per_a;
        let halved = splat(0.5);
        store3([halved * exx, exv * per_c, halved * evv * per_c * per_c], &mut self.conic, vector);

        // Gradient of the covariance: −½ Lᵀ [euu, euv; euv, evv] L.
        let (p, q) = (b.mul_add(euu, c * euv), b.mul_add(euv, c * evv));
        let half = splat(-0.5);
        let mut d_xx = half * (a * a * euu);
        let mut d_xy = half * (a * p);
        let mut d_yy = half * b.mul_add(p, c * q);
        if options.mode == RasterMode::Antialiased {
            // −½ e (Σ⁻¹ − Σ'⁻¹), without and with the blur, unless the compensation is clamped.
            let (least, zero) = (splat(options.constants.min_compensation), splat(0.0));
            let (ratio, inv_det) = (inner / outer, one / outer);
            let d_ratio = e * half / ratio;
            let term = |cov2d: Wide<S>, blurred: Wide<S>| {
                let slope = (cov2d * inv_det - blurred * inv_det * ratio) * d_ratio;
                slope.where_above(ratio.sqrt(), least, zero)
            };
            d_xx = d_xx + term(vv, yy);
            d_xy = d_xy - term(uv, uv);
            d_yy = d_yy + term(uu, xx);
        }

        // Σ = V Vᵀ with V = J W R S.
        let inv_depth = one / Wide::load(simd, &screen.depth, vector);
        let slope = load2(simd, &screen.slope[1], vector);
        let [row_x, row_y] = screen.pixel_from_slope(simd, optics, vector);
        let worlds = [
            to_world(simd, optics, jacobian(row_x, slope, inv_depth)),
            to_world(simd, optics, jacobian(row_y, slope, inv_depth)),
        ];
        let [first, second, third] = &shapes.axes;
        let axes = [load3(simd, first, vector), load3(simd, second, vector), load3(simd, third, vector)];
        let (u, v) = (dot_each(axes, worlds[0]), dot_each(axes, worlds[1]));
        let two = splat(2.0);
        let (d_xx, d_xy, d_yy) = (d_xx * two, d_xy * two, d_yy * two);
        let d_u = combine2([u, v], [d_xx, d_xy]);
        let d_v = combine2([u, v], [d_xy, d_yy]);

        let [w, x, y, z] = &shapes.quaternion;
        let quaternion = [
            Wide::load(simd, w, vector),
            Wide::load(simd, x, vector),
            Wide::load(simd, y, vector),
            Wide::load(simd, z, vector),
        ];
        let rotation = rotation(quaternion);
        let scales = load3(simd, &shapes.scales, vector);
        let shares = load3(simd, &shapes.unfiltered_share, vector);
        let mut d_rotation = [[e; 3]; 3];
        let mut d_logs = [e; 3];
        for axis in 0..3 {
            let [x, y, z] = combine2(worlds, [d_u[axis], d_v[axis]]);
            let scale = scales[axis];
            d_rotation[axis] = [x * scale, y * scale, z * scale];
            // With a filter f, the effective scale √(s² + f²) has the derivative s²/√(s² + f²) with respect to log s,
            // and log opacity has 1 − s²/(s² + f²).
            let d_scale = dot(rotation[axis], d_rotation[axis]) * shares[axis];
            d_logs[axis] = d_scale - e * (one - shares[axis]);
        }
        store3(d_logs, &mut self.log_scales, vector);
        let [w, x, y, z] = d_quaternion(quaternion, d_rotation);
        for (row, value) in self.quaternion.iter_mut().zip([w, x, y, z]) {
            value.store(row, vector);
        }
        let one_minus_sigmoid = Wide::load(simd, &shapes.odds, vector) * Wide::load(simd, &shapes.sigmoid, vector);
        (-(e * one_minus_sigmoid)).store(&mut self.logit, vector);

        let columns = optics.rotation.transpose().to_cols_array_2d();
        let camera = [splat3(simd, columns[0]), splat3(simd, columns[1]), splat3(simd, columns[2])];
        let [d_x, d_y] = &mut self.d_jacobian;
        store3(dot_each(camera, combine(axes, d_u)), d_x, vector);
        store3(dot_each(camera, combine(axes, d_v)), d_y, vector);
    }

    /// Gradient of the slope through the lens's Jacobian, lane by lane.
    #[inline(always)]
    fn through_lens(&mut self, at: &ForwardState<'_>) {
        let ForwardState { screen, optics, .. } = *at;
        let Some(lens) = &optics.lens else { return };
        for lane in 0..CHUNK {
            let [slope, clamped_slope] = screen.slope.each_ref().map(|[x, y]| DVec2::new(x[lane], y[lane]));
            let rows = [0, 1].map(|row| {
                let d_row = &self.d_jacobian[row];
                (DVec2::new(d_row[0][lane], d_row[1][lane]) - clamped_slope * d_row[2][lane]) / screen.depth[lane]
            });
            let extra = through_lens(lens, clamped_slope, optics.focal, rows);
            (self.d_slope[0][lane], self.d_slope[1][lane]) = (extra.x, extra.y);
            // Undrawn Gaussians may be outside the lens. A drawn one is inside, except for the last bit of a fisheye's largest angle.
            let lens_jacobian = lens.jacobian(slope).unwrap_or(glam::DMat2::ZERO);
            let [x, y] = [lens_jacobian.x_axis * optics.focal, lens_jacobian.y_axis * optics.focal];
            (self.lens_jacobian[0][0][lane], self.lens_jacobian[0][1][lane]) = (x.x, y.x);
            (self.lens_jacobian[1][0][lane], self.lens_jacobian[1][1][lane]) = (x.y, y.y);
        }
    }

    /// From centre, depth, Jacobian and view direction to mean and pose.
    #[inline(always)]
    fn through_projection<S: Simd>(&mut self, simd: S, at: &ForwardState<'_>, d_splat: &SplatGradients, vector: usize) {
        let ForwardState { screen, optics, options, .. } = *at;
        let splat = |value| Wide::splat(simd, value);
        let zero = splat(0.0);
        let depth = Wide::load(simd, &screen.depth, vector);
        let inv_depth = splat(1.0) / depth;
        let [slopes, clamped_slope] = &screen.slope;
        let (true_slope, slope) = (load2(simd, slopes, vector), load2(simd, clamped_slope, vector));
        let d_centre = load2(simd, &self.centre, vector);
        let [lens_x, lens_y] = match &optics.lens {
            None => [[splat(optics.focal.x), zero], [zero, splat(optics.focal.y)]],
            Some(_) => [load2(simd, &self.lens_jacobian[0], vector), load2(simd, &self.lens_jacobian[1], vector)],
        };
        let d_true_slope = [
            lens_x[0].mul_add(d_centre[0], lens_y[0] * d_centre[1]) * inv_depth,
            lens_x[1].mul_add(d_centre[0], lens_y[1] * d_centre[1]) * inv_depth,
        ];
        let mut d_camera = [d_true_slope[0], d_true_slope[1], Wide::load(simd, &d_splat.depth, vector)];
        d_camera[2] = d_camera[2] - d_true_slope[0].mul_add(true_slope[0], d_true_slope[1] * true_slope[1]);

        // J = A/z · [1 | −slope]
        let rows = screen.pixel_from_slope(simd, optics, vector);
        let jacobians = [jacobian(rows[0], slope, inv_depth), jacobian(rows[1], slope, inv_depth)];
        let d_rows = [load3(simd, &self.d_jacobian[0], vector), load3(simd, &self.d_jacobian[1], vector)];
        d_camera[2] = d_camera[2] - (dot(d_rows[0], jacobians[0]) + dot(d_rows[1], jacobians[1])) * inv_depth;
        for axis in 0..2 {
            let mut d_slope = -(rows[0][axis].mul_add(d_rows[0][2], rows[1][axis] * d_rows[1][2]) * inv_depth);
            if optics.lens.is_some() {
                d_slope = d_slope + Wide::load(simd, &self.d_slope[axis], vector);
            }
            let d_slope = d_slope * inv_depth;
            let free = d_slope.where_equal(true_slope[axis], slope[axis], zero);
            d_camera[axis] = d_camera[axis] + free;
            d_camera[2] = d_camera[2] - free * true_slope[axis];
            if options.constants.clamped_gradient == ClampedGradient::Inria {
                d_camera[2] = d_camera[2] - (d_slope - free) * slope[axis];
            }
        }

        let d_colour = through_direction(simd, at, d_splat, vector);
        let rotation = optics.rotation.to_cols_array_2d();
        let camera = [splat3(simd, rotation[0]), splat3(simd, rotation[1]), splat3(simd, rotation[2])];
        let d_mean = dot_each(camera, d_camera);
        store3(sum(d_mean, d_colour), &mut self.mean, vector);

        // The view direction runs from the camera centre, −Rᵀt, to the mean.
        let in_camera = [true_slope[0] * depth, true_slope[1] * depth, depth];
        let turning = sum(cross(d_rows[0], jacobians[0]), cross(d_rows[1], jacobians[1]));
        let [d_rotation, d_translation] = &mut self.pose;
        store3(sum(cross(in_camera, d_camera), turning), d_rotation, vector);
        store3(sum(d_camera, combine(camera, d_colour)), d_translation, vector);
    }
}

/// Gradient of the mean through the view direction: the tangential component divided by the distance.
#[inline(always)]
fn through_direction<S: Simd>(simd: S, at: &ForwardState<'_>, d_splat: &SplatGradients, vector: usize) -> [Wide<S>; 3] {
    let by = load3(simd, &d_splat.direction, vector);
    let by = match at.options.constants.sh_axes {
        ShAxes::Standard => by,
        ShAxes::E3nn => [by[1], by[2], by[0]],
    };
    let (unit, distance) = view_direction(simd, at.shapes, at.optics, vector);
    let (zero, radial) = (distance.of(0.0), dot(by, unit));
    let tangential = [by[0] - unit[0] * radial, by[1] - unit[1] * radial, by[2] - unit[2] * radial];
    let [x, y, z] = tangential;
    [
        (x / distance).where_above(distance, zero, zero),
        (y / distance).where_above(distance, zero, zero),
        (z / distance).where_above(distance, zero, zero),
    ]
}

#[inline(always)]
fn sum<S: Simd>(a: [Wide<S>; 3], b: [Wide<S>; 3]) -> [Wide<S>; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `weights[0] · vectors[0] + weights[1] · vectors[1]`.
#[inline(always)]
fn combine2<S: Simd>([a, b]: [[Wide<S>; 3]; 2], [p, q]: [Wide<S>; 2]) -> [Wide<S>; 3] {
    [a[0].mul_add(p, b[0] * q), a[1].mul_add(p, b[1] * q), a[2].mul_add(p, b[2] * q)]
}

/// Gradient of an unnormalised quaternion `w, x, y, z`, given the gradients `g` of its rotation matrix's columns.
#[inline(always)]
fn d_quaternion<S: Simd>([w, x, y, z]: [Wide<S>; 4], g: [[Wide<S>; 3]; 3]) -> [Wide<S>; 4] {
    let inv_norm = w.of(1.0) / w.mul_add(w, x.mul_add(x, y.mul_add(y, z * z))).sqrt();
    let (w, x, y, z) = (w * inv_norm, x * inv_norm, y * inv_norm, z * inv_norm);
    let two = w.of(2.0);
    // g[column][row]
    let (turn_x, turn_y, turn_z) = (g[1][2] - g[2][1], g[2][0] - g[0][2], g[0][1] - g[1][0]);
    let (even_xy, even_xz, even_yz) = (g[1][0] + g[0][1], g[2][0] + g[0][2], g[2][1] + g[1][2]);
    let d_w = dot([x, y, z], [turn_x, turn_y, turn_z]) * two;
    let d_x = (dot([w, y, z], [turn_x, even_xy, even_xz]) - two * x * (g[1][1] + g[2][2])) * two;
    let d_y = (dot([w, x, z], [turn_y, even_xy, even_yz]) - two * y * (g[0][0] + g[2][2])) * two;
    let d_z = (dot([w, x, y], [turn_z, even_xz, even_yz]) - two * z * (g[0][0] + g[1][1])) * two;
    let radial = w.mul_add(d_w, dot([x, y, z], [d_x, d_y, d_z]));
    [
        (d_w - w * radial) * inv_norm,
        (d_x - x * radial) * inv_norm,
        (d_y - y * radial) * inv_norm,
        (d_z - z * radial) * inv_norm,
    ]
}
