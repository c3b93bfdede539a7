//! Projection of Gaussians to splats, in chunks; in f64, because f32 errors would be visible in pixels.

use bytemuck::Zeroable as _;
use pulp::{Simd, WithSimd};

use super::colour::Basis;
use super::footprint::Footprints;
use super::shape::Shapes;
use super::to_f32;
use super::wide::{CHUNK, Row, Wide, combine, cross, dot, load2, load3, splat3, store2, store3};
use crate::constants::{Extent, LARGEST_CHANNEL};
use crate::reach::reach;
use crate::rendering::Culled;
use crate::view::Optics;
use crate::{GaussianCounts, Gaussians, RasterMode, RenderOptions, View};
use glam::DVec2;

/// One projected Gaussian, in one cache line.
///
/// Pixel coordinates are relative to `base`, the pixel of the image nearest to the centre: such differences are integers,
/// exact in f32, so that a pixel's value does not depend on its tile.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(super) struct Splat {
    /// `√(½ log₂e)` times the Cholesky factor `(l₁₁, l₁₂, l₂₂)` of the inverse 2D covariance: the base-2 exponent is
    /// `−(l₁₁·dx + l₁₂·dy)² − (l₂₂·dy)²`. A sum of squares avoids cancellation for needle-shaped Gaussians.
    pub(super) whitener: [f32; 3],
    /// The vector from the centre to the base pixel, in whitened coordinates.
    pub(super) shift: [f32; 2],
    pub(super) base: [i32; 2],
    pub(super) opacity: f32,
    pub(super) rgb: [f32; 3],
    pub(super) depth: f32,
    pub(super) scalar: f32,
    /// Slightly more than `log₂(opacity / min_alpha)`: no pixel beyond this exponent is drawn.
    pub(super) cut: f32,
    /// Half-open range of columns, then rows, that it may reach.
    pub(super) reach: [[u16; 2]; 2],
}

/// Whether a splat with this whitener is a needle so slanted that from row to row its whitened coordinate along columns changes by
/// many times the other one: sums of `x²`, `xy` and `y²` in f32 would then cancel in its whitened coordinates.
#[inline(always)]
pub(super) const fn is_slanted([_, shear, down]: [f32; 3]) -> bool {
    // Up to there, cancellation loses less than three digits.
    const MANY: f32 = 8.0;
    shear.abs() > MANY * down
}

/// `√(½ log₂e)`.
pub(super) const HALF_LOG2_E: f64 = 0.849_321_800_288_019;

/// Results of projecting one run of Gaussians, apart from its splats.
#[derive(Debug, Default)]
pub(super) struct Run {
    pub(super) counts: GaussianCounts,
    /// Index of each splat's Gaussian.
    pub(super) positions: Vec<u32>,
}

/// A view to project to, and its output.
pub(super) struct Target<'a> {
    pub(super) view: &'a View,
    pub(super) optics: &'a Optics,
    /// One slot per Gaussian of the run; the drawn ones fill the first slots.
    pub(super) splats: &'a mut [Splat],
    pub(super) run: &'a mut Run,
}

/// Projects a run of Gaussians to one or several views, doing camera-independent work once.
pub(super) struct Project<'a, 'b> {
    pub(super) gaussians: &'a Gaussians,
    pub(super) options: &'a RenderOptions,
    /// Index of the run's first Gaussian.
    pub(super) first: usize,
    pub(super) end: usize,
    pub(super) targets: &'b mut [Target<'a>],
}

impl WithSimd for Project<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { gaussians, options, first, end, targets } = self;
        let parts = gaussians.parts();
        let (mut shapes, mut screen, mut basis) = (Shapes::default(), Screen::default(), Basis::new(parts, options));
        let mut footprints = Footprints::zeroed();
        for target in &mut *targets {
            target.run.positions.clear();
            target.run.counts = GaussianCounts::default();
        }
        for first in (first..end).step_by(CHUNK) {
            shapes.load(simd, parts, first, end);
            for target in &mut *targets {
                screen.project(simd, &shapes, target.optics, options);
                basis.evaluate(simd, &shapes, target.optics, options.constants.sh_axes);
                footprints.compute(simd, &screen, target.view, &options.constants);
                screen.emit(gaussians, options, &shapes, &footprints, &basis, target);
            }
        }
    }
}

