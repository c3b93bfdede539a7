use std::borrow::Borrow;

use rayon::prelude::*;

use super::batch::Batch;
use super::composite::Composite;
use super::differentiate::{CellGradient, Differentiate, SUMS};
use super::frame::Frame;
use super::gradients::{Carry, Rows, Totals};
use super::images::Layout;
use super::memory::{self, Room};
use super::order::Sorter;
use super::scaled::Scaled;
use super::{CpuOptions, CpuRenderer, Paint, SimdLevel, TileSize, bins};
use crate::constants::LARGEST_CHANNEL;
use crate::renderer::saturated;
use crate::{Gaussians, Gradients, ImageGradients, RenderOptions, Rendering, SplatError, View};

/// A rendering with everything that its derivative needs again.
///
/// It holds the Gaussians, as a reference or shared or its own, so that they cannot change between the two.
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
    /// Renders a view as [`CpuRenderer::render`] does, and keeps what its derivative needs: splats, tile lists, and
    /// what pixels were composited to. Takes the renderer's buffers along; [`CpuRenderer::reuse`] gives them back.
    ///
    /// # Errors
    /// As [`CpuRenderer::render`].
    pub fn record<G: Borrow<Gaussians>>(
        &mut self,
        gaussians: G,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Recording<G>, SplatError> {
        let mut rendering = Rendering::blank(view);
        // One cell a tile, whatever the tiles for rendering are: sums over a tile have one order.
        let tile = TileSize::Pixels32;
        let frames = self.render_frames(gaussians.borrow(), &[*view], options, tile, 0, &mut [&mut rendering])?;
        let frame = frames.into_iter().next().unwrap_or_default();
        let (view, options, cpu) = (*view, options.clone(), self.options);
        Ok(Recording { gaussians, view, options, cpu, rendering, frame })
    }

    /// Takes the buffers of a recording that is done with; returns its Gaussians and images.
    pub fn reuse<G>(&mut self, recording: Recording<G>) -> (G, Rendering<f32>) {
        self.keep([recording.frame]);
        (recording.gaussians, recording.rendering)
    }

    /// Derivatives of a loss by everything that made the images, from its derivatives by the images. Renders first;
    /// whoever has a [`Recording`] asks that.
    ///
    /// # Errors
    /// As [`CpuRenderer::render`], and [`SplatError::Length`] for an image of another size than the view's,
    /// [`SplatError::NonFinite`] for derivatives that are not finite.
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

    /// Composites other scalars, one for each Gaussian: the images of a recording of Gaussians that have these, bit for
    /// bit, for the price of compositing alone. So any number of channels are drawn and differentiated one after the
    /// other; derivatives by what channels share add up. The recording has to be of Gaussians with scalars, and the
    /// scalar image one of its channels.
    ///
    /// # Errors
    /// [`SplatError::Length`] for another number of scalars than of Gaussians, or where it is none that the recording
    /// has a place for; [`SplatError::Scalar`] for one that no renderer draws.
    pub fn composite_scalars(&mut self, scalars: &[f32]) -> Result<(), SplatError> {
        let gaussians = self.gaussians.borrow();
        let has_place = self.options.channels.scalar && gaussians.parts().scalars.is_some();
        let expected = if has_place { gaussians.len() } else { 0 };
        if scalars.len() != expected {
            return Err(SplatError::Length { field: "scalars", expected, found: scalars.len() });
        }
        let beyond = |scalar: &f32| !(f64::from(scalar.abs()) <= LARGEST_CHANNEL);
        if let Some((position, found)) = scalars.iter().enumerate().find(|(_, scalar)| beyond(scalar)) {
            return Err(SplatError::Scalar { position, found: *found });
        }
        let Frame { splats, runs, .. } = &mut self.frame;
        for (splats, run) in splats.chunks_mut(bins::RUN).zip(runs) {
            for (splat, position) in splats.iter_mut().zip(&run.positions) {
                splat.scalar = scalars.get(*position as usize).copied().unwrap_or_default();
            }
        }
        let paint = Paint::new(&self.view, &self.options);
        self.frame.composite(self.cpu.simd, &paint);
        self.frame.write(&paint, &self.view, &mut self.rendering);
        self.options.expose(&mut self.rendering, saturated);
        Ok(())
    }

    /// Derivatives of a loss by everything that made the images, from its derivatives by the images.
    ///
    /// Sums have a fixed order: pixels of a block, blocks of a cell of 32×32 pixels, cells row by row. The result
    /// is the same for any number of threads and every instruction set that fuses multiplication with addition.
    ///
    /// # Errors
    /// [`SplatError::Length`] for an image of another size than the view's, [`SplatError::NonFinite`] for derivatives
    /// that are not finite, [`SplatError::Memory`] where there is no room for the derivatives beside what was recorded.
    pub fn backward(&mut self, images: &ImageGradients<f32>) -> Result<Gradients<f32>, SplatError> {
        let mut gradients = Gradients::zero(self.gaussians.borrow());
        self.backward_into(images, &mut gradients)?;
        Ok(gradients)
    }

    /// As [`Recording::backward`], into derivatives whose memory is used again, whatever they were.
    ///
    /// # Errors
    /// As [`Recording::backward`]; the derivatives are unspecified then.
    pub fn backward_into(
        &mut self,
        images: &ImageGradients<f32>,
        gradients: &mut Gradients<f32>,
    ) -> Result<(), SplatError> {
        let largest = images.check(&self.view)?;
        let gaussians = self.gaussians.borrow();
        let optics = self.view.optics(&self.options.constants)?;
        let frame = &mut self.frame;
        let tiling = frame.tiling();
        let starts = starts(&frame.bins, tiling.len());
        let total = starts.last().copied().unwrap_or_default();
        let CpuOptions { simd, memory_limit, .. } = self.cpu;
        let sums = std::mem::take(&mut frame.sums);
        let mut room = Room::new(memory_limit);
        room.take(Rendering::<f32>::bytes(&self.view, &self.options))?;
        room.take(frame.held())?;
        room.take(memory::backward(gaussians, frame, total, Scaled::bytes(images)))?;
        let Scaled { images, unit } = Scaled::of(images, largest, &self.options);
        let images = &*images;
        gradients.fit(gaussians);
        let mut sums = sums;
        sums.resize(total, [0.0; SUMS]);
        let paint = Paint {
            options: &self.options,
            background: self.options.background.map(super::narrowed),
            size: self.view.size,
            extra: images.depth.is_some() || images.scalar.is_some(),
        };
        let background = over_tiles(frame, simd, &paint, images, &starts, &mut sums);
        gradients.background = background.map(|sum| saturated(sum * unit));

        let Frame { splats, runs, bins, .. } = &*frame;
        let coefficients = crate::sh_coefficients(gaussians.sh_degree());
        let places = places(bins, &starts, tiling.len());
        let rows = Rows::of(gradients, bins::RUN, coefficients);
        let shares: Vec<Vec<[f64; 6]>> = rows
            .into_par_iter()
            .zip(runs)
            .zip(bins)
            .enumerate()
            .map_init(Vec::new, |totals: &mut Vec<Totals>, (at, ((mut rows, run), bins))| {
                rows.clear();
                let first = at * bins::RUN;
                let past = if first + bins::RUN < gaussians.len() { first + bins::RUN } else { gaussians.len() };
                totals.clear();
                totals.resize(run.positions.len(), [0.0; SUMS]);
                for tile in 0..tiling.len() {
                    let list = bins.list(tile);
                    let from = places.get(at * tiling.len() + tile).copied().unwrap_or_default();
                    for (entry, sums) in list.iter().zip(sums.get(from..).unwrap_or_default()) {
                        let Some(totals) = totals.get_mut(entry.splat as usize - first) else { continue };
                        for (total, sum) in totals.iter_mut().zip(sums) {
                            *total += f64::from(*sum);
                        }
                    }
                }
                totals.as_flattened_mut().iter_mut().for_each(|total| *total *= unit);
                simd.dispatch(Carry {
                    gaussians,
                    options: &self.options,
                    optics: &optics,
                    first,
                    past,
                    positions: &run.positions,
                    splats: splats.get(first..past).unwrap_or_default(),
                    totals,
                    rows,
                })
            })
            .collect();
        // One after the other, as if only those that matter were there: runs may end anywhere.
        let mut pose = [0.0; 6];
        for share in shares.into_iter().flatten() {
            for (sum, value) in pose.iter_mut().zip(share) {
                *sum += value;
            }
        }
        gradients.pose = pose.map(saturated);
        self.frame.sums = sums;
        Ok(())
    }
}

