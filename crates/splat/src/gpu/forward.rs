//! From Gaussians to depth-sorted tile lists.

use super::GpuError;
use super::context::Context;
use super::gaussians::GpuGaussians;
use super::kernels::{Kernel, Pool};
use super::record::Recorder;
use super::sort::{Sorted, scan, sort};
use super::uniforms::{ViewBlock, flag};
use crate::{Census, RenderOptions, sh_coefficients};

/// Side of a tile in pixels.
pub(super) const TILE: u32 = 16;

/// The projected Gaussians and their depth order.
pub(super) struct Scene {
    pub(super) count: u64,
    pub(super) shapes: wgpu::Buffer,
    pub(super) positions: wgpu::Buffer,
    pub(super) splat_colours: wgpu::Buffer,
    pub(super) reaches: wgpu::Buffer,
    /// Indices by depth, nearest first, culled ones last.
    pub(super) order: wgpu::Buffer,
    /// Offsets of each Gaussian's pairs, in that order.
    pub(super) offsets: wgpu::Buffer,
    census: wgpu::Buffer,
}

/// Tiles that are rendered together: half-open ranges of columns and rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Window {
    pub(super) columns: [u32; 2],
    pub(super) rows: [u32; 2],
    /// Index of the image strip that contains it, and the strip's first pixel row.
    pub(super) strip: usize,
    pub(super) first_row: u32,
}

/// The (tile, Gaussian) pairs of a window.
pub(super) struct Lists {
    /// The uniform block, with tiles, pairs and first row filled in.
    pub(super) block: ViewBlock,
    pub(super) window: Window,
    pub(super) pairs: u64,
    /// Index of each pair in the order of `Scene::order`, if requested, and its Gaussian; tile by tile.
    pub(super) sorted: wgpu::Buffer,
    /// The tile's pixels that each pair may reach.
    pub(super) boxes: wgpu::Buffer,
    /// Range of the pairs of each tile.
    pub(super) ranges: wgpu::Buffer,
    /// Length of the longest tile list, or 0 if one dispatch suffices for all.
    longest: u32,
    entries_per_dispatch: u32,
}

impl Lists {
    /// The uniform block of each dispatch over the lists, in order.
    pub(super) fn passes(&self) -> impl Iterator<Item = ViewBlock> {
        let (count, full) = (self.longest.div_ceil(self.entries_per_dispatch).max(1), self.block);
        (0..count).map(move |pass| {
            let mut block = full.with_flag(flag::RESUMES, pass > 0).with_flag(flag::PAUSES, pass + 1 < count);
            block.part = [pass * self.entries_per_dispatch, self.entries_per_dispatch, 0, 0];
            block
        })
    }
}

impl Window {
    pub(super) const fn tiles(&self) -> u64 {
        (self.columns[1] - self.columns[0]) as u64 * (self.rows[1] - self.rows[0]) as u64
    }

    /// Splits the window in two, the upper or left half first; `None` for a single tile.
    fn halves(self) -> Option<[Self; 2]> {
        let cut = |[from, past]: [u32; 2]| (past - from > 1).then(|| from + (past - from) / 2);
        if let Some(middle) = cut(self.rows) {
            let [from, past] = self.rows;
            return Some([Self { rows: [from, middle], ..self }, Self { rows: [middle, past], ..self }]);
        }
        let [from, past] = self.columns;
        let middle = cut(self.columns)?;
        Some([Self { columns: [from, middle], ..self }, Self { columns: [middle, past], ..self }])
    }
}

/// Projects the Gaussians and sorts them by depth.
pub(super) fn project(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    gaussians: &GpuGaussians,
    block: &ViewBlock,
    options: &RenderOptions,
) -> Result<Scene, GpuError> {
    let (context, count) = (recorder.context(), gaussians.len());
    let mut get = |name, each: u64| pool.get(context, name, 0, each * count);
    let (shapes, positions, splat_colours) = (get("shapes", 16)?, get("positions", 16)?, get("splat_colours", 16)?);
    let reaches = get("reaches", 8)?;
    let keys = Sorted { keys: get("depth keys", 4)?, values: get("depth values", 4)? };
    let spare = Sorted { keys: get("spare depth keys", 4)?, values: get("spare depth values", 4)? };
    let offsets = pool.get(context, "offsets", 0, 4 * (count + 1))?;
    let census = pool.get(context, "census", 0, 32)?;

    recorder.clear(&census, 32);
    recorder.stage("project");
    let mut first = 0;
    for part in &gaussians.parts {
        let block = part_block(block, gaussians.sh_degree, options, part, first);
        let dummy = [pool.get(context, "no filter", 0, 4)?, pool.get(context, "no scalar", 0, 4)?];
        let filters = part.filter_3d.as_ref().unwrap_or(&dummy[0]);
        let scalars = part.scalars.as_ref().unwrap_or(&dummy[1]);
        let groups = u64::from(part.count).div_ceil(64);
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
        recorder.dispatch(Kernel::Project, block.bytes(), &buffers, groups)?;
        let buffers = [&part.means, &part.sh, scalars, &reaches, &splat_colours];
        recorder.dispatch(Kernel::Colour, block.bytes(), &buffers, groups)?;
        first += part.count;
    }
    recorder.stage("sort");
    let mut block = *block;
    block.window[3] = first;
    let buffers = [&reaches, &positions, &keys.keys, &keys.values, &census];
    recorder.dispatch(Kernel::Keys, block.bytes(), &buffers, count.div_ceil(64))?;
    let order = sort(recorder, pool, keys, spare, count, u32::BITS)?.values;
    Ok(Scene { count, shapes, positions, splat_colours, reaches, order, offsets, census })
}