/// A chunk of Gaussians, projected to one view.
#[derive(Debug)]
pub(super) struct Screen {
    pub(super) depth: Row,
    /// Projected centre in pixels.
    pub(super) centre: [Row; 2],
    /// Slopes `x/z` and `y/z`: true, and clamped for the Jacobian.
    pub(super) slope: [[Row; 2]; 2],
    /// `∂pixel/∂slope` row by row; filled only with a lens.
    pub(super) lens: [[Row; 2]; 2],
    /// Whether the lens sees the Gaussian.
    pub(super) visible: [bool; CHUNK],
    /// 2D covariance `xx, xy, yy` without the blur, and its determinants without and with it.
    pub(super) cov2d: [Row; 3],
    pub(super) determinants: [Row; 2],
    pub(super) whitener: [Row; 3],
    /// After the sigmoid, the 3D filter and anti-aliasing.
    pub(super) opacity: Row,
}

impl Default for Screen {
    fn default() -> Self {
        const ZERO: Row = [0.0; CHUNK];
        Self {
            depth: ZERO,
            centre: [ZERO; 2],
            slope: [[ZERO; 2]; 2],
            lens: [[ZERO; 2]; 2],
            visible: [true; CHUNK],
            cov2d: [ZERO; 3],
            determinants: [ZERO; 2],
            whitener: [ZERO; 3],
            opacity: ZERO,
        }
    }
}

impl Screen {
    #[inline(always)]
    pub(super) fn project<S: Simd>(&mut self, simd: S, shapes: &Shapes, optics: &Optics, options: &RenderOptions) {
        for vector in 0..CHUNK / S::F64_LANES {
            self.transform_means(simd, shapes, optics, vector);
        }
        self.project_means(optics);
        for vector in 0..CHUNK / S::F64_LANES {
            self.project_covariances(simd, shapes, optics, options, vector);
        }
    }

    /// Transforms means to camera coordinates.
    #[inline(always)]
    fn transform_means<S: Simd>(&mut self, simd: S, shapes: &Shapes, optics: &Optics, vector: usize) {
        let splat = |value| Wide::splat(simd, value);
        let mean = load3(simd, &shapes.mean, vector);
        let [a, b, c] = optics.rotation.to_cols_array_2d();
        let axes = [splat3(simd, a), splat3(simd, b), splat3(simd, c)];
        let [x, y, z] = combine(axes, mean);
        let translation = splat3(simd, optics.translation.to_array());
        let (x, y, z) = (x + translation[0], y + translation[1], z + translation[2]);
        z.store(&mut self.depth, vector);
        let inv_depth = splat(1.0) / z;
        let (x, y) = (x * inv_depth, y * inv_depth);
        let [low, high] = optics.jacobian_range;
        let clamped_slope = [x.clamp(splat(low.x), splat(high.x)), y.clamp(splat(low.y), splat(high.y))];
        let [slopes, clamped] = &mut self.slope;
        store2([x, y], slopes, vector);
        store2(clamped_slope, clamped, vector);
    }

