//! The CPU renderer: geometry in f64, pixels in f32, tiles parallelised with rayon.
//!
//! Results are bit-identical for any number of threads, any tile size, and every instruction set with fused
//! multiply-add: each pixel composites its Gaussians in a fixed order, independent of its tile.

mod batch;
mod bins;
mod colour;
mod composite;
mod composite_backward;
mod footprint;
mod frame;
mod gradients;
mod images;
mod math;
mod memory;
mod order;
mod pixel_sums;
mod processor;
mod project;
mod project_backward;
mod recording;
mod scaled;
mod shape;
mod simd;
mod wide;

use std::time::Instant;

use frame::Frame;
use images::Layout;
use memory::MemoryBudget;

use crate::renderer::saturated;
use crate::{Gaussians, RenderOptions, Rendering, SplatError, View};

pub use processor::processor;
pub use recording::Recording;
pub(crate) use scaled::Scaled;
pub use simd::SimdLevel;

/// Execution options; results do not depend on them, except for instruction sets without fused multiply-add.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CpuOptions {
    /// Instruction set.
    pub simd: SimdLevel,
    /// Limit on the bytes of all buffers.
    pub memory_limit: u64,
}

impl Default for CpuOptions {
    /// The best available instruction set, 16 GiB.
    fn default() -> Self {
        Self { simd: SimdLevel::best(), memory_limit: 16 << 30 }
    }
}

/// Side of a tile in pixels: a tile is one cell.
const TILE: u32 = 32;

/// A renderer that reuses its buffers from view to view.
#[derive(Debug)]
pub struct CpuRenderer {
    options: CpuOptions,
    /// [`TILE`]; 16 and 64 only in tests, because images do not depend on it.
    tile: u32,
    spare: Vec<Frame>,
    timings: Timings,
}

/// Time of one rendering by stage, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Timings {
    /// Projection, colour and culling.
    pub project_secs: f64,
    /// Binning into tiles.
    pub bin_secs: f64,
    /// Sorting each tile's splats by depth, and compositing its pixels.
    pub raster_secs: f64,
    /// Writing the images.
    pub write_secs: f64,
}

/// Gaussians to render to some views.
#[derive(Clone, Copy)]
struct Job<'a> {
    gaussians: &'a Gaussians,
    views: &'a [View],
    options: &'a RenderOptions,
    /// Side of a tile in pixels.
    tile: u32,
}

/// Number of views that [`CpuRenderer::render_many`] projects together, if memory allows.
const VIEW_BATCH: usize = 4;

impl CpuRenderer {
    /// A renderer without any buffers.
    pub fn new(options: CpuOptions) -> Self {
        let options = CpuOptions { simd: options.simd.or_portable(), ..options };
        Self { options, tile: TILE, spare: Vec::new(), timings: Timings::default() }
    }

    /// The instruction set in use: the requested one, or [`SimdLevel::Portable`] if the CPU lacks it.
    pub const fn simd(&self) -> SimdLevel {
        self.options.simd
    }

    /// Time of the last rendering by stage, summed over views.
    pub const fn timings(&self) -> Timings {
        self.timings
    }

