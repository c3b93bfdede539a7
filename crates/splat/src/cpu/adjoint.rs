//! The derivative of projecting, many Gaussians side by side: what splats got is carried to what made them.

use pulp::Simd;

use super::colour::away;
use super::project::{Screen, against, jacobian, to_world};
use super::shape::{Shapes, rotation};
use super::wide::{Row, SIDE_BY_SIDE, Wide, combine, cross, dot, load2, load3, splat3, store2, store3};
use crate::constants::{ClampedGradient, ShAxes};
use crate::reference::project_backward::through_lens;
use crate::view::Optics;
use crate::{RasterMode, RenderOptions};
use glam::DVec2;

/// Derivatives of the loss by splats, side by side.
#[derive(Debug)]
pub(super) struct BySplat {
    /// Sums over pixels, see [`super::differentiate::SUMS`], with distances from the centre: `e, ex, ey`.
    pub(super) first: [Row; 3],
    /// `exx, exy, eyy`.
    pub(super) second: [Row; 3],
    pub(super) depth: Row,
    /// By the direction that the colour is seen in.
    pub(super) direction: [Row; 3],
}

/// Derivatives by what Gaussians are made of, side by side.
#[derive(Debug)]
pub(super) struct ByGaussian {
    pub(super) mean: [Row; 3],
    pub(super) quaternion: [Row; 4],
    pub(super) log_scales: [Row; 3],
    pub(super) logit: Row,
    pub(super) centre: [Row; 2],
    /// Rotation, then translation.
    pub(super) pose: [[Row; 3]; 2],
    /// By the Jacobian's rows, for lenses.
    by_jacobian: [[Row; 3]; 2],
    /// What lenses add by the slope where the Jacobian is taken, and their own Jacobian at the centre's.
    by_slope: [Row; 2],
    there: [[Row; 2]; 2],
}

const ZERO: Row = [0.0; SIDE_BY_SIDE];

impl Default for BySplat {
    fn default() -> Self {
        Self { first: [ZERO; 3], second: [ZERO; 3], depth: ZERO, direction: [ZERO; 3] }
    }
}

impl Default for ByGaussian {
    fn default() -> Self {
        Self {
            mean: [ZERO; 3],
            quaternion: [ZERO; 4],
            log_scales: [ZERO; 3],
            logit: ZERO,
            centre: [ZERO; 2],
            pose: [[ZERO; 3]; 2],
            by_jacobian: [[ZERO; 3]; 2],
            by_slope: [ZERO; 2],
            there: [[ZERO; 2]; 2],
        }
    }
}

/// Everything that the derivative is taken at.
pub(super) struct At<'a> {
    pub(super) shapes: &'a Shapes,
    pub(super) screen: &'a Screen,
    pub(super) optics: &'a Optics,
    pub(super) options: &'a RenderOptions,
}

impl ByGaussian {
    #[inline(always)]
    pub(super) fn take<S: Simd>(&mut self, simd: S, at: &At<'_>, by_splat: &BySplat) {
        for vector in 0..SIDE_BY_SIDE / S::F64_LANES {
            self.through_covariance(simd, at, by_splat, vector);
        }
        if at.optics.lens.is_some() {
            self.through_lens(at);
        }
        for vector in 0..SIDE_BY_SIDE / S::F64_LANES {
            self.through_projection(simd, at, by_splat, vector);
        }
    }