    /// Projects means to pixels, through the lens.
    #[inline(always)]
    fn project_means(&mut self, optics: &Optics) {
        let (focal, principal) = (optics.focal, optics.principal);
        let Some(lens) = &optics.lens else {
            // The view before may have had a lens.
            self.visible = [true; CHUNK];
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
        for lane in 0..CHUNK {
            let [slope, clamped_slope] = self.slope.each_ref().map(|rows| DVec2::new(rows[0][lane], rows[1][lane]));
            let mapped = (lens.distorted_from_undistorted(slope), lens.jacobian(clamped_slope));
            self.visible[lane] = mapped.0.is_ok() && mapped.1.is_ok();
            let (Ok(distorted), Ok(jacobian)) = mapped else { continue };
            let centre = focal * distorted + principal;
            (self.centre[0][lane], self.centre[1][lane]) = (centre.x, centre.y);
            let [x, y] = [jacobian.x_axis * focal, jacobian.y_axis * focal];
            (self.lens[0][0][lane], self.lens[0][1][lane]) = (x.x, y.x);
            (self.lens[1][0][lane], self.lens[1][1][lane]) = (x.y, y.y);
        }
    }

    /// Rows of `∂pixel/∂slope` at the clamped slope.
    #[inline(always)]
    pub(super) fn pixel_from_slope<S: Simd>(&self, simd: S, optics: &Optics, vector: usize) -> [[Wide<S>; 2]; 2] {
        let splat = |value| Wide::splat(simd, value);
        if optics.lens.is_some() {
            let [x, y] = &self.lens;
            return [load2(simd, x, vector), load2(simd, y, vector)];
        }
        [[splat(optics.focal.x), splat(0.0)], [splat(0.0), splat(optics.focal.y)]]
    }

    /// Projects covariances to 2D, and compensates opacities.
    #[inline(always)]
    fn project_covariances<S: Simd>(
        &mut self,
        simd: S,
        shapes: &Shapes,
        optics: &Optics,
        options: &RenderOptions,
        vector: usize,
    ) {
        let splat = |value| Wide::splat(simd, value);
        let constants = &options.constants;
        let depth = Wide::load(simd, &self.depth, vector);
        let inv_depth = splat(1.0) / depth;
        let slope = load2(simd, &self.slope[1], vector);
        let [x, y] = self.pixel_from_slope(simd, optics, vector);
        let [first, second, third] = &shapes.axes;
        let axes = [load3(simd, first, vector), load3(simd, second, vector), load3(simd, third, vector)];
        let u = dot_each(axes, to_world(simd, optics, jacobian(x, slope, inv_depth)));
        let v = dot_each(axes, to_world(simd, optics, jacobian(y, slope, inv_depth)));
        let (uu, uv, vv) = (dot(u, u), dot(u, v), dot(v, v));
        // |u|²|v|² − (u·v)² cancels for needle-shaped Gaussians; the cross product does not.
        let across = cross(u, v);
        let inner = dot(across, across);
        let blur = splat(constants.blur);
        let determinant = blur.mul_add(uu + vv + blur, inner);
        let yy = vv + blur;
        let along = splat(HALF_LOG2_E) * (yy / determinant).sqrt();
        let narrow = splat(1.0) / yy;
        let mut opacity = Wide::load(simd, &shapes.opacity, vector);
        if options.mode == RasterMode::Antialiased {
            let (ratio, least) = ((inner / determinant).sqrt(), splat(constants.min_compensation));
            opacity = opacity * least.where_above(least, ratio, ratio);
        }
        store3([uu, uv, vv], &mut self.cov2d, vector);
        store2([inner, determinant], &mut self.determinants, vector);
        let shear = -(uv * narrow * along);
        store3([along, shear, splat(HALF_LOG2_E) * narrow.sqrt()], &mut self.whitener, vector);
        opacity.store(&mut self.opacity, vector);
    }

    /// The pixels that a Gaussian may reach, or why it is culled.
    #[inline(always)]
    fn visible_range(
        &self,
        shapes: &Shapes,
        footprints: &Footprints,
        view: &View,
        options: &RenderOptions,
        lane: usize,
    ) -> Result<[[u16; 2]; 2], Culled> {
        let constants = &options.constants;
        let lane = lane % CHUNK;
        if !shapes.valid[lane] {
            return Err(Culled::Invalid);
        }
        if !constants.keeps_depth(self.depth[lane]) {
            return Err(Culled::OutsideDepth);
        }
        if !self.visible[lane] {
            return Err(Culled::OutsideImage);
        }
        let centre = DVec2::new(self.centre[0][lane], self.centre[1][lane]);
        let determinant = self.determinants[1][lane];
        if !((determinant > 0.0) & determinant.is_finite() & centre.is_finite()) {
            return Err(Culled::Invalid);
        }
        let opacity = self.opacity[lane];
        if !(opacity >= constants.min_alpha) {
            return Err(Culled::Faint);
        }
        let (xx, yy) = (self.cov2d[0][lane] + constants.blur, self.cov2d[2][lane] + constants.blur);
        #[expect(clippy::cast_possible_truncation, reason = "an image side fits 16 bits")]
        let reach = match constants.extent {
            Extent::Exact => footprints.range(self, lane),
            Extent::ThreeSigmaTiles => reach(centre, [xx, self.cov2d[1][lane], yy], opacity, view.size, constants)
                .map(|reach| reach.map(|range| range.map(|pixel| pixel as u16))),
        };
        reach.ok_or(Culled::OutsideImage)
    }

    #[inline(always)]
    fn emit(
        &self,
        gaussians: &Gaussians,
        options: &RenderOptions,
        shapes: &Shapes,
        footprints: &Footprints,
        basis: &Basis,
        target: &mut Target<'_>,
    ) {
        let parts = gaussians.parts();
        let packed = options.harmonics.as_deref();
        let Run { counts, positions } = &mut *target.run;
        for lane in 0..shapes.count {
            let position = shapes.first + lane;
            let lane = lane % CHUNK;
            let reach = match self.visible_range(shapes, footprints, target.view, options, lane) {
                Ok(reach) => reach,
                Err(culled) => {
                    counts.count(culled);
                    continue;
                }
            };
            let scalar = parts.scalars.as_ref().map_or(Some(0.0), |scalars| scalars.get(position).copied());
            let scalar = scalar.filter(|scalar| scalar.abs() <= to_f32(LARGEST_CHANNEL));
            let (Some(rgb), Some(scalar)) = (basis.colour(parts, packed, position, lane), scalar) else {
                counts.invalid += 1;
                continue;
            };
            target.splats[positions.len()] = Splat {
                whitener: [0, 1, 2].map(|row: usize| to_f32(self.whitener[row][lane])),
                shift: [0, 1].map(|axis: usize| to_f32(footprints.shift[axis][lane])),
                base: [0, 1].map(|axis: usize| truncate(footprints.base[axis][lane])),
                opacity: to_f32(self.opacity[lane]),
                rgb,
                depth: to_f32(self.depth[lane]),
                scalar,
                // The margin exceeds the error of the logarithm and the rounding of the ellipse.
                cut: footprints.cut[lane] * 1.001 + 0.001,
                reach,
            };
            #[expect(clippy::cast_possible_truncation, reason = "renderers reject more Gaussians than a u32 counts")]
            positions.push(position as u32);
            counts.drawn += 1;
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "within the integers of f32")]
#[inline(always)]
const fn truncate(value: f64) -> i32 {
    value as i32
}

/// A row of `∂pixel/∂(x, y, z)` at a point `slope·z`: `A/z · [1 | −slope]`.
#[inline(always)]
pub(super) fn jacobian<S: Simd>(row: [Wide<S>; 2], slope: [Wide<S>; 2], inv_depth: Wide<S>) -> [Wide<S>; 3] {
    [row[0] * inv_depth, row[1] * inv_depth, -(row[0].mul_add(slope[0], row[1] * slope[1]) * inv_depth)]
}

/// Dot products of three vectors with a direction.
#[inline(always)]
pub(super) fn dot_each<S: Simd>(vectors: [[Wide<S>; 3]; 3], direction: [Wide<S>; 3]) -> [Wide<S>; 3] {
    [dot(vectors[0], direction), dot(vectors[1], direction), dot(vectors[2], direction)]
}

/// Rotates a direction from camera to world coordinates.
#[inline(always)]
pub(super) fn to_world<S: Simd>(simd: S, optics: &Optics, direction: [Wide<S>; 3]) -> [Wide<S>; 3] {
    let [x, y, z] = optics.rotation.to_cols_array_2d();
    [dot(splat3(simd, x), direction), dot(splat3(simd, y), direction), dot(splat3(simd, z), direction)]
}
