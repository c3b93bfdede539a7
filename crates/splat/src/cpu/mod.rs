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
mod order;
mod project;
mod recording;
mod shape;
mod simd;
mod splat;
mod wide;

use std::time::Instant;

use bins::Tiling;
use frame::Frame;
use images::Layout;

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
        Self { options, ..Self::default() }
    }

    /// The instruction set that it uses.
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
    /// [`SplatError::View`], [`SplatError::Camera`], [`SplatError::Options`]; [`SplatError::Memory`] before anything is
    /// allocated that would not fit.
    pub fn render(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Rendering<f32>, SplatError> {
        let mut rendering = Rendering::empty(view, options);
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
        let spare = self.spare.pop().unwrap_or_default();
        let outcome =
            self.render_frames(gaussians, &[*view], options, self.options.tile, vec![spare], &mut [rendering]);
        self.spare.extend(outcome?);
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
        for view in views {
            view.optics(&options.constants)?;
            check_size(view)?;
        }
        let images = views.iter().fold(0u64, |sum, view| sum.saturating_add(image_bytes(view, options)));
        let most = views.iter().map(|view| frame_bytes(gaussians, view, options, self.options.tile)).max();
        let Some(frame) = most else { return Ok(Vec::new()) };
        let room = self.room(images.saturating_add(frame))?;
        let together = 1 + usize::try_from(room / frame).unwrap_or(usize::MAX);
        let together = if together < TOGETHER { together } else { TOGETHER };

        let mut renderings: Vec<_> = views.iter().map(|view| Rendering::empty(view, options)).collect();
        let mut timings = Timings::default();
        for (views, renderings) in views.chunks(together).zip(renderings.chunks_mut(together)) {
            let mut frames = std::mem::take(&mut self.spare);
            frames.resize_with(views.len(), Frame::default);
            let mut renderings: Vec<_> = renderings.iter_mut().collect();
            let tile = self.options.tile;
            self.spare = self.render_frames(gaussians, views, options, tile, frames, &mut renderings)?;
            timings.project_secs += self.timings.project_secs;
            timings.bin_secs += self.timings.bin_secs;
            timings.raster_secs += self.timings.raster_secs;
            timings.write_secs += self.timings.write_secs;
        }
        self.timings = timings;
        Ok(renderings)
    }

    /// Renders as many views as there are frames, and returns those.
    fn render_frames(
        &mut self,
        gaussians: &Gaussians,
        views: &[View],
        options: &RenderOptions,
        tile: TileSize,
        mut frames: Vec<Frame>,
        renderings: &mut [&mut Rendering<f32>],
    ) -> Result<Vec<Frame>, SplatError> {
        options.check()?;
        let mut eyes = Vec::with_capacity(views.len());
        let mut needed = 0u64;
        for view in views {
            eyes.push((*view, view.optics(&options.constants)?));
            check_size(view)?;
            needed = needed.saturating_add(image_bytes(view, options));
            needed = needed.saturating_add(frame_bytes(gaussians, view, options, tile));
        }
        let mut room = self.room(needed)?;
        let (simd, mut clock) = (self.options.simd, Clock::start());
        for (frame, view) in frames.iter_mut().zip(views) {
            frame.prepare(gaussians.len(), Layout::new(Tiling::new(view.size, tile.pixels()), kept_extra(options)));
        }
        frame::project(gaussians, options, simd, &eyes, &mut frames);
        self.timings = Timings { project_secs: clock.lap(), ..Timings::default() };
        for ((frame, view), rendering) in frames.iter_mut().zip(views).zip(renderings) {
            let paint = Paint::new(view, options);
            room = room.saturating_sub(frame.bin(room, self.options.memory_limit)?);
            self.timings.bin_secs += clock.lap();
            frame.composite(simd, &paint);
            self.timings.raster_secs += clock.lap();
            frame.write(&paint, view, rendering);
            options.expose(rendering, saturated);
            self.timings.write_secs += clock.lap();
        }
        Ok(frames)
    }

    /// Bytes that are left beside those needed.
    fn room(&self, needed: u64) -> Result<u64, SplatError> {
        let limit = self.options.memory_limit;
        limit.checked_sub(needed).ok_or(SplatError::Memory { needed, limit })
    }
}

/// Whether pixels have more than colour and alpha.
const fn kept_extra(options: &RenderOptions) -> bool {
    options.channels.depth || options.channels.scalar || options.channels.median_depth
}

/// Bytes of a view's images.
fn image_bytes(view: &View, options: &RenderOptions) -> u64 {
    let channels = &options.channels;
    let images = 4 + u64::from(channels.depth) + u64::from(channels.scalar) + u64::from(channels.median_depth);
    4 * images * view.pixels() as u64
}

/// Bytes of a view's [`Frame`], but for tile lists, which are checked when their length is known.
fn frame_bytes(gaussians: &Gaussians, view: &View, options: &RenderOptions, tile: TileSize) -> u64 {
    let layout = Layout::new(Tiling::new(view.size, tile.pixels()), kept_extra(options));
    let pixels = (layout.per_tile() as u64).saturating_mul(4 * layout.tiling.len() as u64);
    (gaussians.len() as u64).saturating_mul(frame::BYTES_EACH).saturating_add(pixels)
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

/// Reaches are stored in 16 bits.
pub(crate) fn check_size(view: &View) -> Result<(), SplatError> {
    const LARGEST: u32 = u16::MAX as u32;
    if view.size.width <= LARGEST && view.size.height <= LARGEST {
        return Ok(());
    }
    let expected = format!("at most {LARGEST} pixels a side");
    Err(SplatError::View { what: "picture", expected, found: view.size.to_string() })
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