/// Where each tile's sums begin, and the end of the last.
fn starts(bins: &[bins::Bins], tiles: usize) -> Vec<usize> {
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

/// Where the sums of each run begin in each tile, all tiles of the first run first.
fn places(bins: &[bins::Bins], starts: &[usize], tiles: usize) -> Vec<usize> {
    let mut next = starts.get(..tiles).unwrap_or_default().to_vec();
    let mut places = Vec::with_capacity(bins.len() * tiles);
    for run in bins {
        places.extend_from_slice(&next);
        for (tile, next) in next.iter_mut().enumerate() {
            *next += run.list(tile).len();
        }
    }
    places
}

/// Sums over the pixels of each tile; returns the derivative by the background.
fn over_tiles(
    frame: &Frame,
    simd: SimdLevel,
    paint: &Paint<'_>,
    images: &ImageGradients<f32>,
    starts: &[usize],
    sums: &mut [[f32; SUMS]],
) -> [f64; 3] {
    let layout = frame.layout;
    let whole = Layout::new(frame.tiling(), true);
    let mut rest = sums;
    let mut tiles = Vec::with_capacity(starts.len());
    for (ends, pixels) in starts.windows(2).zip(frame.pixels.chunks(layout.per_tile())) {
        let length = ends.last().copied().unwrap_or_default() - ends.first().copied().unwrap_or_default();
        let (sums, after) = std::mem::take(&mut rest).split_at_mut(length);
        rest = after;
        tiles.push((sums, pixels));
    }
    let backgrounds: Vec<[f64; 3]> = tiles
        .into_par_iter()
        .enumerate()
        .map_init(Scratch::default, |scratch, (tile, (sums, pixels))| {
            sums.fill([0.0; SUMS]);
            let Scratch { sorter, list, batch, gradient, again } = scratch;
            let Some(cell) = layout.cells(tile).next() else { return [0.0; 3] };
            list.clear();
            let order = sorter.places_by_depth(&frame.bins, tile, list);
            // Images that the loss asks for, but the recording has not.
            let (pixels, extra) = if paint.extra && !layout.extra {
                again.resize(whole.per_tile(), 0.0);
                let (list, splats) = (Some(list.as_slice()), frame.splats.as_slice());
                simd.dispatch(Composite { paint, order, list, splats, cell, batch, pixels: again });
                (again.as_slice(), true)
            } else {
                (pixels, layout.extra)
            };
            let background = gradient.fill(pixels, extra, cell, paint, images);
            let splats = frame.splats.as_slice();
            simd.dispatch(Differentiate { paint, order, list, splats, cell, batch, gradient, sums });
            background
        })
        .collect();
    let mut by_background = [0.0; 3];
    for background in backgrounds {
        for (sum, value) in by_background.iter_mut().zip(background) {
            *sum += value;
        }
    }
    by_background
}

/// What one thread works with.
#[derive(Default)]
struct Scratch {
    sorter: Sorter,
    list: Vec<u32>,
    batch: Box<Batch>,
    gradient: CellGradient,
    again: Vec<f32>,
}