    /// Renders a view on rayon's threads.
    ///
    /// # Errors
    /// [`SplatError::View`], [`SplatError::Camera`], [`SplatError::Options`], [`SplatError::Constants`];
    /// [`SplatError::Count`] for more Gaussians than a 32-bit index can count; [`SplatError::Memory`] before an
    /// allocation that would exceed the limit.
    pub fn render(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Rendering<f32>, SplatError> {
        let mut rendering = Rendering::blank(view);
        self.render_into(gaussians, view, options, &mut rendering)?;
        Ok(rendering)
    }

    /// As [`CpuRenderer::render`], reusing the memory of existing images of any size.
    ///
    /// # Errors
    /// As [`CpuRenderer::render`]; the images are then unspecified.
    pub fn render_into(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
        rendering: &mut Rendering<f32>,
    ) -> Result<(), SplatError> {
        let job = Job { gaussians, views: &[*view], options, tile: self.tile };
        let frames = self.render_frames(job, 0, &mut [rendering])?;
        self.recycle(frames);
        Ok(())
    }

    /// Renders several views of the same Gaussians, bit for bit as [`CpuRenderer::render`] does. Camera-independent
    /// work is done once for several views, while its data is in cache.
    ///
    /// # Errors
    /// As [`CpuRenderer::render`]; an invalid view is reported before anything is rendered.
    pub fn render_many(
        &mut self,
        gaussians: &Gaussians,
        views: &[View],
        options: &RenderOptions,
    ) -> Result<Vec<Rendering<f32>>, SplatError> {
        options.check()?;
        options.check_harmonics(gaussians)?;
        frame::check_count("Gaussians", gaussians.len() as u64)?;
        for view in views {
            view.optics(&options.constants)?;
        }
        let tile = self.tile;
        let images = views.iter().fold(0u64, |sum, view| sum.saturating_add(Rendering::<f32>::bytes(view, options)));
        let most = views.iter().map(|view| memory::frame(gaussians, view, options, tile)).max();
        let Some(frame) = most else { return Ok(Vec::new()) };
        let mut budget = MemoryBudget::new(self.options.memory_limit);
        budget.reserve(images.saturating_add(frame))?;
        let fitting = 1 + usize::try_from(budget.left / frame).unwrap_or(usize::MAX);
        let mut batch = if fitting < VIEW_BATCH { fitting } else { VIEW_BATCH };

        let mut renderings: Vec<_> = views.iter().map(Rendering::blank).collect();
        let mut timings = Timings::default();
        let mut done = 0;
        while done < views.len() {
            let end = if done + batch < views.len() { done + batch } else { views.len() };
            let job = Job { gaussians, views: &views[done..end], options, tile };
            // The images of all other views are allocated too.
            let bytes = |rest: u64, view| rest.saturating_sub(Rendering::<f32>::bytes(view, options));
            let others = job.views.iter().fold(images, bytes);
            let mut outputs: Vec<_> = renderings[done..end].iter_mut().collect();
            match self.render_frames(job, others, &mut outputs) {
                Ok(frames) => self.recycle(frames),
                Err(SplatError::Memory { .. }) if batch > 1 => {
                    batch = 1;
                    continue;
                }
                Err(error) => return Err(error),
            }
            timings.project_secs += self.timings.project_secs;
            timings.bin_secs += self.timings.bin_secs;
            timings.raster_secs += self.timings.raster_secs;
            timings.write_secs += self.timings.write_secs;
            done = end;
        }
        self.timings = timings;
        Ok(renderings)
    }

    /// Renders views together, each with its own frame, while `others` bytes are in use elsewhere; returns the frames.
    /// Frees spare frames if memory would not suffice otherwise.
    fn render_frames(
        &mut self,
        job: Job<'_>,
        others: u64,
        renderings: &mut [&mut Rendering<f32>],
    ) -> Result<Vec<Frame>, SplatError> {
        let kept = self.spare.len().saturating_sub(job.views.len());
        let mut frames = self.spare.split_off(kept);
        frames.resize_with(job.views.len(), Frame::default);
        let allocated_bytes =
            frames.iter().chain(&self.spare).fold(others, |sum, frame| sum.saturating_add(frame.allocated_bytes()));
        if allocated_bytes > others {
            match self.fill_frames(job, allocated_bytes, frames, renderings) {
                Err(SplatError::Memory { .. }) => self.spare.clear(),
                outcome => return outcome,
            }
        }
        let frames = std::iter::repeat_with(Frame::default).take(job.views.len()).collect();
        self.fill_frames(job, others, frames, renderings)
    }

    /// Renders one view per frame, while `allocated_bytes` are already in use, and returns the frames.
    fn fill_frames(
        &mut self,
        Job { gaussians, views, options, tile }: Job<'_>,
        allocated_bytes: u64,
        mut frames: Vec<Frame>,
        renderings: &mut [&mut Rendering<f32>],
    ) -> Result<Vec<Frame>, SplatError> {
        options.check()?;
        options.check_harmonics(gaussians)?;
        frame::check_count("Gaussians", gaussians.len() as u64)?;
        let mut budget = MemoryBudget::new(self.options.memory_limit);
        budget.reserve(allocated_bytes)?;
        let mut view_optics = Vec::with_capacity(views.len());
        for view in views {
            view_optics.push((*view, view.optics(&options.constants)?));
            budget.reserve(Rendering::<f32>::bytes(view, options))?;
            budget.reserve(memory::frame(gaussians, view, options, tile))?;
        }
        let (simd, mut clock) = (self.options.simd, Clock::start());
        for (frame, view) in frames.iter_mut().zip(views) {
            frame.prepare(gaussians.len(), Layout::of(view, options, tile));
        }
        frame::project(gaussians, options, simd, &view_optics, &mut frames);
        self.timings = Timings { project_secs: clock.lap(), ..Timings::default() };
        for ((frame, view), rendering) in frames.iter_mut().zip(views).zip(renderings) {
            let params = RasterParams::new(view, options);
            frame.bin(&mut budget)?;
            self.timings.bin_secs += clock.lap();
            frame.composite(simd, &params);
            self.timings.raster_secs += clock.lap();
            frame.write(&params, view, rendering);
            options.expose(rendering, saturated);
            self.timings.write_secs += clock.lap();
        }
        Ok(frames)
    }

    /// Keeps frames for reuse, at most as many as are ever used together.
    fn recycle(&mut self, frames: impl IntoIterator<Item = Frame>) {
        self.spare.extend(frames);
        self.spare.truncate(VIEW_BATCH);
    }
}

impl Default for CpuRenderer {
    fn default() -> Self {
        Self::new(CpuOptions::default())
    }
}

/// Whether channels other than colour and alpha are composited.
const fn has_extra_channels(options: &RenderOptions) -> bool {
    options.channels.depth || options.channels.scalar || options.channels.median_depth
}

struct Clock(Instant);

impl Clock {
    fn start() -> Self {
        Self(Instant::now())
    }

    /// Seconds since the start or the last lap.
    fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let lap = now - self.0;
        self.0 = now;
        lap.as_secs_f64()
    }
}

/// Parameters shared by all pixels.
pub(crate) struct RasterParams<'a> {
    options: &'a RenderOptions,
    background: [f32; 3],
    size: atsplat_camera::ImageSize,
    /// Whether depth and scalar are composited too.
    extra: bool,
}

impl<'a> RasterParams<'a> {
    fn new(view: &View, options: &'a RenderOptions) -> Self {
        let background = options.background.map(to_f32);
        Self { options, background, size: view.size, extra: has_extra_channels(options) }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "pixels are f32")]
#[inline(always)]
pub(crate) const fn to_f32(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests;
