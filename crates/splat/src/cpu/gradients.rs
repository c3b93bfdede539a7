//! From sums over tiles to gradients of the Gaussians, run by run.

use bytemuck::Zeroable as _;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::bins::RUN;
use super::colour::Basis;
use super::frame::Frame;
use super::pixel_sums::{ABSOLUTE, ABSOLUTE_UNIT, DEPTH, RGB, SCALAR, SUMS};
use super::project::{Screen, Splat, is_slanted};
use super::project_backward::{ForwardState, GaussianGradients, SplatGradients};
use super::shape::Shapes;
use super::wide::CHUNK;
use super::{SimdLevel, to_f32};
use crate::renderer::saturated;
use crate::view::Optics;
use crate::{Gaussians, Gradients, RenderOptions, sh_coefficients};

/// Backward pass from sums over tiles to all Gaussians.
pub(super) struct BackwardOverRuns<'a> {
    pub(super) gaussians: &'a Gaussians,
    pub(super) options: &'a RenderOptions,
    pub(super) optics: &'a Optics,
    pub(super) simd: SimdLevel,
    pub(super) frame: &'a Frame,
    /// One per entry of the tiles' lists, divided by `unit`.
    pub(super) sums: &'a [[f32; SUMS]],
    /// Offsets in `sums` of each run's entries within each tile, run by run.
    pub(super) offsets: &'a [usize],
    pub(super) unit: f64,
}

/// Sums over all tiles for one splat.
type Totals = [f64; SUMS];

impl BackwardOverRuns<'_> {
    /// Sets the gradients of all Gaussians, absolute ones too unless `absolute_2d` is empty; returns the gradient of the pose.
    pub(super) fn differentiate(&self, gradients: &mut Gradients<f32>, absolute_2d: &mut [[f32; 2]]) -> [f64; 6] {
        let rows = Rows::of_runs(gradients, absolute_2d, sh_coefficients(self.gaussians.sh_degree()));
        let contributions: Vec<Vec<[f64; 6]>> = rows
            .into_par_iter()
            .enumerate()
            .map_init(Vec::new, |totals: &mut Vec<Totals>, (run, rows)| self.differentiate_run(run, rows, totals))
            .collect();
        // Summed in order over the drawn Gaussians only, so that run boundaries and culled Gaussians do not matter.
        let mut pose = [0.0; 6];
        for contribution in contributions.into_iter().flatten() {
            for (sum, value) in pose.iter_mut().zip(contribution) {
                *sum += value;
            }
        }
        pose
    }

    /// Sets the gradients of a run's Gaussians; returns the contributions of the drawn ones to the pose gradient.
    fn differentiate_run(&self, run: usize, mut rows: Rows<'_>, totals: &mut Vec<Totals>) -> Vec<[f64; 6]> {
        let Self { gaussians, options, optics, frame, .. } = *self;
        let first = run * RUN;
        let end = if first + RUN < gaussians.len() { first + RUN } else { gaussians.len() };
        let positions = frame.runs[run].positions.as_slice();
        rows.clear();
        self.sum_over_tiles(run, totals);
        rows.take_absolute(first, positions, totals);
        let splats = &frame.splats[first..end];
        self.simd.dispatch(ProjectBackward { gaussians, options, optics, first, end, positions, splats, totals, rows })
    }

    /// Sums over all tiles for each splat of a run.
    fn sum_over_tiles(&self, run: usize, totals: &mut Vec<Totals>) {
        let Self { frame, sums, offsets, unit, .. } = *self;
        let (bins, first, tiles) = (&frame.bins[run], run * RUN, frame.tiling().len());
        totals.clear();
        totals.resize(frame.runs[run].positions.len(), [0.0; SUMS]);
        for tile in 0..tiles {
            let list = bins.list(tile);
            let from = offsets[run * tiles + tile];
            for (entry, sums) in list.iter().zip(&sums[from..]) {
                for (total, sum) in totals[entry.splat as usize - first].iter_mut().zip(sums) {
                    *total += f64::from(*sum);
                }
            }
        }
        totals.as_flattened_mut().iter_mut().for_each(|total| *total *= unit);
    }
}