    /// Splat → opacity and covariance on the screen → axes, scales and Jacobian.
    #[inline(always)]
    fn through_covariance<S: Simd>(&mut self, simd: S, at: &At<'_>, by_splat: &BySplat, vector: usize) {
        let At { shapes, screen, optics, options } = *at;
        let splat = |value| Wide::splat(simd, value);
        let one = splat(1.0);
        let [e, ex, ey] = load3(simd, &by_splat.first, vector);
        let [exx, exy, eyy] = load3(simd, &by_splat.second, vector);
        let [uu, uv, vv] = load3(simd, &screen.sharp, vector);
        let [inner, outer] = load2(simd, &screen.determinants, vector);
        let blur = splat(options.constants.blur);
        let (xx, yy) = (uu + blur, vv + blur);
        // The conic is the inverse of [xx, uv; uv, yy].
        let per = one / outer;
        let (a, b, c) = (yy * per, -(uv * per), xx * per);
        store2([-a.mul_add(ex, b * ey), -b.mul_add(ex, c * ey)], &mut self.centre, vector);

        // By the covariance: −½ Σ⁻¹ [exx, exy; exy, eyy] Σ⁻¹.
        let (p, q) = (a.mul_add(exx, b * exy), a.mul_add(exy, b * eyy));
        let (r, s) = (b.mul_add(exx, c * exy), b.mul_add(exy, c * eyy));
        let half = splat(-0.5);
        let mut by_xx = half * p.mul_add(a, q * b);
        let mut by_xy = half * p.mul_add(b, q * c);
        let mut by_yy = half * r.mul_add(b, s * c);
        if options.mode == RasterMode::Antialiased {
            // −½ e (Σ⁻¹ − Σ'⁻¹) without the blur and with it, where compensation is not held at its least.
            let (least, zero) = (splat(options.constants.min_compensation), splat(0.0));
            let share = inner / outer;
            let per_share = e * half / share;
            let of = |sharp: Wide<S>, blurred: Wide<S>| {
                let slope = (sharp * per - blurred * per * share) * per_share;
                slope.where_above(share.sqrt(), least, zero)
            };
            by_xx = by_xx + of(vv, yy);
            by_xy = by_xy - of(uv, uv);
            by_yy = by_yy + of(uu, xx);
        }

        // Σ = V Vᵀ with V = J W R S.
        let near = one / Wide::load(simd, &screen.depth, vector);
        let slope = load2(simd, &screen.slope[1], vector);
        let [row_x, row_y] = screen.pixel_from_slope(simd, optics, vector);
        let worlds = [
            to_world(simd, optics, jacobian(row_x, slope, near)),
            to_world(simd, optics, jacobian(row_y, slope, near)),
        ];
        let [first, second, third] = &shapes.axes;
        let axes = [load3(simd, first, vector), load3(simd, second, vector), load3(simd, third, vector)];
        let (u, v) = (against(axes, worlds[0]), against(axes, worlds[1]));
        let two = splat(2.0);
        let (by_xx, by_xy, by_yy) = (by_xx * two, by_xy * two, by_yy * two);
        let by_u = blend([u, v], [by_xx, by_xy]);
        let by_v = blend([u, v], [by_xy, by_yy]);

        let [w, x, y, z] = &shapes.quaternion;
        let quaternion = [
            Wide::load(simd, w, vector),
            Wide::load(simd, x, vector),
            Wide::load(simd, y, vector),
            Wide::load(simd, z, vector),
        ];
        let turned = rotation(quaternion);
        let scales = load3(simd, &shapes.scales, vector);
        let shares = load3(simd, &shapes.own_share, vector);
        let mut by_rotation = [[e; 3]; 3];
        let mut by_logs = [e; 3];
        for axis in 0..3 {
            let [x, y, z] = blend(worlds, [by_u[axis], by_v[axis]]);
            let scale = scales[axis];
            by_rotation[axis] = [x * scale, y * scale, z * scale];
            // With a filter f, the scale drawn is √(s² + f²), which grows with log s by s²/√(s² + f²); opacity
            // grows by 1 − s²/(s² + f²).
            let by_scale = dot(turned[axis], by_rotation[axis]) * shares[axis];
            by_logs[axis] = by_scale - e * (one - shares[axis]);
        }
        store3(by_logs, &mut self.log_scales, vector);
        let [w, x, y, z] = by_quaternion(quaternion, by_rotation);
        for (row, value) in self.quaternion.iter_mut().zip([w, x, y, z]) {
            value.store(row, vector);
        }
        let rest = Wide::load(simd, &shapes.odds, vector) * Wide::load(simd, &shapes.sigmoid, vector);
        (-(e * rest)).store(&mut self.logit, vector);

        let columns = optics.rotation.transpose().to_cols_array_2d();
        let camera = [splat3(simd, columns[0]), splat3(simd, columns[1]), splat3(simd, columns[2])];
        let [by_x, by_y] = &mut self.by_jacobian;
        store3(against(camera, combine(axes, by_u)), by_x, vector);
        store3(against(camera, combine(axes, by_v)), by_y, vector);
    }

