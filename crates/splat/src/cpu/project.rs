//! From Gaussians to splats, many side by side, in f64 where a pixel's worth of f32 would show.

use pulp::{Simd, WithSimd};

use super::colour::Basis;
use super::narrowed;
use super::place::Places;
use super::shape::Shapes;
use super::splat::{HALF_LOG2_E, Splat};
use super::wide::{Row, SIDE_BY_SIDE, Wide, combine, cross, dot, load2, load3, splat3, store2, store3};
use crate::constants::{Extent, LARGEST_CHANNEL};
use crate::reach::reach;
use crate::view::Optics;
use crate::{Census, Gaussians, RasterMode, RenderOptions, View};
use glam::DVec2;

/// What one run of Gaussians gave, beside its splats.
#[derive(Debug, Default)]
pub(super) struct Run {
    pub(super) census: Census,
    /// Of each splat, in the list of Gaussians.
    pub(super) positions: Vec<u32>,
}

/// A view that is projected to, and where to.
pub(super) struct Target<'a> {
    pub(super) view: &'a View,
    pub(super) optics: &'a Optics,
    /// One per Gaussian of the run, of which those drawn fill the first.
    pub(super) splats: &'a mut [Splat],
    pub(super) run: &'a mut Run,
}

/// Projects a run of Gaussians to one view or several, working out once what they share.
pub(super) struct Project<'a, 'b> {
    pub(super) gaussians: &'a Gaussians,
    pub(super) options: &'a RenderOptions,
    /// Position of the run's first Gaussian.
    pub(super) first: usize,
    pub(super) past: usize,
    pub(super) targets: &'b mut [Target<'a>],
}

impl WithSimd for Project<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { gaussians, options, first, past, targets } = self;
        let parts = gaussians.parts();
        let (mut shapes, mut screen, mut basis) = (Shapes::default(), Screen::default(), Basis::new(parts, options));
        let mut places = Places::default();
        for target in &mut *targets {
            target.run.positions.clear();
            target.run.census = Census::default();
        }
        for first in (first..past).step_by(SIDE_BY_SIDE) {
            shapes.take(simd, parts, first, past);
            for target in &mut *targets {
                screen.project(simd, &shapes, target.optics, options);
                basis.look(simd, &shapes, target.optics, options.constants.sh_axes);
                places.find(simd, &screen, target.view, &options.constants);
                screen.deliver(gaussians, options, &shapes, &places, &basis, target);
            }
        }
    }
}

/// Gaussians side by side, on one screen.
#[derive(Debug)]
pub(super) struct Screen {
    pub(super) depth: Row,
    /// Projected centre in pixels.
    pub(super) centre: [Row; 2],
    /// Slopes `x/z` and `y/z`, as they are and where the Jacobian is taken.
    pub(super) slope: [[Row; 2]; 2],
    /// Pixels by slopes, row by row, and whether the lens sees the Gaussian; filled for lenses alone.
    pub(super) lens: [[Row; 2]; 2],
    pub(super) visible: [bool; SIDE_BY_SIDE],
    /// Covariance `xx, xy, yy` without the blur, and its determinant without and with it.
    pub(super) sharp: [Row; 3],
    pub(super) determinants: [Row; 2],
    pub(super) whitener: [Row; 3],
    /// After everything.
    pub(super) opacity: Row,
}

impl Default for Screen {
    fn default() -> Self {
        const ZERO: Row = [0.0; SIDE_BY_SIDE];
        Self {
            depth: ZERO,
            centre: [ZERO; 2],
            slope: [[ZERO; 2]; 2],
            lens: [[ZERO; 2]; 2],
            visible: [true; SIDE_BY_SIDE],
            sharp: [ZERO; 3],
            determinants: [ZERO; 2],
            whitener: [ZERO; 3],
            opacity: ZERO,
        }
    }
}

impl Screen {
    #[inline(always)]
    pub(super) fn project<S: Simd>(&mut self, simd: S, shapes: &Shapes, optics: &Optics, options: &RenderOptions) {
        for at in 0..SIDE_BY_SIDE / S::F64_LANES {
            self.look(simd, shapes, optics, at);
        }
        self.bend(optics);
        for at in 0..SIDE_BY_SIDE / S::F64_LANES {
            self.spread(simd, shapes, optics, options, at);
        }
    }

    /// Centres in the camera's frame.
    #[inline(always)]
    fn look<S: Simd>(&mut self, simd: S, shapes: &Shapes, optics: &Optics, at: usize) {
        let splat = |value| Wide::splat(simd, value);
        let mean = load3(simd, &shapes.mean, at);
        let [a, b, c] = optics.rotation.to_cols_array_2d();
        let axes = [splat3(simd, a), splat3(simd, b), splat3(simd, c)];
        let [x, y, z] = combine(axes, mean);
        let translation = splat3(simd, optics.translation.to_array());
        let (x, y, z) = (x + translation[0], y + translation[1], z + translation[2]);
        z.store(&mut self.depth, at);
        let near = splat(1.0) / z;
        let (x, y) = (x * near, y * near);
        let [low, high] = optics.jacobian_range;
        let within = [x.clamp(splat(low.x), splat(high.x)), y.clamp(splat(low.y), splat(high.y))];
        let [slopes, clamped] = &mut self.slope;
        store2([x, y], slopes, at);
        store2(within, clamped, at);
    }

