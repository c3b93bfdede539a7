//! The renderer for processors: geometry in f64, pixels in f32, tiles on rayon's threads.
//!
//! The same bits come out for any number of threads, any tile size, and every instruction set that fuses
//! multiplication with addition: each pixel composites its own Gaussians in one order, whatever surrounds it.

mod backward;
mod block;
mod differentiate;
mod kernel;
mod order;
mod project;
mod simd;
mod tiles;

use std::time::Instant;

use rayon::prelude::*;

use crate::renderer::saturated;
use crate::{Gaussians, RenderOptions, Rendering, SplatError, View};

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
    splats: Vec<project::Splat>,
    order: order::Sorter,
    tiles: tiles::Tiles,
    timings: Timings,
}

/// Where the time of one rendering went, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Timings {
    /// World to screen, colour, culling.
    pub project_secs: f64,
    /// By depth.
    pub sort_secs: f64,
    /// Into tiles.
    pub bin_secs: f64,
    /// Compositing pixels.
    pub raster_secs: f64,
}

impl CpuRenderer {
    /// A renderer without buffers yet.
    pub fn new(options: CpuOptions) -> Self {
        Self { options, ..Self::default() }
    }

    /// The instruction set that it uses.
    pub const fn simd(&self) -> SimdLevel {
        self.options.simd
    }

    /// Where the time of the last rendering went.
    pub const fn timings(&self) -> Timings {
        self.timings
    }

    /// Renders a view on rayon's threads.
    ///
    /// # Errors
    /// [`SplatError::View`], [`SplatError::Camera`], [`SplatError::Options`]; [`SplatError::Memory`] before anything is allocated.
    pub fn render(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Rendering<f32>, SplatError> {
        options.check()?;
        let optics = view.optics(&options.constants)?;
        check_size(view)?;
        self.check_memory(gaussians, view, options)?;
        let mut clock = Clock::start();
        let mut rendering = Rendering::empty(view, options);
        rendering.census = project::project_all(gaussians, view, &optics, options, self.options.simd, &mut self.splats);
        self.timings.project_secs = clock.lap();
        let order = self.order.by_depth(&self.splats);
        self.timings.sort_secs = clock.lap();
        let side = self.options.tile.pixels();
        self.tiles.fill(&self.splats, order, view.size, side)?;
        self.timings.bin_secs = clock.lap();
        let rows_per_band = side as usize * view.size.width as usize;
        let background = options.background.map(narrowed);
        let channels = options.channels;
        let extra = channels.depth || channels.scalar || channels.median_depth;
        let paint = kernel::Paint { options, background, size: view.size, splats: &self.splats, extra };
        let mut bands = Bands::of(&mut rendering, rows_per_band);
        bands.par_iter_mut().enumerate().for_each(|(band, images)| {
            let mut tile = kernel::Tile::new(side);
            for column in 0..self.tiles.columns() {
                let list = self.tiles.list(column, band);
                self.options.simd.dispatch(kernel::Render { paint: &paint, list, at: (column, band), tile: &mut tile });
                tile.copy_to(images, (column, band), &paint);
            }
        });
        options.expose(&mut rendering, saturated);
        self.timings.raster_secs = clock.lap();
        Ok(rendering)
    }

    /// Bytes per Gaussian and pixel that are needed at once; tile lists are checked when their length is known.
    fn check_memory(&self, gaussians: &Gaussians, view: &View, options: &RenderOptions) -> Result<(), SplatError> {
        let channels = &options.channels;
        let images = 4 + u64::from(channels.depth) + u64::from(channels.scalar) + u64::from(channels.median_depth);
        let per_gaussian = (size_of::<project::Splat>() + order::BYTES_EACH + 8) as u64;
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

/// The parts of every image that one row of tiles covers.
pub(crate) struct Band<'a> {
    pub(crate) rgb: &'a mut [[f32; 3]],
    pub(crate) alpha: &'a mut [f32],
    pub(crate) depth: Option<&'a mut [f32]>,
    pub(crate) scalar: Option<&'a mut [f32]>,
    pub(crate) median_depth: Option<&'a mut [f32]>,
}

struct Bands;

impl Bands {
    fn of(rendering: &mut Rendering<f32>, pixels: usize) -> Vec<Band<'_>> {
        let mut depth = rendering.depth.as_mut().map(|image| image.chunks_mut(pixels));
        let mut scalar = rendering.scalar.as_mut().map(|image| image.chunks_mut(pixels));
        let mut median = rendering.median_depth.as_mut().map(|image| image.chunks_mut(pixels));
        let colours = rendering.rgb.chunks_mut(pixels).zip(rendering.alpha.chunks_mut(pixels));
        colours
            .map(|(rgb, alpha)| Band {
                rgb,
                alpha,
                depth: depth.as_mut().and_then(Iterator::next),
                scalar: scalar.as_mut().and_then(Iterator::next),
                median_depth: median.as_mut().and_then(Iterator::next),
            })
            .collect()
    }
}

#[expect(clippy::cast_possible_truncation, reason = "pixels are f32")]
#[inline(always)]
pub(crate) const fn narrowed(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests;