/// The gradients of one run's Gaussians.
#[derive(Debug, Default)]
struct Rows<'a> {
    means: &'a mut [[f32; 3]],
    quaternions: &'a mut [[f32; 4]],
    log_scales: &'a mut [[f32; 3]],
    opacity_logits: &'a mut [f32],
    sh: &'a mut [[f32; 3]],
    scalars: &'a mut [f32],
    means_2d: &'a mut [[f32; 2]],
    conics: &'a mut [[f32; 3]],
    /// Empty unless asked for.
    absolute_2d: &'a mut [[f32; 2]],
}

impl<'a> Rows<'a> {
    /// Splits gradients into those of each run.
    fn of_runs(gradients: &'a mut Gradients<f32>, absolute_2d: &'a mut [[f32; 2]], coefficients: usize) -> Vec<Self> {
        let (mut scalars, mut absolute_2d) = (gradients.scalars.chunks_mut(RUN), absolute_2d.chunks_mut(RUN));
        let shapes = gradients.quaternions.chunks_mut(RUN).zip(gradients.log_scales.chunks_mut(RUN));
        let colours = gradients.opacity_logits.chunks_mut(RUN).zip(gradients.sh.chunks_mut(RUN * coefficients));
        let screen = gradients.means_2d.chunks_mut(RUN).zip(gradients.conics.chunks_mut(RUN));
        let all = gradients.means.chunks_mut(RUN).zip(shapes).zip(colours).zip(screen);
        all.map(|(((means, (quaternions, log_scales)), (opacity_logits, sh)), (means_2d, conics))| Rows {
            means,
            quaternions,
            log_scales,
            opacity_logits,
            sh,
            scalars: scalars.next().unwrap_or(&mut []),
            means_2d,
            conics,
            absolute_2d: absolute_2d.next().unwrap_or(&mut []),
        })
        .collect()
    }

    /// Zeroes everything: Gaussians that are not drawn have no gradient.
    fn clear(&mut self) {
        let Self { means, quaternions, log_scales, opacity_logits, sh, scalars, means_2d, conics, absolute_2d } = self;
        means.as_flattened_mut().fill(0.0);
        quaternions.as_flattened_mut().fill(0.0);
        log_scales.as_flattened_mut().fill(0.0);
        opacity_logits.fill(0.0);
        sh.as_flattened_mut().fill(0.0);
        scalars.fill(0.0);
        means_2d.as_flattened_mut().fill(0.0);
        conics.as_flattened_mut().fill(0.0);
        absolute_2d.as_flattened_mut().fill(0.0);
    }

    /// Moves the absolute gradients of the drawn Gaussians, if asked for, out of the totals, which have no channels in their place.
    fn take_absolute(&mut self, first: usize, positions: &[u32], totals: &mut [Totals]) {
        if self.absolute_2d.is_empty() {
            return;
        }
        for (position, totals) in positions.iter().zip(totals) {
            let sums = ABSOLUTE.map(|sum| std::mem::take(&mut totals[sum]));
            self.absolute_2d[*position as usize - first] = sums.map(|sum| saturated(sum * ABSOLUTE_UNIT));
        }
    }
}

/// Backward pass of projection for one run, from splats to Gaussians; returns each drawn Gaussian's contribution to the pose
/// gradient.
struct ProjectBackward<'a> {
    gaussians: &'a Gaussians,
    options: &'a RenderOptions,
    optics: &'a Optics,
    /// Half-open range of the run's Gaussians.
    first: usize,
    end: usize,
    /// Indices of the Gaussians of the run's splats, in the same order.
    positions: &'a [u32],
    splats: &'a [Splat],
    totals: &'a [Totals],
    rows: Rows<'a>,
}