    /// Centres on the screen, through the lens.
    #[inline(always)]
    fn bend(&mut self, optics: &Optics) {
        let (focal, principal) = (optics.focal, optics.principal);
        let Some(lens) = &optics.lens else {
            let focal_and_principal = [(focal.x, principal.x), (focal.y, principal.y)];
            for ((centres, slopes), (focal, principal)) in
                self.centre.iter_mut().zip(&self.slope[0]).zip(focal_and_principal)
            {
                for (centre, slope) in centres.iter_mut().zip(slopes) {
                    *centre = focal * slope + principal;
                }
            }
            return;
        };
        for lane in 0..SIDE_BY_SIDE {
            let [slope, within] = self.slope.each_ref().map(|rows| DVec2::new(rows[0][lane], rows[1][lane]));
            let seen = (lens.distorted_from_undistorted(slope), lens.jacobian(within));
            self.visible[lane] = seen.0.is_ok() && seen.1.is_ok();
            let (Ok(bent), Ok(jacobian)) = seen else { continue };
            let centre = focal * bent + principal;
            (self.centre[0][lane], self.centre[1][lane]) = (centre.x, centre.y);
            let [x, y] = [jacobian.x_axis * focal, jacobian.y_axis * focal];
            (self.lens[0][0][lane], self.lens[0][1][lane]) = (x.x, y.x);
            (self.lens[1][0][lane], self.lens[1][1][lane]) = (x.y, y.y);
        }
    }

    /// Rows of `∂pixel/∂slope` where the Jacobian is taken.
    #[inline(always)]
    pub(super) fn pixel_from_slope<S: Simd>(&self, simd: S, optics: &Optics, at: usize) -> [[Wide<S>; 2]; 2] {
        let splat = |value| Wide::splat(simd, value);
        if optics.lens.is_some() {
            let [x, y] = &self.lens;
            return [load2(simd, x, at), load2(simd, y, at)];
        }
        [[splat(optics.focal.x), splat(0.0)], [splat(0.0), splat(optics.focal.y)]]
    }

    /// Covariances on the screen, and what they make of opacity.
    #[inline(always)]
    fn spread<S: Simd>(&mut self, simd: S, shapes: &Shapes, optics: &Optics, options: &RenderOptions, at: usize) {
        let splat = |value| Wide::splat(simd, value);
        let constants = &options.constants;
        let depth = Wide::load(simd, &self.depth, at);
        let near = splat(1.0) / depth;
        let slope = load2(simd, &self.slope[1], at);
        let [x, y] = self.pixel_from_slope(simd, optics, at);
        let [first, second, third] = &shapes.axes;
        let axes = [load3(simd, first, at), load3(simd, second, at), load3(simd, third, at)];
        let u = against(axes, to_world(simd, optics, jacobian(x, slope, near)));
        let v = against(axes, to_world(simd, optics, jacobian(y, slope, near)));
        let (uu, uv, vv) = (dot(u, u), dot(u, v), dot(v, v));
        // |u|²|v|² − (u·v)² cancels for needles; the cross product does not.
        let across = cross(u, v);
        let sharp = dot(across, across);
        let blur = splat(constants.blur);
        let determinant = blur.mul_add(uu + vv + blur, sharp);
        let yy = vv + blur;
        let along = splat(HALF_LOG2_E) * (yy / determinant).sqrt();
        let narrow = splat(1.0) / yy;
        let mut opacity = Wide::load(simd, &shapes.opacity, at);
        if options.mode == RasterMode::Antialiased {
            let (ratio, least) = ((sharp / determinant).sqrt(), splat(constants.min_compensation));
            opacity = opacity * least.where_above(least, ratio, ratio);
        }
        store3([uu, uv, vv], &mut self.sharp, at);
        store2([sharp, determinant], &mut self.determinants, at);
        let shear = -(uv * narrow * along);
        store3([along, shear, splat(HALF_LOG2_E) * narrow.sqrt()], &mut self.whitener, at);
        opacity.store(&mut self.opacity, at);
    }

