//! The renderer for processors: geometry in f64, pixels in f32, tiles on rayon's threads.
//!
//! The same bits come out for any number of threads, any tile size, and every instruction set that fuses
//! multiplication with addition: each pixel composites its own Gaussians in one order, whatever surrounds it.

mod adjoint;
mod batch;
mod bins;
mod colour;
mod composite;
mod differentiate;
mod elementary;
mod frame;
mod gradients;
mod images;
mod memory;
mod order;
mod place;
mod project;
mod recording;
mod scaled;
mod shape;
mod simd;
mod splat;
mod wide;

use std::time::Instant;

use bins::Tiling;
use frame::Frame;
use images::Layout;
use memory::Room;

use crate::renderer::saturated;
use crate::{Gaussians, RenderOptions, Rendering, SplatError, View};

pub use recording::Recording;
pub use simd::SimdLevel;

/// How the processor is used; results do not depend on it, but for levels without fused multiplication.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CpuOptions {
    /// Instruction set.
    pub simd: SimdLevel,
    /// Side of a tile in pixels: 16, 32 or 64.
    pub tile: TileSize,
    /// Bytes that buffers may take.
    pub memory_limit: u64,
}

impl Default for CpuOptions {
    /// The best instruction set that the processor has, tiles of 32 pixels, 16 GiB.
    fn default() -> Self {
        Self { simd: SimdLevel::best(), tile: TileSize::Pixels32, memory_limit: 16 << 30 }
    }
}

/// Side of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TileSize {
    /// 16 pixels: for scenes that hide most of themselves.
    Pixels16,
    /// 32 pixels.
    Pixels32,
    /// 64 pixels: for few and large Gaussians.
    Pixels64,
}

impl TileSize {
    /// Side in pixels.
    pub const fn pixels(self) -> u32 {
        match self {
            Self::Pixels16 => 16,
            Self::Pixels32 => 32,
            Self::Pixels64 => 64,
        }
    }
}

/// A renderer that keeps its buffers from one view to the next.
#[derive(Debug, Default)]
pub struct CpuRenderer {
    options: CpuOptions,
    spare: Vec<Frame>,
    timings: Timings,
}

/// Where the time of one rendering went, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Timings {
    /// World to screen, colour, culling.
    pub project_secs: f64,
    /// Into tiles.
    pub bin_secs: f64,
    /// Sorting each tile's splats by depth, and compositing its pixels.
    pub raster_secs: f64,
    /// Images from pixels.
    pub write_secs: f64,
}

/// Views that are projected to together by [`CpuRenderer::render_many`], if memory allows it.
const TOGETHER: usize = 4;

impl CpuRenderer {
    /// A renderer without buffers yet.
    pub fn new(options: CpuOptions) -> Self {
        let simd = options.simd.or_portable();
        Self { options: CpuOptions { simd, ..options }, ..Self::default() }
    }

    /// The instruction set that it uses: the one asked for, or [`SimdLevel::Portable`] where the processor lacks it.
    pub const fn simd(&self) -> SimdLevel {
        self.options.simd
    }

    /// Where the time of the last rendering went, of all views together.
    pub const fn timings(&self) -> Timings {
        self.timings
    }

    /// Renders a view on rayon's threads.
    ///
    /// # Errors
    /// [`SplatError::View`], [`SplatError::Camera`], [`SplatError::Options`], [`SplatError::Constants`];
    /// [`SplatError::Count`] for more Gaussians than 32 bits number; [`SplatError::Memory`] before anything is allocated
    /// that would not fit.
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

    /// As [`CpuRenderer::render`], into images whose memory is used again, whatever they were.
    ///
    /// # Errors
    /// As [`CpuRenderer::render`]; the images are unspecified then.
    pub fn render_into(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
        rendering: &mut Rendering<f32>,
    ) -> Result<(), SplatError> {
        let tile = self.options.tile;
        let frames = self.render_frames(gaussians, &[*view], options, tile, 0, &mut [rendering])?;
        self.keep(frames);
        Ok(())
    }

