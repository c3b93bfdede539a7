//! From sums over tiles to derivatives by Gaussians, one run of them after the other.

use pulp::{Simd, WithSimd};

use super::adjoint::{At, ByGaussian, BySplat};
use super::colour::Basis;
use super::differentiate::SUMS;
use super::narrowed;
use super::project::Screen;
use super::shape::Shapes;
use super::splat::Splat;
use super::wide::SIDE_BY_SIDE;
use crate::renderer::saturated;
use crate::view::Optics;
use crate::{Gaussians, Gradients, RenderOptions};

/// Sums over all tiles for one splat.
pub(super) type Totals = [f64; SUMS];

/// The derivatives by the Gaussians of one run.
#[derive(Debug, Default)]
pub(super) struct Rows<'a> {
    means: &'a mut [[f32; 3]],
    quaternions: &'a mut [[f32; 4]],
    log_scales: &'a mut [[f32; 3]],
    opacity_logits: &'a mut [f32],
    sh: &'a mut [[f32; 3]],
    scalars: &'a mut [f32],
    means_2d: &'a mut [[f32; 2]],
    conics: &'a mut [[f32; 3]],
}

impl<'a> Rows<'a> {
    /// Cuts derivatives into runs of `length` Gaussians.
    pub(super) fn of(gradients: &'a mut Gradients<f32>, length: usize, coefficients: usize) -> Vec<Self> {
        let mut scalars = gradients.scalars.chunks_mut(length);
        let shapes = gradients.quaternions.chunks_mut(length).zip(gradients.log_scales.chunks_mut(length));
        let colours = gradients.opacity_logits.chunks_mut(length).zip(gradients.sh.chunks_mut(length * coefficients));
        let screen = gradients.means_2d.chunks_mut(length).zip(gradients.conics.chunks_mut(length));
        let all = gradients.means.chunks_mut(length).zip(shapes).zip(colours).zip(screen);
        all.map(|(((means, (quaternions, log_scales)), (opacity_logits, sh)), (means_2d, conics))| Rows {
            means,
            quaternions,
            log_scales,
            opacity_logits,
            sh,
            scalars: scalars.next().unwrap_or_default(),
            means_2d,
            conics,
        })
        .collect()
    }

    /// Zero by everything: what is not drawn has no derivative.
    pub(super) fn clear(&mut self) {
        let Self { means, quaternions, log_scales, opacity_logits, sh, scalars, means_2d, conics } = self;
        means.as_flattened_mut().fill(0.0);
        quaternions.as_flattened_mut().fill(0.0);
        log_scales.as_flattened_mut().fill(0.0);
        opacity_logits.fill(0.0);
        sh.as_flattened_mut().fill(0.0);
        scalars.fill(0.0);
        means_2d.as_flattened_mut().fill(0.0);
        conics.as_flattened_mut().fill(0.0);
    }
}

/// Carries the derivatives by one run's splats to its Gaussians; returns each one's share of those by the pose.
pub(super) struct Carry<'a> {
    pub(super) gaussians: &'a Gaussians,
    pub(super) options: &'a RenderOptions,
    pub(super) optics: &'a Optics,
    /// Positions of the run's first Gaussian, and one past its last.
    pub(super) first: usize,
    pub(super) past: usize,
    /// Of the run's splats, which come in the same order.
    pub(super) positions: &'a [u32],
    pub(super) splats: &'a [Splat],
    pub(super) totals: &'a [Totals],
    pub(super) rows: Rows<'a>,
}

