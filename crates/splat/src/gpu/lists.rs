//! Tile lists: which Gaussians reach which tile, by tile and depth.

use super::GpuError;
use super::bounds::Plan;
use super::forward::Scene;
use super::kernels::{Kernel, Pool};
use super::record::Recorder;
use super::sort::{Items, Sorted, scan, sort, word};
use super::uniforms::{ViewBlock, flag};
use super::windows::Window;

/// The (tile, Gaussian) pairs of a window.
pub(super) struct Lists {
    /// The uniform block, with tiles, capacity and first row filled in.
    pub(super) block: ViewBlock,
    pub(super) window: Window,
    /// Index of each pair in the order of `Scene::order`, if requested, and its Gaussian; tile by tile.
    pub(super) sorted: wgpu::Buffer,
    /// The tile's pixels that each pair may reach.
    pub(super) boxes: wgpu::Buffer,
    /// Range of the pairs of each tile.
    pub(super) ranges: wgpu::Buffer,
    passes: u32,
    entries_per_dispatch: u32,
}

impl Lists {
    /// The uniform block of each dispatch over the lists, in order.
    pub(super) fn passes(&self) -> impl Iterator<Item = ViewBlock> {
        let (each, block) = (self.entries_per_dispatch, self.block);
        (0..self.passes).map(move |pass| {
            let mut block = block.with_flag(flag::RESUMES, pass > 0);
            block.part = [pass.saturating_mul(each), each, 0, 0];
            block
        })
    }
}

/// Lists the pairs of a window, and reports in `report` what they need. If they need more than the plan holds, none is
/// listed.
pub(super) fn list(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    scene: &Scene,
    block: &ViewBlock,
    (plan, window, report): (&Plan, Window, &wgpu::Buffer),
) -> Result<Lists, GpuError> {
    let (context, capacity, tiles) = (recorder.context(), plan.capacity, window.tiles());
    let [columns, rows] = [window.columns, window.rows];
    let mut block = *block;
    block.tiles = [columns[0], rows[0], columns[1] - columns[0], rows[1] - rows[0]];
    block.window = [0, word(capacity), window.first_row, word(scene.count)];

    let ranges = pool.get(context, "ranges", 0, 8 * tiles)?;
    let with_owners = block.flags() & flag::HAS_OWNERS != 0;
    let owners = pool.get(context, "owners", 0, if with_owners { 4 * capacity } else { 4 })?;
    let sorted = pool.get(context, "sorted pairs", 0, 8 * capacity)?;
    let mut get = |name| pool.get(context, name, 0, 4 * capacity);
    let boxes = get("boxes")?;
    let pairs = Sorted { keys: get("tile keys")?, values: get("tile values")? };
    let spare = Sorted { keys: get("spare tile keys")?, values: get("spare tile values")? };

    recorder.clear(&ranges, 8 * tiles);
    recorder.stage("bin");
    let Scene { shapes, positions, reaches, order, offsets, masks, .. } = scene;
    let buffers = [order, reaches, shapes, positions, offsets, masks];
    recorder.dispatch(Kernel::TileCount, block.bytes(), &buffers, (scene.count + 1).div_ceil(64))?;
    scan(recorder, pool, offsets, scene.count + 1)?;
    let buffers = [order, reaches, offsets, &pairs.keys, &pairs.values, &owners, &ranges, masks];
    let mut emit = block;
    emit.part = [word(plan.most), 0, 0, 0];
    recorder.dispatch(Kernel::Emit, emit.bytes(), &buffers, scene.count.div_ceil(64))?;
    let items = Items::Counted { totals: offsets, at: scene.count, bound: capacity };
    let bits = u64::BITS - (tiles - 1).leading_zeros();
    let Sorted { keys, values } = sort(recorder, pool, pairs, spare, items, bits)?;
    let buffers = [&keys, &values, &owners, reaches, &ranges, &sorted, &boxes, offsets];
    recorder.dispatch(Kernel::Ranges, block.bytes(), &buffers, capacity.div_ceil(64))?;
    let entries_per_dispatch = context.entries_per_dispatch;
    let mut needs = block;
    needs.part = [0, plan.passes.saturating_mul(entries_per_dispatch), 0, 0];
    recorder.dispatch(Kernel::Needs, needs.bytes(), &[offsets, &ranges, report], tiles.div_ceil(64))?;
    Ok(Lists { block, window, sorted, boxes, ranges, passes: plan.passes, entries_per_dispatch })
}
