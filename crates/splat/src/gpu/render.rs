//! Recording the forward pass.

use super::bounds::{Bounds, Key, Plan};
use super::context::Context;
use super::forward::{self, Scene};
use super::gaussians::GpuGaussians;
use super::images::{self, GpuRendering};
use super::kernels::{Kernel, Pool};
use super::lists::{Lists, list};
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

/// What recording needs besides the job: buffers between stages, limits, and how long lists have to be.
pub(super) struct Resources<'a> {
    pub(super) pool: &'a mut Pool,
    pub(super) limits: &'a GpuOptions,
    pub(super) bounds: &'a Bounds,
    /// Where the device reports whether the result is complete; see [`super::status::Status`].
    pub(super) report: &'a wgpu::Buffer,
}

/// Allocates a buffer by name, part and bytes.
pub(super) type Allocate<'a> = &'a mut dyn FnMut(&mut Pool, &'static str, usize, u64) -> Result<wgpu::Buffer, GpuError>;

/// Rejects what cannot be rendered.
pub(super) fn check(context: &Context, limits: &GpuOptions, job: Job<'_>) -> Result<(), SplatError> {
    job.options.check()?;
    job.view.optics(&job.options.constants)?;
    check_memory(bytes_needed(job.gaussians, job.view), limits.memory_limit)?;
    Ok(job.gaussians.check(context)?)
}

/// Records a rendering of a checked job.
pub(super) fn record(
    recorder: &mut Recorder<'_>,
    resources: Resources<'_>,
    job: Job<'_>,
    rendering: &GpuRendering,
) -> Result<Plan, SplatError> {
    let (context, Job { gaussians, view, options }) = (recorder.context(), job);
    let Resources { pool, limits, bounds, report } = resources;
    let optics = view.optics(&options.constants)?;
    let block = ViewBlock::new(view, &optics, options)
        .with_flag(flag::EXTRAS, images::with_extras(options.channels))
        .with_flag(flag::APPLY_EXPOSURE, options.exposure.is_some());
    let strips = images::strips(context, view)?;
    // Bytes per pair: keys and values twice, digits, sorted pairs, boxes.
    let room = limits.memory_limit.saturating_sub(bytes_needed(gaussians, view));
    let most = pair_capacity(context, room, 32, 8);
    let (plan, windows) = bounds.plan(context, Key::new(gaussians, view, false), (&strips, view), most);

    let scene = forward::project(recorder, pool, gaussians, &block, options, report)?;
    for window in windows {
        let lists = list(recorder, pool, &scene, &block, (&plan, window, report))?;
        let strip = &rendering.strips[window.strip];
        composite(recorder, pool, &scene, &lists, &strip.colours, strip.extras.as_ref())?;
    }
    Ok(plan)
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
    // Splats 56, keys and values twice 16, offsets 4, masks 4, digits 2.
    count.saturating_mul(82).saturating_add((view.pixels() as u64).saturating_mul(32))
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