    /// How the lens's own Jacobian changes with the slope, lane by lane.
    #[inline(always)]
    fn through_lens(&mut self, at: &At<'_>) {
        let At { screen, optics, .. } = *at;
        let Some(lens) = &optics.lens else { return };
        for lane in 0..SIDE_BY_SIDE {
            let [slope, within] = [0, 1].map(|of| DVec2::new(screen.slope[of][0][lane], screen.slope[of][1][lane]));
            let rows = [0, 1].map(|row| {
                let by = &self.by_jacobian[row];
                (DVec2::new(by[0][lane], by[1][lane]) - within * by[2][lane]) / screen.depth[lane]
            });
            let more = through_lens(lens, within, optics.focal, rows);
            (self.by_slope[0][lane], self.by_slope[1][lane]) = (more.x, more.y);
            let there = lens.jacobian(slope).unwrap_or(glam::DMat2::ZERO);
            let [x, y] = [there.x_axis * optics.focal, there.y_axis * optics.focal];
            (self.there[0][0][lane], self.there[0][1][lane]) = (x.x, y.x);
            (self.there[1][0][lane], self.there[1][1][lane]) = (x.y, y.y);
        }
    }

    /// Centre, depth, Jacobian and the colour's direction → mean and pose.
    #[inline(always)]
    fn through_projection<S: Simd>(&mut self, simd: S, at: &At<'_>, by_splat: &BySplat, vector: usize) {
        let At { screen, optics, options, .. } = *at;
        let splat = |value| Wide::splat(simd, value);
        let zero = splat(0.0);
        let depth = Wide::load(simd, &screen.depth, vector);
        let near = splat(1.0) / depth;
        let [slopes, within] = &screen.slope;
        let (true_slope, slope) = (load2(simd, slopes, vector), load2(simd, within, vector));
        let by_centre = load2(simd, &self.centre, vector);
        let [there_x, there_y] = match &optics.lens {
            None => [[splat(optics.focal.x), zero], [zero, splat(optics.focal.y)]],
            Some(_) => [load2(simd, &self.there[0], vector), load2(simd, &self.there[1], vector)],
        };
        let by_true = [
            there_x[0].mul_add(by_centre[0], there_y[0] * by_centre[1]) * near,
            there_x[1].mul_add(by_centre[0], there_y[1] * by_centre[1]) * near,
        ];
        let mut own = [by_true[0], by_true[1], Wide::load(simd, &by_splat.depth, vector)];
        own[2] = own[2] - by_true[0].mul_add(true_slope[0], by_true[1] * true_slope[1]);

        // J = A/z · [1 | −slope]
        let rows = screen.pixel_from_slope(simd, optics, vector);
        let jacobians = [jacobian(rows[0], slope, near), jacobian(rows[1], slope, near)];
        let by_rows = [load3(simd, &self.by_jacobian[0], vector), load3(simd, &self.by_jacobian[1], vector)];
        own[2] = own[2] - (dot(by_rows[0], jacobians[0]) + dot(by_rows[1], jacobians[1])) * near;
        for axis in 0..2 {
            let mut by_slope = -(rows[0][axis].mul_add(by_rows[0][2], rows[1][axis] * by_rows[1][2]) * near);
            if optics.lens.is_some() {
                by_slope = by_slope + Wide::load(simd, &self.by_slope[axis], vector);
            }
            let by_slope = by_slope * near;
            let free = by_slope.where_equal(true_slope[axis], slope[axis], zero);
            own[axis] = own[axis] + free;
            own[2] = own[2] - free * true_slope[axis];
            if options.constants.clamped_gradient == ClampedGradient::Inria {
                own[2] = own[2] - (by_slope - free) * slope[axis];
            }
        }

        let by_colour = through_direction(simd, at, by_splat, vector);
        let rotation = optics.rotation.to_cols_array_2d();
        let camera = [splat3(simd, rotation[0]), splat3(simd, rotation[1]), splat3(simd, rotation[2])];
        let by_mean = against(camera, own);
        store3(sum(by_mean, by_colour), &mut self.mean, vector);

        // The colour's direction runs from the camera's centre, −Rᵀt, to the mean.
        let in_camera = [true_slope[0] * depth, true_slope[1] * depth, depth];
        let turning = sum(cross(by_rows[0], jacobians[0]), cross(by_rows[1], jacobians[1]));
        let [turn, shift] = &mut self.pose;
        store3(sum(cross(in_camera, own), turning), turn, vector);
        store3(sum(own, combine(camera, by_colour)), shift, vector);
    }
}

