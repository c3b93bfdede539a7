//! One view, from Gaussians to pixels: the stages, and the buffers between them.

use rayon::prelude::*;

use super::batch::Batch;
use super::bins::{Bins, Entry, RUN, Reach, Tiling};
use super::composite::Composite;
use super::differentiate::SUMS;
use super::images::{self, Layout};
use super::memory::{self, Room};
use super::order::Sorter;
use super::project::{Project, Run, Target};
use super::splat::Splat;
use super::{Paint, SimdLevel};
use crate::view::Optics;
use crate::{Census, Gaussians, RenderOptions, Rendering, SplatError, View};

/// Bytes that a frame takes for each Gaussian, but for tile lists.
pub(super) const BYTES_EACH: usize = size_of::<Splat>() + size_of::<Reach>() + 2 * size_of::<u32>();

/// Everything about one view, from splats to pixels; its buffers are used again.
#[derive(Debug)]
pub(super) struct Frame {
    /// A place for each Gaussian; of each run, those drawn come first.
    pub(super) splats: Vec<Splat>,
    pub(super) runs: Vec<Run>,
    pub(super) bins: Vec<Bins>,
    pub(super) layout: Layout,
    /// As they are composited, tile by tile.
    pub(super) pixels: Vec<f32>,
    /// Of the derivative: one for each entry of the bins' lists, tile by tile.
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

    /// Makes room for a view of so many Gaussians.
    pub(super) fn prepare(&mut self, gaussians: usize, layout: Layout) {
        self.layout = layout;
        let runs = gaussians.div_ceil(RUN);
        self.splats.resize(gaussians, Splat::default());
        self.runs.resize_with(runs, Run::default);
        self.bins.resize_with(runs, Bins::default);
    }

    /// Bytes of all buffers, used or not.
    pub(super) fn held(&self) -> u64 {
        let Self { splats, runs, bins, pixels, sums, .. } = self;
        let own = splats.capacity() * size_of::<Splat>()
            + pixels.capacity() * size_of::<f32>()
            + sums.capacity() * size_of::<[f32; SUMS]>()
            + runs.iter().map(|run| run.positions.capacity() * size_of::<u32>()).sum::<usize>()
            + bins.iter().map(Bins::held).sum::<usize>();
        own as u64
    }

    /// Splats in the longest of the tiles' lists.
    pub(super) fn longest(&self) -> usize {
        let length = |tile| self.bins.iter().map(|run| run.list(tile).len()).sum();
        (0..self.tiling().len()).into_par_iter().map(length).max().unwrap_or_default()
    }

    /// Sorts splats into tiles: counts, and fills where what was counted fits.
    ///
    /// # Errors
    /// [`SplatError::Memory`] before the lists are made, or what they are sorted with; [`SplatError::Count`].
    pub(super) fn bin(&mut self, room: &mut Room) -> Result<(), SplatError> {
        let tiling = self.tiling();
        let Self { splats, runs, bins, .. } = self;
        let counts: Vec<u64> = bins
            .par_iter_mut()
            .zip(splats.par_chunks(RUN))
            .zip(&*runs)
            .map(|((bins, splats), run)| bins.count(splats.get(..run.positions.len()).unwrap_or_default(), tiling))
            .collect();
        let lists = counts.iter().fold(0u64, |sum, count| sum.saturating_add(*count));
        let most = counts.iter().copied().max().unwrap_or_default();
        countable("tiles of 4096 Gaussians", most)?;
        room.take(lists.saturating_mul(size_of::<Entry>() as u64))?;
        let runs = bins.par_iter_mut().zip(splats.par_chunks(RUN)).enumerate();
        runs.for_each(|(at, (bins, splats))| bins.fill(at * RUN, splats, tiling));
        // Rarely worth counting: all of the lists in one tile would do.
        let most = usize::try_from(lists).unwrap_or(usize::MAX);
        if memory::sorters(most) > room.left {
            room.take(memory::sorters(self.longest()))?;
        }
        Ok(())
    }

    /// Composites every tile.
    pub(super) fn composite(&mut self, simd: SimdLevel, paint: &Paint<'_>) {
        let Self { splats, bins, layout, pixels, .. } = self;
        let (layout, splats, bins) = (*layout, splats.as_slice(), bins.as_slice());
        pixels.resize(layout.per_tile() * layout.tiling.len(), 0.0);
        let scratch = || (Sorter::default(), Box::<Batch>::default());
        let tiles = pixels.par_chunks_mut(layout.per_tile()).enumerate();
        tiles.for_each_init(scratch, |(sorter, batch), (tile, pixels)| {
            let order = sorter.by_depth(bins, tile);
            for (cell, pixels) in layout.cells(tile).zip(pixels.chunks_mut(layout.stride())) {
                simd.dispatch(Composite { paint, order, list: None, splats, cell, batch, pixels });
            }
        });
    }

    /// Writes the pixels into images.
    pub(super) fn write(&self, paint: &Paint<'_>, view: &View, rendering: &mut Rendering<f32>) {
        shape(view, paint.options, rendering);
        for run in &self.runs {
            rendering.census += run.census;
        }
        images::write(self.layout, &self.pixels, paint, rendering);
    }
}

/// Positions and lists are numbered in 32 bits.
///
/// # Errors
/// [`SplatError::Count`] for more.
pub(super) fn countable(what: &'static str, found: u64) -> Result<(), SplatError> {
    let most = u64::from(u32::MAX);
    if found <= most { Ok(()) } else { Err(SplatError::Count { what, most, found }) }
}

/// Gives images the size that a view's have, none of them counted yet.
fn shape(view: &View, options: &RenderOptions, rendering: &mut Rendering<f32>) {
    let pixels = view.pixels();
    let fit = |image: &mut Option<Vec<f32>>, wanted: bool| match image {
        Some(image) if wanted => image.resize(pixels, 0.0),
        _ => *image = wanted.then(|| vec![0.0; pixels]),
    };
    let Rendering { size, rgb, alpha, depth, scalar, median_depth, census } = rendering;
    (*size, *census) = (view.size, Census::default());
    rgb.resize(pixels, [0.0; 3]);
    alpha.resize(pixels, 0.0);
    fit(depth, options.channels.depth);
    fit(scalar, options.channels.scalar);
    fit(median_depth, options.channels.median_depth);
}

/// Projects Gaussians to several views at once: what the views share is worked out once for each few Gaussians.
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
        let past = if first + RUN < gaussians.len() { first + RUN } else { gaussians.len() };
        simd.dispatch(Project { gaussians, options, first, past, targets: &mut targets });
    });
}