impl WithSimd for ProjectBackward<'_> {
    type Output = Vec<[f64; 6]>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<[f64; 6]> {
        let Self { gaussians, options, optics, first, end, positions, splats, totals, mut rows } = self;
        let parts = gaussians.parts();
        let (mut shapes, mut screen, mut basis) = (Shapes::default(), Screen::default(), Basis::new(parts, options));
        let (mut d_splat, mut d_gaussian) = (SplatGradients::zeroed(), GaussianGradients::zeroed());
        let mut pose_gradients = Vec::with_capacity(positions.len());
        let mut drawn = positions.iter().zip(splats).zip(totals).peekable();
        for start in (first..end).step_by(CHUNK) {
            let within = |position: u32| (position as usize) < start + CHUNK;
            if drawn.peek().is_none_or(|((position, _), _)| !within(**position)) {
                continue;
            }
            shapes.load(simd, parts, start, end);
            screen.project(simd, &shapes, optics, options);
            basis.evaluate(simd, &shapes, optics, options.constants.sh_axes);
            if !options.gradients.directions_stop {
                basis.evaluate_gradients();
            }
            let mut lanes = [0usize; CHUNK];
            let mut count = 0;
            while let Some(((position, splat), totals)) = drawn.next_if(|((position, _), _)| within(**position)) {
                let lane = (*position as usize - start) % CHUNK;
                lanes[count % CHUNK] = lane;
                count += 1;
                let row = start - first + lane;
                d_splat.set(lane, &screen, splat, totals);
                // Empty if the Gaussians have no scalars.
                if let Some(slot) = rows.scalars.get_mut(row) {
                    *slot = saturated(totals[SCALAR]);
                }
                // Leaves room for the basis: three times as much is still a finite f32.
                let d_rgb = [RGB, RGB + 1, RGB + 2].map(|sum| to_f32(totals[sum].clamp(-1e38, 1e38)));
                let stored = basis.stored();
                let sh = &mut rows.sh[row * stored..(row + 1) * stored];
                let d_direction = basis.backward(parts, start + lane, lane, (splat.rgb, d_rgb), sh);
                for (slot, value) in d_splat.direction.iter_mut().zip(d_direction) {
                    slot[lane] = value;
                }
            }
            d_gaussian.compute(simd, &ForwardState { shapes: &shapes, screen: &screen, optics, options }, &d_splat);
            for lane in lanes.into_iter().take(count) {
                rows.set_gaussian(start - first + lane, lane % CHUNK, &d_gaussian);
                let [rotation, translation] =
                    d_gaussian.pose.each_ref().map(|rows| rows.each_ref().map(|row| row[lane % CHUNK]));
                pose_gradients.push([
                    rotation[0],
                    rotation[1],
                    rotation[2],
                    translation[0],
                    translation[1],
                    translation[2],
                ]);
            }
        }
        pose_gradients
    }
}

impl SplatGradients {
    #[inline(always)]
    fn set(&mut self, lane: usize, screen: &Screen, splat: &Splat, totals: &Totals) {
        let lane = lane % CHUNK;
        let Self { moments, is_slanted: slanted, from_centre, depth, .. } = self;
        for (row, total) in moments.as_flattened_mut().iter_mut().zip(totals) {
            row[lane] = *total;
        }
        slanted[lane] = if is_slanted(splat.whitener) { 1.0 } else { 0.0 };
        for ((row, base), centre) in from_centre.iter_mut().zip(splat.base).zip(&screen.centre) {
            row[lane] = f64::from(base) + 0.5 - centre[lane];
        }
        depth[lane] = totals[DEPTH];
    }
}

impl Rows<'_> {
    #[inline(always)]
    fn set_gaussian(&mut self, row: usize, lane: usize, d_gaussian: &GaussianGradients) {
        let lane = lane % CHUNK;
        self.means[row] = d_gaussian.mean.each_ref().map(|values| saturated(values[lane]));
        self.quaternions[row] = d_gaussian.quaternion.each_ref().map(|values| saturated(values[lane]));
        self.log_scales[row] = d_gaussian.log_scales.each_ref().map(|values| saturated(values[lane]));
        self.opacity_logits[row] = saturated(d_gaussian.logit[lane]);
        self.means_2d[row] = d_gaussian.centre.each_ref().map(|values| saturated(values[lane]));
        self.conics[row] = d_gaussian.conic.each_ref().map(|values| saturated(values[lane]));
    }
}