    /// Why a Gaussian is not drawn, or the pixels that it may reach.
    #[inline(always)]
    fn fate(&self, shapes: &Shapes, places: &Places, view: &View, options: &RenderOptions, lane: usize) -> Fate {
        let constants = &options.constants;
        let lane = lane % SIDE_BY_SIDE;
        if !shapes.usable[lane] {
            return Fate::Invalid;
        }
        if !constants.keeps_depth(self.depth[lane]) {
            return Fate::OutsideDepth;
        }
        if !self.visible[lane] {
            return Fate::OutsidePicture;
        }
        let centre = DVec2::new(self.centre[0][lane], self.centre[1][lane]);
        let determinant = self.determinants[1][lane];
        if !((determinant > 0.0) & determinant.is_finite() & centre.is_finite()) {
            return Fate::Invalid;
        }
        let opacity = self.opacity[lane];
        if !(opacity >= constants.min_alpha) {
            return Fate::Faint;
        }
        let (xx, yy) = (self.sharp[0][lane] + constants.blur, self.sharp[2][lane] + constants.blur);
        let reach = match constants.extent {
            Extent::Exact => places.range(self, lane),
            Extent::ThreeSigmaTiles => reach(centre, [xx, self.sharp[1][lane], yy], opacity, view.size, constants)
                .map(|reach| reach.map(|range| range.map(|pixel| u16::try_from(pixel).unwrap_or(u16::MAX)))),
        };
        reach.map_or(Fate::OutsidePicture, |reach| Fate::Drawn { reach })
    }

    #[inline(always)]
    fn deliver(
        &self,
        gaussians: &Gaussians,
        options: &RenderOptions,
        shapes: &Shapes,
        places: &Places,
        basis: &Basis,
        target: &mut Target<'_>,
    ) {
        let parts = gaussians.parts();
        let Run { census, positions } = &mut *target.run;
        for lane in 0..shapes.count {
            let position = shapes.first + lane;
            let lane = lane % SIDE_BY_SIDE;
            let reach = match self.fate(shapes, places, target.view, options, lane) {
                Fate::Drawn { reach } => reach,
                Fate::Invalid => {
                    census.invalid += 1;
                    continue;
                }
                Fate::OutsideDepth => {
                    census.outside_depth += 1;
                    continue;
                }
                Fate::Faint => {
                    census.faint += 1;
                    continue;
                }
                Fate::OutsidePicture => {
                    census.outside_picture += 1;
                    continue;
                }
            };
            let scalar = parts.scalars.as_ref().map_or(Some(0.0), |scalars| scalars.get(position).copied());
            let scalar = scalar.filter(|scalar| scalar.abs() <= narrowed(LARGEST_CHANNEL));
            let (Some(rgb), Some(scalar)) = (basis.colour(parts, position, lane), scalar) else {
                census.invalid += 1;
                continue;
            };
            if let Some(slot) = target.splats.get_mut(positions.len()) {
                *slot = Splat {
                    whitener: [0, 1, 2].map(|row: usize| narrowed(self.whitener[row][lane])),
                    shift: [0, 1].map(|axis: usize| narrowed(places.shift[axis][lane])),
                    base: [0, 1].map(|axis: usize| whole(places.base[axis][lane])),
                    opacity: narrowed(self.opacity[lane]),
                    rgb,
                    depth: narrowed(self.depth[lane]),
                    scalar,
                    // More than the logarithm's error, and than what rounding moves of the ellipse.
                    cut: places.cut[lane] * 1.001 + 0.001,
                    reach,
                };
            }
            positions.push(u32::try_from(position).unwrap_or(u32::MAX));
            census.drawn += 1;
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "within f32's whole numbers")]
#[inline(always)]
const fn whole(value: f64) -> i32 {
    value as i32
}

/// What becomes of a Gaussian.
pub(super) enum Fate {
    Drawn { reach: [[u16; 2]; 2] },
    Invalid,
    OutsideDepth,
    Faint,
    OutsidePicture,
}

/// A row of `∂pixel/∂(x, y, z)` of a point at `slope·z`: `A/z · [1 | −slope]`.
#[inline(always)]
pub(super) fn jacobian<S: Simd>(row: [Wide<S>; 2], slope: [Wide<S>; 2], near: Wide<S>) -> [Wide<S>; 3] {
    [row[0] * near, row[1] * near, -(row[0].mul_add(slope[0], row[1] * slope[1]) * near)]
}

/// What each of three vectors has of another.
#[inline(always)]
pub(super) fn against<S: Simd>(vectors: [[Wide<S>; 3]; 3], direction: [Wide<S>; 3]) -> [Wide<S>; 3] {
    [dot(vectors[0], direction), dot(vectors[1], direction), dot(vectors[2], direction)]
}

/// A direction in the camera's frame, in the world's.
#[inline(always)]
pub(super) fn to_world<S: Simd>(simd: S, optics: &Optics, direction: [Wide<S>; 3]) -> [Wide<S>; 3] {
    let [x, y, z] = optics.rotation.to_cols_array_2d();
    [dot(splat3(simd, x), direction), dot(splat3(simd, y), direction), dot(splat3(simd, z), direction)]
}
