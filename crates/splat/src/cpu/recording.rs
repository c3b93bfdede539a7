use std::borrow::Borrow;

use rayon::prelude::*;

use super::batch::Batch;
use super::composite::Composite;
use super::composite_backward::{CellGradient, CompositeBackward};
use super::frame::Frame;
use super::gradients::BackwardOverRuns;
use super::images::Layout;
use super::memory::{self, MemoryBudget};
use super::order::Sorter;
use super::pixel_sums::SUMS;
use super::scaled::Scaled;
use super::{CpuOptions, CpuRenderer, Job, RasterParams, SimdLevel, TILE, bins};
use crate::renderer::saturated;
use crate::{Gaussians, Gradients, ImageGradients, RenderOptions, Rendering, SplatError, View};

/// A rendering with all the state that its backward pass needs.
///
/// Holds the Gaussians (borrowed, shared or owned), so that they cannot change between the forward and backward passes.
#[derive(Debug)]
pub struct Recording<G> {
    gaussians: G,
    view: View,
    options: RenderOptions,
    cpu: CpuOptions,
    rendering: Rendering<f32>,
    frame: Frame,
}

impl CpuRenderer {
    /// Renders a view as [`CpuRenderer::render`] does, and keeps the state for the backward pass: splats, tile lists
    /// and composited pixels. Takes the renderer's buffers; [`CpuRenderer::reuse`] returns them.
    ///
    /// # Errors
    /// As [`CpuRenderer::render`].
    pub fn record<G: Borrow<Gaussians>>(
        &mut self,
        gaussians: G,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Recording<G>, SplatError> {
        let options = &*options.in_full();
        let mut rendering = Rendering::blank(view);
        // Always one cell per tile, so that sums over a tile have a fixed order.
        let job = Job { gaussians: gaussians.borrow(), views: &[*view], options, tile: TILE };
        let frames = self.render_frames(job, 0, &mut [&mut rendering])?;
        #[expect(clippy::expect_used, reason = "one view was rendered")]
        let frame = frames.into_iter().next().expect("a frame per view");
        let (view, options, cpu) = (*view, options.clone(), self.options);
        Ok(Recording { gaussians, view, options, cpu, rendering, frame })
    }

    /// Reclaims the buffers of a recording; returns its Gaussians and images.
    pub fn reuse<G>(&mut self, recording: Recording<G>) -> (G, Rendering<f32>) {
        self.recycle([recording.frame]);
        (recording.gaussians, recording.rendering)
    }

    /// Forward and backward pass: gradients of a loss with respect to every input, from its gradients with respect to
    /// the images. With a [`Recording`], use [`Recording::backward`] instead.
    ///
    /// # Errors
    /// As [`CpuRenderer::render`], and [`SplatError::Length`] for an image whose size differs from the view's,
    /// [`SplatError::NonFinite`] for gradients that are not finite.
    pub fn backward(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
        images: &ImageGradients<f32>,
    ) -> Result<Gradients<f32>, SplatError> {
        options.check()?;
        view.optics(&options.constants)?;
        images.check(view)?;
        let mut recording = self.record(gaussians, view, options)?;
        let gradients = recording.backward(images);
        self.reuse(recording);
        gradients
    }
}

impl<G: Borrow<Gaussians>> Recording<G> {
    /// The images.
    pub const fn rendering(&self) -> &Rendering<f32> {
        &self.rendering
    }

    /// Gradients of a loss with respect to every input, from its gradients with respect to the images.
    ///
    /// Sums have a fixed order: pixels of a block, blocks of a cell of 32×32 pixels, cells row by row. The result is
    /// bit-identical for any number of threads and every instruction set with fused multiply-add.
    ///
    /// # Errors
    /// [`SplatError::Length`] for an image whose size differs from the view's, [`SplatError::NonFinite`] for gradients
    /// that are not finite, [`SplatError::Memory`] if the backward pass does not fit in memory next to the recording.
    pub fn backward(&mut self, images: &ImageGradients<f32>) -> Result<Gradients<f32>, SplatError> {
        let mut gradients = Gradients::zero(self.gaussians.borrow());
        self.backward_into(images, &mut gradients)?;
        Ok(gradients)
    }

    /// As [`Recording::backward`], reusing the memory of existing gradients of any size.
    ///
    /// # Errors
    /// As [`Recording::backward`]; the gradients are then unspecified.
    pub fn backward_into(
        &mut self,
        images: &ImageGradients<f32>,
        gradients: &mut Gradients<f32>,
    ) -> Result<(), SplatError> {
        self.differentiate(images, gradients, None)
    }

    /// As [`Recording::backward_into`], with the sums over pixels of the magnitudes of their gradients with respect to each
    /// projected mean, along columns and rows: `AbsGS`' criterion for splits (Ye et al. 2024). Zero where nothing is
    /// drawn.
    ///
    /// # Errors
    /// As [`Recording::backward`]; [`SplatError::Length`] for gradients of depth or scalar, which are not supported here.
    pub fn backward_with_absolute(
        &mut self,
        images: &ImageGradients<f32>,
        gradients: &mut Gradients<f32>,
        absolute_2d: &mut Vec<[f32; 2]>,
    ) -> Result<(), SplatError> {
        images.check_colour_only()?;
        absolute_2d.resize(self.gaussians.borrow().len(), [0.0; 2]);
        self.differentiate(images, gradients, Some(absolute_2d))
    }

    /// Positions of the Gaussians that are drawn, in order.
    pub fn drawn(&self) -> impl Iterator<Item = u32> + '_ {
        self.frame.runs.iter().flat_map(|run| run.positions.iter().copied())
    }

