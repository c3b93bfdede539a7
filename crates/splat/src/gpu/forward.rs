//! From Gaussians to splats, sorted by depth.

use super::GpuError;
use super::job::Job;
use super::kernels::{Kernel, Pool};
use super::record::Recorder;
use super::sort::{Items, Sorted, sort, word};
use super::status;
use super::uniforms::ViewBlock;

/// Side of a tile in pixels.
pub(super) const TILE: u32 = 16;

/// The splats and their depth order.
pub(super) struct Scene {
    pub(super) count: u64,
    pub(super) shapes: wgpu::Buffer,
    pub(super) positions: wgpu::Buffer,
    pub(super) splat_colours: wgpu::Buffer,
    pub(super) reaches: wgpu::Buffer,
    /// Indices by depth, nearest first, culled ones last.
    pub(super) order: wgpu::Buffer,
    /// Offsets of each splat's pairs in a window, in that order; the number of all pairs last.
    pub(super) offsets: wgpu::Buffer,
    /// Which tiles those are.
    pub(super) masks: wgpu::Buffer,
}

/// Projects the Gaussians and sorts their splats by depth; counts them in `report`.
pub(super) fn project(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    job: Job<'_>,
    blocks: &[ViewBlock],
    report: &wgpu::Buffer,
) -> Result<Scene, GpuError> {
    let (context, count) = (recorder.context(), job.splats());
    let mut get = |name, each: u64| pool.get(context, name, 0, each * count);
    let (shapes, positions, splat_colours) = (get("shapes", 16)?, get("positions", 16)?, get("splat_colours", 16)?);
    let reaches = get("reaches", 8)?;
    let keys = Sorted { keys: get("depth keys", 4)?, values: get("depth values", 4)? };
    let spare = Sorted { keys: get("spare depth keys", 4)?, values: get("spare depth values", 4)? };
    let masks = get("masks", 4)?;
    let offsets = pool.get(context, "offsets", 0, 4 * (count + 1))?;

    recorder.clear(report, status::BYTES);
    recorder.stage("project");
    let mut first = 0;
    for part in &job.gaussians.parts {
        let (uniform, threads) = job.launch(context, blocks, (part, first));
        let dummy = [pool.get(context, "no filter", 0, 4)?, pool.get(context, "no scalar", 0, 4)?];
        let filters = part.filter_3d.as_ref().unwrap_or(&dummy[0]);
        let scalars = part.scalars.as_ref().unwrap_or(&dummy[1]);
        let groups = threads.div_ceil(64);
        let buffers = [
            &part.means,
            &part.quaternions,
            &part.log_scales,
            &part.opacity_logits,
            filters,
            &shapes,
            &positions,
            &reaches,
        ];
        recorder.dispatch(Kernel::Project.of_batch(job.is_batch()), &uniform, &buffers, groups)?;
        let buffers = [&part.means, &part.sh, scalars, &reaches, &splat_colours];
        recorder.dispatch(Kernel::Colour.of_batch(job.is_batch()), &uniform, &buffers, groups)?;
        first += part.count;
    }
    recorder.stage("sort");
    let mut block = blocks[0];
    block.window[3] = word(count);
    let buffers = [&reaches, &positions, &keys.keys, &keys.values, report];
    recorder.dispatch(Kernel::Keys, block.bytes(), &buffers, count.div_ceil(64))?;
    let order = sort(recorder, pool, keys, spare, Items::Known(count), u32::BITS)?.values;
    Ok(Scene { count, shapes, positions, splat_colours, reaches, order, offsets, masks })
}