/// The uniform block for one part of the Gaussians.
pub(super) fn part_block(
    block: &ViewBlock,
    sh_degree: u8,
    options: &RenderOptions,
    part: &super::GpuPart,
    first: u32,
) -> ViewBlock {
    let degree = if options.max_sh_degree < sh_degree { options.max_sh_degree } else { sh_degree };
    #[expect(clippy::cast_possible_truncation, reason = "at most 25 coefficients")]
    let stored = sh_coefficients(sh_degree) as u32;
    let mut block =
        block.with_flag(flag::HAS_FILTER, part.filter_3d.is_some()).with_flag(flag::HAS_SCALAR, part.scalars.is_some());
    block.part = [part.count, first, stored, degree.into()];
    block
}

/// Calls `with` for windows that cover the given ones in order, split until each has at most `capacity` pairs; returns
/// the census.
pub(super) fn for_windows(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    scene: &Scene,
    block: &ViewBlock,
    (windows, capacity): (Vec<Window>, u64),
    mut with: impl FnMut(&mut Recorder<'_>, &mut Pool, &Lists) -> Result<(), GpuError>,
) -> Result<Census, GpuError> {
    let context = recorder.context();
    let mut census = [0; 8];
    let mut open: Vec<Window> = windows.into_iter().rev().collect();
    while let Some(window) = open.pop() {
        let mut block = *block;
        let [columns, rows] = [window.columns, window.rows];
        block.tiles = [columns[0], rows[0], columns[1] - columns[0], rows[1] - rows[0]];
        block.window = [0, 0, window.first_row, u32::try_from(scene.count).unwrap_or(u32::MAX)];
        recorder.stage("bin");
        let buffers = [&scene.order, &scene.reaches, &scene.offsets];
        recorder.dispatch(Kernel::TileCount, block.bytes(), &buffers, (scene.count + 1).div_ceil(64))?;
        scan(recorder, pool, &scene.offsets, scene.count + 1)?;
        recorder.copy((&scene.offsets, 4 * scene.count), (&scene.census, 28), 4);
        recorder.submit();
        census = read_census(context, &scene.census)?;
        let pairs = u64::from(census[7]);
        if pairs > capacity || (window.tiles() > context.tiles_per_window && window.tiles() > 1) {
            let halves = window.halves().ok_or_else(|| GpuError::TooLarge {
                adapter: context.name.clone(),
                what: "Gaussians of one tile",
                unit: "list entries",
                needed: pairs,
                limit: capacity,
            })?;
            open.extend(halves.into_iter().rev());
            continue;
        }
        block.window[0] = census[7];
        let lists = list(recorder, pool, scene, &block, window, census[0])?;
        with(recorder, pool, &lists)?;
    }
    let [drawn, invalid, outside_depth, faint, outside_picture, ..] = census.map(u64::from);
    Ok(Census { drawn, invalid, outside_depth, faint, outside_picture })
}

/// The (tile, Gaussian) pairs of a window, sorted by tile.
fn list(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    scene: &Scene,
    block: &ViewBlock,
    window: Window,
    drawn: u32,
) -> Result<Lists, GpuError> {
    let (context, count) = (recorder.context(), u64::from(block.window[0]));
    let ranges = pool.get(context, "ranges", 0, 8 * window.tiles())?;
    let with_owners = block.flags() & flag::HAS_OWNERS != 0;
    let owners = pool.get(context, "owners", 0, if with_owners { 4 * count } else { 4 })?;
    let sorted = pool.get(context, "sorted pairs", 0, 8 * count)?;
    let mut get = |name| pool.get(context, name, 0, 4 * count);
    let boxes = get("boxes")?;
    let pairs = Sorted { keys: get("tile keys")?, values: get("tile values")? };
    let spare = Sorted { keys: get("spare tile keys")?, values: get("spare tile values")? };
    recorder.clear(&ranges, 8 * window.tiles());
    recorder.stage("bin");
    if count > 0 {
        let buffers = [&scene.order, &scene.reaches, &scene.offsets, &pairs.keys, &pairs.values, &owners];
        recorder.dispatch(Kernel::Emit, block.bytes(), &buffers, scene.count.div_ceil(64))?;
        let bits = u64::BITS - (window.tiles() - 1).leading_zeros();
        let Sorted { keys, values } = sort(recorder, pool, pairs, spare, count, bits)?;
        let buffers = [&keys, &values, &owners, &scene.reaches, &ranges, &sorted, &boxes];
        recorder.dispatch(Kernel::Ranges, block.bytes(), &buffers, count.div_ceil(64))?;
    }
    let entries_per_dispatch = context.entries_per_dispatch;
    // No list is longer than either; otherwise it is not worth waiting for the device.
    let longest = if drawn > entries_per_dispatch && count > u64::from(entries_per_dispatch) {
        recorder.submit();
        longest(context, &ranges, window)?
    } else {
        0
    };
    Ok(Lists { block: *block, window, pairs: count, sorted, boxes, ranges, longest, entries_per_dispatch })
}

/// Length of the longest tile list.
fn longest(context: &Context, ranges: &wgpu::Buffer, window: Window) -> Result<u32, GpuError> {
    let bytes = context.read(&[(ranges, 8 * window.tiles())])?.concat();
    let words: Vec<u32> = bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
    Ok(words.as_chunks().0.iter().map(|[first, past]| past.saturating_sub(*first)).fold(0, Ord::max))
}

fn read_census(context: &Context, census: &wgpu::Buffer) -> Result<[u32; 8], GpuError> {
    let bytes = context.read(&[(census, 32)])?.concat();
    let mut words = [0; 8];
    for (word, bytes) in words.iter_mut().zip(bytes.as_chunks().0) {
        *word = u32::from_le_bytes(*bytes);
    }
    Ok(words)
}