    fn differentiate(
        &mut self,
        images: &ImageGradients<f32>,
        gradients: &mut Gradients<f32>,
        absolute_2d: Option<&mut [[f32; 2]]>,
    ) -> Result<(), SplatError> {
        let largest = images.check(&self.view)?;
        let optics = self.view.optics(&self.options.constants)?;
        let tiles = self.frame.tiling().len();
        let tile_offsets = tile_offsets(&self.frame.bins, tiles);
        let entries = tile_offsets[tiles];
        // Taken out of the frame: memory is checked for the sums to come, not for those of an earlier pass.
        let mut sums = std::mem::take(&mut self.frame.sums);
        self.check_memory(images, entries)?;
        let Scaled { images, unit } = Scaled::of(images, largest, &self.options);
        let images = &*images;
        let gaussians = self.gaussians.borrow();
        gradients.fit(gaussians);
        sums.resize(entries, [0.0; SUMS]);

        let params = RasterParams {
            options: &self.options,
            background: self.options.background.map(super::to_f32),
            size: self.view.size,
            extra: images.depth.is_some() || images.scalar.is_some(),
        };
        let (frame, simd, absolute) = (&self.frame, self.cpu.simd, absolute_2d.is_some());
        let background = backward_over_tiles(frame, simd, &params, absolute, images, &tile_offsets, &mut sums);
        gradients.background = background.map(|sum| saturated(sum * unit));

        let runs = BackwardOverRuns {
            gaussians,
            options: &self.options,
            optics: &optics,
            simd,
            frame,
            sums: &sums,
            offsets: &run_offsets(&frame.bins, &tile_offsets, tiles),
            unit,
        };
        let pose = runs.differentiate(gradients, absolute_2d.unwrap_or_default());
        gradients.pose = pose.map(saturated);
        self.frame.sums = sums;
        Ok(())
    }

    /// Checks that the backward pass over `entries` of tile lists fits in memory next to the recording.
    fn check_memory(&self, images: &ImageGradients<f32>, entries: usize) -> Result<(), SplatError> {
        let mut budget = MemoryBudget::new(self.cpu.memory_limit);
        budget.reserve(Rendering::<f32>::bytes(&self.view, &self.options))?;
        budget.reserve(self.frame.allocated_bytes())?;
        budget.reserve(memory::backward(self.gaussians.borrow(), &self.frame, entries, Scaled::bytes(images)))
    }
}

/// Offsets of each tile's sums, and the end of the last.
fn tile_offsets(bins: &[bins::Bins], tiles: usize) -> Vec<usize> {
    let mut starts = vec![0; tiles + 1];
    for run in bins {
        for (tile, start) in starts.iter_mut().skip(1).enumerate() {
            *start += run.list(tile).len();
        }
    }
    let mut total = 0;
    for start in &mut starts {
        total += *start;
        *start = total;
    }
    starts
}

/// Offsets of each run's sums within each tile, run by run.
fn run_offsets(bins: &[bins::Bins], tile_offsets: &[usize], tiles: usize) -> Vec<usize> {
    let mut next = tile_offsets[..tiles].to_vec();
    let mut offsets = Vec::with_capacity(bins.len() * tiles);
    for run in bins {
        offsets.extend_from_slice(&next);
        for (tile, next) in next.iter_mut().enumerate() {
            *next += run.list(tile).len();
        }
    }
    offsets
}

/// Backward pass over the pixels of each tile; returns the gradient of the background.
fn backward_over_tiles(
    frame: &Frame,
    simd: SimdLevel,
    params: &RasterParams<'_>,
    absolute: bool,
    images: &ImageGradients<f32>,
    tile_offsets: &[usize],
    sums: &mut [[f32; SUMS]],
) -> [f64; 3] {
    let layout = frame.layout;
    let with_extra = Layout::new(frame.tiling(), true);
    let mut remaining = sums;
    let mut tiles = Vec::with_capacity(tile_offsets.len());
    for (range, pixels) in tile_offsets.windows(2).zip(frame.pixels.chunks(layout.per_tile())) {
        let length = range[1] - range[0];
        let (sums, after) = std::mem::take(&mut remaining).split_at_mut(length);
        remaining = after;
        tiles.push((sums, pixels));
    }
    let backgrounds: Vec<[f64; 3]> = tiles
        .into_par_iter()
        .enumerate()
        .map_init(Scratch::default, |scratch, (tile, (sums, pixels))| {
            sums.fill([0.0; SUMS]);
            let Scratch { sorter, list, batch, gradient, recomposited } = scratch;
            let Some(cell) = layout.cells(tile).next() else { return [0.0; 3] };
            list.clear();
            let order = sorter.indices_by_depth(&frame.bins, tile, list);
            // The loss has channels that were not recorded.
            let (pixels, extra) = if params.extra && !layout.extra {
                recomposited.resize(with_extra.per_tile(), 0.0);
                let (list, splats) = (Some(list.as_slice()), frame.splats.as_slice());
                simd.dispatch(Composite { params, order, list, splats, cell, batch, pixels: recomposited });
                (recomposited.as_slice(), true)
            } else {
                (pixels, layout.extra)
            };
            let background = gradient.fill(pixels, extra, cell, params, images);
            let splats = frame.splats.as_slice();
            simd.dispatch(CompositeBackward { params, order, list, splats, cell, batch, gradient, sums, absolute });
            background
        })
        .collect();
    let mut d_background = [0.0; 3];
    for background in backgrounds {
        for (sum, value) in d_background.iter_mut().zip(background) {
            *sum += value;
        }
    }
    d_background
}

/// Buffers of one thread.
#[derive(Default)]
struct Scratch {
    sorter: Sorter,
    list: Vec<u32>,
    batch: Box<Batch>,
    gradient: CellGradient,
    recomposited: Vec<f32>,
}