impl WithSimd for Carry<'_> {
    type Output = Vec<[f64; 6]>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<[f64; 6]> {
        let Self { gaussians, options, optics, first, past, positions, splats, totals, mut rows } = self;
        let parts = gaussians.parts();
        let (mut shapes, mut screen, mut basis) = (Shapes::default(), Screen::default(), Basis::new(parts, options));
        let (mut by_splat, mut by_gaussian) = (BySplat::default(), ByGaussian::default());
        let mut shares = Vec::with_capacity(positions.len());
        let mut drawn = positions.iter().zip(splats).zip(totals).peekable();
        for start in (first..past).step_by(SIDE_BY_SIDE) {
            let within = |position: u32| (position as usize) < start + SIDE_BY_SIDE;
            if drawn.peek().is_none_or(|((position, _), _)| !within(**position)) {
                continue;
            }
            shapes.take(simd, parts, start, past);
            screen.project(simd, &shapes, optics, options);
            basis.look(simd, &shapes, optics, options.constants.sh_axes);
            if !options.gradients.directions_stop {
                basis.slopes();
            }
            let mut lanes = [0usize; SIDE_BY_SIDE];
            let mut count = 0;
            while let Some(((position, splat), totals)) = drawn.next_if(|((position, _), _)| within(**position)) {
                let lane = (*position as usize - start) % SIDE_BY_SIDE;
                lanes[count % SIDE_BY_SIDE] = lane;
                count += 1;
                let row = start - first + lane;
                by_splat.put(lane, &screen, splat, totals);
                rows.put_splat(row, lane, &by_splat, totals);
                // Three times as much, more than a basis reaches, would still be an f32.
                let by_rgb = [6, 7, 8].map(|channel: usize| narrowed(totals[channel].clamp(-1e38, 1e38)));
                let stored = basis.stored();
                let sh = rows.sh.get_mut(row * stored..(row + 1) * stored).unwrap_or_default();
                let by_direction = basis.carry(parts, start + lane, lane, (splat.rgb, by_rgb), sh);
                for (slot, value) in by_splat.direction.iter_mut().zip(by_direction) {
                    slot[lane] = value;
                }
            }
            by_gaussian.take(simd, &At { shapes: &shapes, screen: &screen, optics, options }, &by_splat);
            for lane in lanes.into_iter().take(count) {
                rows.put_gaussian(start - first + lane, lane % SIDE_BY_SIDE, &by_gaussian);
                let [turn, shift] =
                    by_gaussian.pose.each_ref().map(|rows| rows.each_ref().map(|row| row[lane % SIDE_BY_SIDE]));
                shares.push([turn[0], turn[1], turn[2], shift[0], shift[1], shift[2]]);
            }
        }
        shares
    }
}

impl BySplat {
    /// Takes sums with distances from the base to ones from the centre.
    #[inline(always)]
    fn put(&mut self, lane: usize, screen: &Screen, splat: &Splat, totals: &Totals) {
        let lane = lane % SIDE_BY_SIDE;
        let [e, ex, ey, exx, exy, eyy, ..] = *totals;
        let x = f64::from(splat.base[0]) + 0.5 - screen.centre[0][lane];
        let y = f64::from(splat.base[1]) + 0.5 - screen.centre[1][lane];
        for (row, value) in self.first.iter_mut().zip([e, ex + x * e, ey + y * e]) {
            row[lane] = value;
        }
        let second = [exx + x * (2.0 * ex + x * e), exy + x * ey + y * (ex + x * e), eyy + y * (2.0 * ey + y * e)];
        for (row, value) in self.second.iter_mut().zip(second) {
            row[lane] = value;
        }
        self.depth[lane] = totals[9];
    }
}

impl Rows<'_> {
    #[inline(always)]
    fn put_splat(&mut self, row: usize, lane: usize, by_splat: &BySplat, totals: &Totals) {
        put(self.scalars, row, saturated(totals[10]));
        let [xx, xy, yy] = by_splat.second.each_ref().map(|values| values[lane % SIDE_BY_SIDE]);
        put(self.conics, row, [saturated(0.5 * xx), saturated(xy), saturated(0.5 * yy)]);
    }

    #[inline(always)]
    fn put_gaussian(&mut self, row: usize, lane: usize, by: &ByGaussian) {
        let lane = lane % SIDE_BY_SIDE;
        put(self.means, row, by.mean.each_ref().map(|values| saturated(values[lane])));
        put(self.quaternions, row, by.quaternion.each_ref().map(|values| saturated(values[lane])));
        put(self.log_scales, row, by.log_scales.each_ref().map(|values| saturated(values[lane])));
        put(self.opacity_logits, row, saturated(by.logit[lane]));
        put(self.means_2d, row, by.centre.each_ref().map(|values| saturated(values[lane])));
    }
}

#[inline(always)]
fn put<T>(values: &mut [T], at: usize, value: T) {
    if let Some(slot) = values.get_mut(at) {
        *slot = value;
    }
}
