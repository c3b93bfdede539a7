//! Recording the forward pass.

use super::context::Context;
use super::forward::{self, Lists, Scene};
use super::gaussians::GpuGaussians;
use super::images::{self, GpuRendering, GpuStrip};
use super::kernels::{Kernel, Pool};
use super::record::Recorder;
use super::uniforms::{ViewBlock, flag};
use super::{GpuError, GpuOptions};
use crate::{Gaussians, RenderOptions, SplatError, View};

/// What to render.
#[derive(Clone, Copy)]
pub(super) struct Job<'a> {
    pub(super) gaussians: &'a GpuGaussians,
    pub(super) view: &'a View,
    pub(super) options: &'a RenderOptions,
}

/// Allocates a buffer by name, part and bytes.
pub(super) type Allocate<'a> = &'a mut dyn FnMut(&mut Pool, &'static str, usize, u64) -> Result<wgpu::Buffer, GpuError>;

/// Records a rendering into buffers allocated by `allocate`.
pub(super) fn record(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    limits: &GpuOptions,
    job: Job<'_>,
    allocate: Allocate<'_>,
) -> Result<GpuRendering, SplatError> {
    let (context, Job { gaussians, view, options }) = (recorder.context(), job);
    options.check()?;
    let optics = view.optics(&options.constants)?;
    let needed = bytes_needed(gaussians, view);
    check_memory(needed, limits.memory_limit)?;
    gaussians.check(context)?;
    let channels = options.channels;
    let with_extras = channels.depth || channels.scalar || channels.median_depth;
    let block = ViewBlock::new(view, &optics, options)
        .with_flag(flag::EXTRAS, with_extras)
        .with_flag(flag::APPLY_EXPOSURE, options.exposure.is_some());

    let strips = images::strips(context, view)?;
    let mut buffers = Vec::new();
    for (at, [_, rows]) in strips.iter().enumerate() {
        let bytes = 16 * u64::from(*rows) * u64::from(view.size.width);
        let extras = with_extras.then(|| allocate(pool, "extras", at, bytes)).transpose()?;
        buffers.push((allocate(pool, "colours", at, bytes)?, extras));
    }
    let scene = forward::project(recorder, pool, gaussians, &block, options)?;
    // Bytes per pair: keys and values twice, digits, sorted pairs, boxes.
    let capacity = pair_capacity(context, limits.memory_limit - needed, 32, 8);
    let windows = (images::windows(&strips, view), capacity);
    let census = forward::for_windows(recorder, pool, &scene, &block, windows, |recorder, pool, lists| {
        let (colours, extras) = &buffers[lists.window.strip];
        composite(recorder, pool, &scene, lists, colours, extras.as_ref())
    })?;
    let strips = strips.iter().zip(buffers).map(|([first_row, rows], (colours, extras))| GpuStrip {
        first_row: *first_row,
        rows: *rows,
        colours,
        extras,
    });
    Ok(GpuRendering { size: view.size, strips: strips.collect(), census, channels })
}

pub(super) fn composite(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    scene: &Scene,
    lists: &Lists,
    colours: &wgpu::Buffer,
    extras: Option<&wgpu::Buffer>,
) -> Result<(), GpuError> {
    let none = pool.get(recorder.context(), "no extras", 0, 16)?;
    let buffers = [
        &scene.shapes,
        &scene.positions,
        &scene.splat_colours,
        &lists.sorted,
        &lists.boxes,
        &lists.ranges,
        colours,
        extras.unwrap_or(&none),
    ];
    recorder.stage("composite");
    for block in lists.passes() {
        recorder.dispatch(Kernel::Composite, block.bytes(), &buffers, lists.window.tiles())?;
    }
    Ok(())
}

/// Bytes on the device for Gaussians, splats and pixels, excluding tile lists.
pub(super) fn bytes_needed(gaussians: &GpuGaussians, view: &View) -> u64 {
    bytes_of_splats(gaussians.len(), view).saturating_add(gaussians.size_in_bytes())
}

fn bytes_of_splats(count: u64, view: &View) -> u64 {
    // Splats 56, keys and values twice 16, offsets 4, digits 2.
    count.saturating_mul(78).saturating_add((view.pixels() as u64).saturating_mul(32))
}

/// Rejects what cannot be rendered within the limit, before it is copied to the device.
pub(super) fn check_memory_before_upload(gaussians: &Gaussians, view: &View, limit: u64) -> Result<(), SplatError> {
    let splats = bytes_of_splats(gaussians.len() as u64, view);
    check_memory(splats.saturating_add(gaussians.size_in_bytes()), limit)
}

/// Number of (tile, Gaussian) pairs that fit, given the bytes per pair in total and in the widest buffer.
pub(super) fn pair_capacity(context: &Context, bytes: u64, per_pair: u64, widest: u64) -> u64 {
    let fitting = [bytes / per_pair, context.binding_limit / widest, u64::from(u32::MAX - 1)];
    fitting.into_iter().fold(u64::MAX, Ord::min)
}

pub(super) const fn check_memory(needed: u64, limit: u64) -> Result<(), SplatError> {
    if needed > limit { Err(SplatError::Memory { needed, limit }) } else { Ok(()) }
}