    /// Renders several views of the same Gaussians: the images of [`CpuRenderer::render`], bit for bit. What does
    /// not depend on the camera is worked out once for several views, while it is in the nearest caches.
    ///
    /// # Errors
    /// As [`CpuRenderer::render`], before anything is rendered where one of the views is at fault.
    pub fn render_many(
        &mut self,
        gaussians: &Gaussians,
        views: &[View],
        options: &RenderOptions,
    ) -> Result<Vec<Rendering<f32>>, SplatError> {
        options.check()?;
        frame::countable("Gaussians", gaussians.len() as u64)?;
        for view in views {
            view.optics(&options.constants)?;
        }
        let tile = self.options.tile;
        let images = views.iter().fold(0u64, |sum, view| sum.saturating_add(Rendering::<f32>::bytes(view, options)));
        let most = views.iter().map(|view| memory::frame(gaussians, view, options, tile)).max();
        let Some(frame) = most else { return Ok(Vec::new()) };
        let mut room = Room::new(self.options.memory_limit);
        room.take(images.saturating_add(frame))?;
        let together = 1 + usize::try_from(room.left / frame).unwrap_or(usize::MAX);
        let mut together = if together < TOGETHER { together } else { TOGETHER };

        let mut renderings: Vec<_> = views.iter().map(Rendering::blank).collect();
        let mut timings = Timings::default();
        let mut done = 0;
        while done < views.len() {
            let past = if done + together < views.len() { done + together } else { views.len() };
            let (Some(now), Some(into)) = (views.get(done..past), renderings.get_mut(done..past)) else { break };
            // The images of the other views are there as well.
            let others =
                now.iter().fold(images, |rest, view| rest.saturating_sub(Rendering::<f32>::bytes(view, options)));
            let mut into: Vec<_> = into.iter_mut().collect();
            match self.render_frames(gaussians, now, options, tile, others, &mut into) {
                Ok(frames) => self.keep(frames),
                Err(SplatError::Memory { .. }) if together > 1 => {
                    together = 1;
                    continue;
                }
                Err(error) => return Err(error),
            }
            timings.project_secs += self.timings.project_secs;
            timings.bin_secs += self.timings.bin_secs;
            timings.raster_secs += self.timings.raster_secs;
            timings.write_secs += self.timings.write_secs;
            done = past;
        }
        self.timings = timings;
        Ok(renderings)
    }

    /// Renders views together, each with a frame, beside `others` bytes in use; returns the frames. What is left of
    /// earlier jobs makes way where it would not fit.
    fn render_frames(
        &mut self,
        gaussians: &Gaussians,
        views: &[View],
        options: &RenderOptions,
        tile: TileSize,
        others: u64,
        renderings: &mut [&mut Rendering<f32>],
    ) -> Result<Vec<Frame>, SplatError> {
        let kept = self.spare.len().saturating_sub(views.len());
        let mut frames = self.spare.split_off(kept);
        frames.resize_with(views.len(), Frame::default);
        let held = frames.iter().chain(&self.spare).fold(others, |sum, frame| sum.saturating_add(frame.held()));
        if held > others {
            match self.fill_frames(gaussians, views, options, tile, (held, frames), renderings) {
                Err(SplatError::Memory { .. }) => self.spare.clear(),
                outcome => return outcome,
            }
        }
        let frames = std::iter::repeat_with(Frame::default).take(views.len()).collect();
        self.fill_frames(gaussians, views, options, tile, (others, frames), renderings)
    }

    /// Renders as many views as there are frames, beside so many bytes in use, and returns the frames.
    fn fill_frames(
        &mut self,
        gaussians: &Gaussians,
        views: &[View],
        options: &RenderOptions,
        tile: TileSize,
        (held, mut frames): (u64, Vec<Frame>),
        renderings: &mut [&mut Rendering<f32>],
    ) -> Result<Vec<Frame>, SplatError> {
        options.check()?;
        frame::countable("Gaussians", gaussians.len() as u64)?;
        let mut room = Room::new(self.options.memory_limit);
        room.take(held)?;
        let mut eyes = Vec::with_capacity(views.len());
        for view in views {
            eyes.push((*view, view.optics(&options.constants)?));
            room.take(Rendering::<f32>::bytes(view, options))?;
            room.take(memory::frame(gaussians, view, options, tile))?;
        }
        let (simd, mut clock) = (self.options.simd, Clock::start());
        for (frame, view) in frames.iter_mut().zip(views) {
            frame.prepare(gaussians.len(), Layout::new(Tiling::new(view.size, tile.pixels()), kept_extra(options)));
        }
        frame::project(gaussians, options, simd, &eyes, &mut frames);
        self.timings = Timings { project_secs: clock.lap(), ..Timings::default() };
        for ((frame, view), rendering) in frames.iter_mut().zip(views).zip(renderings) {
            let paint = Paint::new(view, options);
            frame.bin(&mut room)?;
            self.timings.bin_secs += clock.lap();
            frame.composite(simd, &paint);
            self.timings.raster_secs += clock.lap();
            frame.write(&paint, view, rendering);
            options.expose(rendering, saturated);
            self.timings.write_secs += clock.lap();
        }
        Ok(frames)
    }

    /// Keeps the buffers of a job for the next, of no more frames than are ever used together.
    fn keep(&mut self, frames: impl IntoIterator<Item = Frame>) {
        self.spare.extend(frames);
        self.spare.truncate(TOGETHER);
    }
}

/// Whether pixels have more than colour and alpha.
const fn kept_extra(options: &RenderOptions) -> bool {
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

/// What all pixels share.
pub(crate) struct Paint<'a> {
    options: &'a RenderOptions,
    background: [f32; 3],
    size: atsplat_camera::ImageSize,
    /// Whether depth and scalar are composited too.
    extra: bool,
}

impl<'a> Paint<'a> {
    fn new(view: &View, options: &'a RenderOptions) -> Self {
        let background = options.background.map(narrowed);
        Self { options, background, size: view.size, extra: kept_extra(options) }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "pixels are f32")]
#[inline(always)]
pub(crate) const fn narrowed(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests;
