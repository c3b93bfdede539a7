//! Recording the forward pass.

use super::bounds::{Bounds, Key, Plan};
use super::context::Context;
use super::forward::{self, Scene};
use super::images::{self, GpuRendering};
use super::job::Job;
use super::kernels::{Kernel, Pool};
use super::lists::{Lists, list};
use super::record::Recorder;
use super::uniforms::flag;
use super::{GpuError, GpuOptions};
use crate::{Gaussians, SplatError, View};

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

/// Of lists: keys and values twice, digits, sorted pairs, boxes.
const BYTES_PER_PAIR: u64 = 32;

/// Rejects what cannot be rendered.
pub(super) fn check(context: &Context, limits: &GpuOptions, job: Job<'_>) -> Result<(), SplatError> {
    job.check(context)?;
    let lists = bytes_of_least_lists(job.splats(), BYTES_PER_PAIR);
    check_memory(bytes_needed(job).saturating_add(lists), limits.memory_limit)?;
    Ok(job.gaussians.check(context)?)
}

/// Records a rendering of a checked job.
pub(super) fn record(
    recorder: &mut Recorder<'_>,
    resources: Resources<'_>,
    job: Job<'_>,
    rendering: &GpuRendering,
) -> Result<Plan, SplatError> {
    let (context, options) = (recorder.context(), job.options);
    let Resources { pool, limits, bounds, report } = resources;
    let flags =
        [(flag::EXTRAS, images::with_extras(options.channels)), (flag::APPLY_EXPOSURE, options.exposure.is_some())];
    let blocks = job.blocks(&flags)?;
    let strips = job.strips(context)?;
    let room = limits.memory_limit.saturating_sub(bytes_needed(job));
    let most = pair_capacity(context, room, BYTES_PER_PAIR, 8);
    let (plan, windows) = bounds.plan(context, Key::new(job, false), (&strips, job), most);

    let scene = forward::project(recorder, pool, job, &blocks, report)?;
    for window in windows {
        let lists = list(recorder, pool, &scene, &blocks[0], (&plan, window, report))?;
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
pub(super) fn bytes_needed(job: Job<'_>) -> u64 {
    bytes_of_splats(job.splats(), job.pixels()).saturating_add(job.gaussians.size_in_bytes())
}

const fn bytes_of_splats(count: u64, pixels: u64) -> u64 {
    // Splats 56, keys and values twice 16, offsets 4, masks 4, digits 2.
    count.saturating_mul(82).saturating_add(pixels.saturating_mul(32))
}

/// Bytes of lists for a pair per ten splats. With shorter lists, windows would be so small that their kernels would go through the
/// splats thousands of times.
pub(super) const fn bytes_of_least_lists(splats: u64, per_pair: u64) -> u64 {
    (splats / 10).saturating_mul(per_pair)
}

/// Rejects what cannot be rendered within the limit, before it is copied to the device.
pub(super) fn check_memory_before_upload(gaussians: &Gaussians, view: &View, limit: u64) -> Result<(), SplatError> {
    let count = gaussians.len() as u64;
    let others = gaussians.size_in_bytes().saturating_add(bytes_of_least_lists(count, BYTES_PER_PAIR));
    check_memory(bytes_of_splats(count, view.pixels() as u64).saturating_add(others), limit)
}

/// Number of (tile, Gaussian) pairs that fit, given the bytes per pair in total and in the widest buffer.
pub(super) fn pair_capacity(context: &Context, bytes: u64, per_pair: u64, widest: u64) -> u64 {
    let fitting = [bytes / per_pair, context.binding_limit / widest, u64::from(u32::MAX - 1)];
    fitting.into_iter().fold(u64::MAX, Ord::min)
}

pub(super) const fn check_memory(needed: u64, limit: u64) -> Result<(), SplatError> {
    if needed > limit { Err(SplatError::Memory { needed, limit }) } else { Ok(()) }
}
