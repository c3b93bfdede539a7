use atsplat_camera::ImageSize;

use super::GpuError;
use super::context::Context;
use super::forward::TILE;
use super::job::Job;
use super::kernels::Pool;
use super::render::Allocate;
use crate::{Channels, GaussianCounts, Rendering, SplatError, View};

/// Images in device memory, split into strips of rows that the adapter can bind.
#[derive(Clone, Debug)]
pub struct GpuRendering {
    /// In pixels; of a batch, that of its images stacked vertically.
    pub size: ImageSize,
    /// From top to bottom.
    pub strips: Vec<GpuStrip>,
    pub(super) channels: Channels,
}

/// Some rows of the image: four f32 per pixel in each buffer, row-major.
#[derive(Clone, Debug)]
pub struct GpuStrip {
    /// First pixel row.
    pub first_row: u32,
    /// Number of pixel rows.
    pub rows: u32,
    /// Red, green, blue over the background, and alpha.
    pub colours: wgpu::Buffer,
    /// Depth, scalar, median depth and transmittance, if any of them was requested.
    pub extras: Option<wgpu::Buffer>,
}

/// Bytes of the largest per-pixel record.
const PIXEL_BYTES: u64 = 32;

/// First row and number of rows of each strip of an image, or of the stacked images of a batch, which have to fit one.
pub(super) fn strips(context: &Context, view: &View, images: u32) -> Result<Vec<[u32; 2]>, SplatError> {
    view.check_size()?;
    let bytes = PIXEL_BYTES * u64::from(images) * view.pixels() as u64;
    if images > 1 && bytes > context.binding_limit {
        let (adapter, limit) = (context.name.clone(), context.binding_limit);
        return Err(
            GpuError::TooLarge { adapter, what: "pixels of a batch", unit: "bytes", needed: bytes, limit }.into()
        );
    }
    if images > 1 {
        return Ok(vec![[0, images * view.size.height]]);
    }
    let row_of_tiles = PIXEL_BYTES * u64::from(TILE) * u64::from(view.size.width);
    let fitting = u32::try_from(context.binding_limit / row_of_tiles).unwrap_or(u32::MAX).min(u32::MAX / TILE);
    if fitting == 0 {
        let adapter = context.name.clone();
        let limit = context.binding_limit;
        let what = "pixels of one row of tiles";
        return Err(GpuError::TooLarge { adapter, what, unit: "bytes", needed: row_of_tiles, limit }.into());
    }
    let rows = fitting * TILE;
    let strip = |first: u32| [first, rows.min(view.size.height - first)];
    Ok((0..view.size.height).step_by(rows as usize).map(strip).collect())
}

/// Whether there are images besides colour and alpha.
pub(super) const fn with_extras(channels: Channels) -> bool {
    channels.depth || channels.scalar || channels.median_depth
}

impl GpuRendering {
    /// Allocates images for a rendering.
    pub(super) fn allocate(
        context: &Context,
        pool: &mut Pool,
        job: Job<'_>,
        allocate: Allocate<'_>,
    ) -> Result<Self, SplatError> {
        let (view, channels) = (job.view(), job.options.channels);
        let mut buffers = Vec::new();
        for (at, [first_row, rows]) in job.strips(context)?.into_iter().enumerate() {
            let bytes = 16 * u64::from(rows) * u64::from(view.size.width);
            let extras = with_extras(channels).then(|| allocate(pool, "extras", at, bytes)).transpose()?;
            buffers.push(GpuStrip { first_row, rows, colours: allocate(pool, "colours", at, bytes)?, extras });
        }
        Ok(Self { size: job.size(), strips: buffers, channels })
    }

    /// What to copy to the host: the colours of each strip, then its other images.
    pub(super) fn sources(&self) -> Vec<(&wgpu::Buffer, u64)> {
        let bytes = |strip: &GpuStrip| 16 * u64::from(strip.rows) * u64::from(self.size.width);
        let colours = self.strips.iter().map(|strip| (&strip.colours, bytes(strip)));
        let extras = self.strips.iter().filter_map(|strip| Some((strip.extras.as_ref()?, bytes(strip))));
        colours.chain(extras).collect()
    }

    /// The images from their copies.
    pub(super) fn arrange(&self, contents: &[Vec<u8>], counts: GaussianCounts) -> Rendering<f32> {
        let (colours, extras) = contents.split_at(self.strips.len().min(contents.len()));
        let of_extras = |requested: bool, channel: usize| requested.then(|| each(extras, |four| four[channel]));
        Rendering {
            size: self.size,
            rgb: each(colours, |[red, green, blue, _]| [red, green, blue]),
            alpha: each(colours, |[.., alpha]| alpha),
            depth: of_extras(self.channels.depth, 0),
            scalar: of_extras(self.channels.scalar, 1),
            median_depth: of_extras(self.channels.median_depth, 2),
            counts,
        }
    }
}

/// A value of each pixel of strips of four f32.
fn each<T>(strips: &[Vec<u8>], value: impl Fn([f32; 4]) -> T) -> Vec<T> {
    let mut values = Vec::with_capacity(strips.iter().map(|bytes| bytes.len() / 16).sum());
    for bytes in strips {
        values.extend(bytes.as_chunks::<16>().0.iter().map(|four| value(bytemuck::cast(*four))));
    }
    values
}
