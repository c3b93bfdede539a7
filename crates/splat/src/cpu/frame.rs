//! The pipeline of one view, from Gaussians to pixels: its stages and the buffers between them.

use rayon::prelude::*;

use super::batch::Batch;
use super::bins::{Bins, Entry, RUN, Reach, Tiling};
use super::composite::Composite;
use super::images::{self, Layout};
use super::memory::{self, MemoryBudget};
use super::order::Sorter;
use super::pixel_sums::SUMS;
use super::project::Splat;
use super::project::{Project, Run, Target};
use super::{RasterParams, SimdLevel};
use crate::view::Optics;
use crate::{GaussianCounts, Gaussians, RenderOptions, Rendering, SplatError, View};

/// Bytes of a frame per Gaussian, excluding tile lists.
pub(super) const BYTES_EACH: usize = size_of::<Splat>() + size_of::<Reach>() + 2 * size_of::<u32>();

/// The reusable buffers of one view, from splats to pixels.
#[derive(Debug)]
pub(super) struct Frame {
    /// One slot per Gaussian; in each run, the drawn ones come first.
    pub(super) splats: Vec<Splat>,
    pub(super) runs: Vec<Run>,
    pub(super) bins: Vec<Bins>,
    pub(super) layout: Layout,
    /// Composited pixels, tile by tile.
    pub(super) pixels: Vec<f32>,
    /// Sums of the backward pass: one per entry of the bins' lists, tile by tile.
    pub(super) sums: Vec<[f32; SUMS]>,
}

impl Default for Frame {
    fn default() -> Self {
        let layout = Layout::new(Tiling { side: 32, columns: 0, rows: 0 }, false);
        Self { splats: Vec::new(), runs: Vec::new(), bins: Vec::new(), layout, pixels: Vec::new(), sums: Vec::new() }
    }
}

impl Frame {
    pub(super) const fn tiling(&self) -> Tiling {
        self.layout.tiling
    }

    /// Resizes the buffers for a view of `gaussians` Gaussians.
    pub(super) fn prepare(&mut self, gaussians: usize, layout: Layout) {
        self.layout = layout;
        let runs = gaussians.div_ceil(RUN);
        self.splats.resize(gaussians, Splat::default());
        self.runs.resize_with(runs, Run::default);
        self.bins.resize_with(runs, Bins::default);
    }

    /// Allocated bytes of all buffers.
    pub(super) fn allocated_bytes(&self) -> u64 {
        let Self { splats, runs, bins, pixels, sums, .. } = self;
        let bytes = splats.capacity() * size_of::<Splat>()
            + pixels.capacity() * size_of::<f32>()
            + sums.capacity() * size_of::<[f32; SUMS]>()
            + runs.iter().map(|run| run.positions.capacity() * size_of::<u32>()).sum::<usize>()
            + bins.iter().map(Bins::allocated_bytes).sum::<usize>();
        bytes as u64
    }

    /// Length of the longest tile list.
    pub(super) fn longest_list(&self) -> usize {
        let length = |tile| self.bins.iter().map(|run| run.list(tile).len()).sum();
        (0..self.tiling().len()).into_par_iter().map(length).max().unwrap_or(0)
    }

    /// Bins the splats into tiles: counts the entries, then fills the lists if they fit the budget.
    ///
    /// # Errors
    /// [`SplatError::Memory`] before the lists or the sort buffers are allocated; [`SplatError::Count`].
    pub(super) fn bin(&mut self, budget: &mut MemoryBudget) -> Result<(), SplatError> {
        let tiling = self.tiling();
        let Self { splats, runs, bins, .. } = self;
        let counts: Vec<u64> = bins
            .par_iter_mut()
            .zip(splats.par_chunks(RUN))
            .zip(&*runs)
            .map(|((bins, splats), run)| bins.count(&splats[..run.positions.len()], tiling))
            .collect();
        let lists = counts.iter().fold(0u64, |sum, count| sum.saturating_add(*count));
        let most = counts.iter().copied().max().unwrap_or(0);
        check_count("tiles of 4096 Gaussians", most)?;
        budget.reserve(lists.saturating_mul(size_of::<Entry>() as u64))?;
        let runs = bins.par_iter_mut().zip(splats.par_chunks(RUN)).enumerate();
        runs.for_each(|(at, (bins, splats))| bins.fill(at * RUN, splats, tiling));
        // The exact length is computed only if the upper bound, all entries in one tile, does not fit.
        let most = usize::try_from(lists).unwrap_or(usize::MAX);
        if memory::sorters(most) > budget.left {
            budget.reserve(memory::sorters(self.longest_list()))?;
        }
        Ok(())
    }

