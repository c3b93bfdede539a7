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
    frame: Frame,
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

impl CpuRenderer {
    /// A renderer without buffers yet.
    pub fn new(options: CpuOptions) -> Self {
        Self { options, ..Self::default() }
    }

    /// Where the time of the last rendering went.
    pub const fn timings(&self) -> Timings {
        self.timings
    }

    /// Renders a view on rayon's threads.
    ///
    /// # Errors
    /// [`SplatError::View`], [`SplatError::Camera`]; [`SplatError::Memory`] before anything is allocated.
    pub fn render(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Rendering<f32>, SplatError> {
        let mut rendering = Rendering::empty(view, options);
        self.render_tiled(gaussians, view, options, self.options.tile, &mut rendering)?;
        Ok(rendering)
    }

    fn render_tiled(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
        tile: TileSize,
        rendering: &mut Rendering<f32>,
    ) -> Result<(), SplatError> {
        let optics = view.optics(&options.constants)?;
        check_size(view)?;
        self.check_memory(gaussians, view, options)?;
        let mut clock = Clock::start();
        let simd = self.options.simd;
        let paint = Paint::new(view, options);
        self.frame.prepare(gaussians.len(), Layout::new(Tiling::new(view.size, tile.pixels()), paint.extra));
        frame::project(gaussians, options, simd, &[(*view, optics)], std::slice::from_mut(&mut self.frame));
        self.timings.project_secs = clock.lap();
        self.frame.bin(self.options.memory_limit, self.options.memory_limit)?;
        self.timings.bin_secs = clock.lap();
        self.frame.composite(simd, &paint);
        self.timings.raster_secs = clock.lap();
        self.frame.write(&paint, rendering);
        self.timings.write_secs = clock.lap();
        Ok(())
    }

    /// Bytes per Gaussian and pixel that are needed at once; tile lists are checked when their length is known.
    fn check_memory(&self, gaussians: &Gaussians, view: &View, options: &RenderOptions) -> Result<(), SplatError> {
        let channels = &options.channels;
        let images = 4 + u64::from(channels.depth) + u64::from(channels.scalar) + u64::from(channels.median_depth);
        let per_gaussian = (size_of::<splat::Splat>() + 32) as u64;
        let needed = (gaussians.len() as u64)
            .saturating_mul(per_gaussian)
            .saturating_add((view.pixels() as u64).saturating_mul(4 * images));
        let limit = self.options.memory_limit;
        if needed > limit { Err(SplatError::Memory { needed, limit }) } else { Ok(()) }
    }
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
fn check_size(view: &View) -> Result<(), SplatError> {
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
        let channels = options.channels;
        let extra = channels.depth || channels.scalar || channels.median_depth;
        Self { options, background: options.background.map(narrowed), size: view.size, extra }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "pixels are f32")]
#[inline(always)]
pub(crate) const fn narrowed(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests;