/// What the mean gets through the direction that the colour is seen in: what is tangential, per distance.
#[inline(always)]
fn through_direction<S: Simd>(simd: S, at: &At<'_>, by_splat: &BySplat, vector: usize) -> [Wide<S>; 3] {
    let by = load3(simd, &by_splat.direction, vector);
    let by = match at.options.constants.sh_axes {
        ShAxes::Standard => by,
        ShAxes::E3nn => [by[1], by[2], by[0]],
    };
    let (unit, distance) = away(simd, at.shapes, at.optics, vector);
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
fn blend<S: Simd>([a, b]: [[Wide<S>; 3]; 2], [p, q]: [Wide<S>; 2]) -> [Wide<S>; 3] {
    [a[0].mul_add(p, b[0] * q), a[1].mul_add(p, b[1] * q), a[2].mul_add(p, b[2] * q)]
}

/// Derivative by a quaternion `w, x, y, z` that is normalised before it becomes a rotation, of which `g` has the
/// columns' derivatives.
#[inline(always)]
fn by_quaternion<S: Simd>([w, x, y, z]: [Wide<S>; 4], g: [[Wide<S>; 3]; 3]) -> [Wide<S>; 4] {
    let per = w.of(1.0) / w.mul_add(w, x.mul_add(x, y.mul_add(y, z * z))).sqrt();
    let (w, x, y, z) = (w * per, x * per, y * per, z * per);
    let two = w.of(2.0);
    // g[column][row]
    let (turn_x, turn_y, turn_z) = (g[1][2] - g[2][1], g[2][0] - g[0][2], g[0][1] - g[1][0]);
    let (even_xy, even_xz, even_yz) = (g[1][0] + g[0][1], g[2][0] + g[0][2], g[2][1] + g[1][2]);
    let by_w = dot([x, y, z], [turn_x, turn_y, turn_z]) * two;
    let by_x = (dot([w, y, z], [turn_x, even_xy, even_xz]) - two * x * (g[1][1] + g[2][2])) * two;
    let by_y = (dot([w, x, z], [turn_y, even_xy, even_yz]) - two * y * (g[0][0] + g[2][2])) * two;
    let by_z = (dot([w, x, y], [turn_z, even_xz, even_yz]) - two * z * (g[0][0] + g[1][1])) * two;
    let radial = w.mul_add(by_w, dot([x, y, z], [by_x, by_y, by_z]));
    [(by_w - w * radial) * per, (by_x - x * radial) * per, (by_y - y * radial) * per, (by_z - z * radial) * per]
}