    /// Composites every tile.
    pub(super) fn composite(&mut self, simd: SimdLevel, params: &RasterParams<'_>) {
        let Self { splats, bins, layout, pixels, .. } = self;
        let (layout, splats, bins) = (*layout, splats.as_slice(), bins.as_slice());
        pixels.resize(layout.per_tile() * layout.tiling.len(), 0.0);
        let scratch = || (Sorter::default(), Box::<Batch>::default());
        let tiles = pixels.par_chunks_mut(layout.per_tile()).enumerate();
        tiles.for_each_init(scratch, |(sorter, batch), (tile, pixels)| {
            let order = sorter.by_depth(bins, tile);
            for (cell, pixels) in layout.cells(tile).zip(pixels.chunks_mut(layout.stride())) {
                simd.dispatch(Composite { params, order, list: None, splats, cell, batch, pixels });
            }
        });
    }

    /// Writes the pixels into the images.
    pub(super) fn write(&self, params: &RasterParams<'_>, view: &View, rendering: &mut Rendering<f32>) {
        resize_images(view, params.options, rendering);
        for run in &self.runs {
            rendering.counts += run.counts;
        }
        images::write(self.layout, &self.pixels, params, rendering);
    }
}

/// Checks that a count fits 32-bit indices.
///
/// # Errors
/// [`SplatError::Count`] if it does not.
pub(super) fn check_count(what: &'static str, found: u64) -> Result<(), SplatError> {
    let most = u64::from(u32::MAX);
    if found <= most { Ok(()) } else { Err(SplatError::Count { what, most, found }) }
}

/// Resizes the requested images to the view, and resets the counts.
fn resize_images(view: &View, options: &RenderOptions, rendering: &mut Rendering<f32>) {
    let pixels = view.pixels();
    let fit = |image: &mut Option<Vec<f32>>, requested: bool| match image {
        Some(image) if requested => image.resize(pixels, 0.0),
        _ => *image = requested.then(|| vec![0.0; pixels]),
    };
    let Rendering { size, rgb, alpha, depth, scalar, median_depth, counts } = rendering;
    (*size, *counts) = (view.size, GaussianCounts::default());
    rgb.resize(pixels, [0.0; 3]);
    alpha.resize(pixels, 0.0);
    fit(depth, options.channels.depth);
    fit(scalar, options.channels.scalar);
    fit(median_depth, options.channels.median_depth);
}

/// Projects Gaussians to several views at once; camera-independent work is done once per chunk of Gaussians.
pub(super) fn project(
    gaussians: &Gaussians,
    options: &RenderOptions,
    simd: SimdLevel,
    views: &[(View, Optics)],
    frames: &mut [Frame],
) {
    let mut tasks: Vec<Vec<Target<'_>>> = (0..gaussians.len().div_ceil(RUN)).map(|_| Vec::new()).collect();
    for ((view, optics), frame) in views.iter().zip(frames) {
        for ((task, splats), run) in tasks.iter_mut().zip(frame.splats.chunks_mut(RUN)).zip(&mut frame.runs) {
            task.push(Target { view, optics, splats, run });
        }
    }
    tasks.into_par_iter().enumerate().for_each(|(at, mut targets)| {
        let first = at * RUN;
        let end = if first + RUN < gaussians.len() { first + RUN } else { gaussians.len() };
        simd.dispatch(Project { gaussians, options, first, end, targets: &mut targets });
    });
}
