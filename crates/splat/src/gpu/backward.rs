//! Recording the backward pass, which repeats the forward pass, because no state is kept from an earlier rendering.

use super::bounds::{Key, Plan};
use super::context::Context;
use super::forward::{self, Scene, TILE};
use super::gaussians::GpuPart;
use super::gradients::{GpuGradientPart, GpuGradients, GpuImageGradients, GpuStripGradients};
use super::job::Job;
use super::kernels::{Kernel, Pool};
use super::lists::{Lists, list};
use super::record::Recorder;
use super::render::{Resources, bytes_needed, bytes_of_least_lists, check_memory, composite, pair_capacity};
use super::sort::{word, words};
use super::uniforms::{ViewBlock, flag};
use super::{GpuError, GpuOptions, layout};
use crate::{SplatError, View, sh_coefficients};

/// Sums over pixels, per Gaussian.
struct Sums {
    firsts: wgpu::Buffer,
    seconds: wgpu::Buffer,
    colours: wgpu::Buffer,
    /// Gradient of the background, per pixel row.
    rows: wgpu::Buffer,
    /// Contributions to the pose gradient, per Gaussian.
    rotations: wgpu::Buffer,
    translations: wgpu::Buffer,
}

/// Of lists: keys and values twice, digits, sorted pairs, boxes, owners, sums.
const BYTES_PER_PAIR: u64 = 84;

/// Of a pair's sums over pixels.
const BYTES_OF_SUMS: u64 = 4 * layout::PAIR_SUMS as u64;

/// Rejects what has no gradients.
pub(super) fn check(
    context: &Context,
    limits: &GpuOptions,
    job: Job<'_>,
    images: &GpuImageGradients,
) -> Result<(), SplatError> {
    job.check(context)?;
    let lists = bytes_of_least_lists(job.splats(), BYTES_PER_PAIR);
    check_memory(bytes_with_gradients(job).saturating_add(lists), limits.memory_limit)?;
    job.gaussians.check(context)?;
    check_images(context, &job.strips(context)?, job.view(), images)
}

/// Bytes on the device, excluding tile lists.
fn bytes_with_gradients(job: Job<'_>) -> u64 {
    // Bytes per splat: sums 48, pose 32, records 96; per Gaussian: gradients of its parameters, of 5 projected values and of the
    // screen; per pixel two more images and its gradients. In a batch, each view has its own gradients of colours.
    let copies = if job.is_batch() { 1 + u64::from(job.views_of_scene()) } else { 1 };
    let of_parameters = copies.saturating_mul(job.gaussians.size_in_bytes());
    let of_splats = job.splats().saturating_mul(176);
    let of_projections = job.gaussians.len().saturating_mul(28);
    let of_pixels = job.pixels().saturating_mul(80);
    [of_parameters, of_splats, of_projections, of_pixels].into_iter().fold(bytes_needed(job), u64::saturating_add)
}

/// Records the backward pass of a checked job.
pub(super) fn record(
    recorder: &mut Recorder<'_>,
    resources: Resources<'_>,
    job: Job<'_>,
    (images, gradients, absolute): (&GpuImageGradients, &GpuGradients, bool),
) -> Result<Plan, SplatError> {
    let (context, count) = (recorder.context(), job.splats());
    let Resources { pool, limits, bounds, report } = resources;
    let flags = [
        (flag::EXTRAS, true),
        (flag::HAS_OWNERS, true),
        (flag::EXPOSED_LOSS, job.options.exposure.is_some()),
        (flag::ABSOLUTE, absolute),
    ];
    let blocks = job.blocks(&flags)?;
    let strips = job.strips(context)?;
    let room = limits.memory_limit.saturating_sub(bytes_with_gradients(job));
    let most = pair_capacity(context, room, BYTES_PER_PAIR, BYTES_OF_SUMS);
    let (plan, windows) = bounds.plan(context, Key::new(job, true), (&strips, job), most);

    let scene = forward::project(recorder, pool, job, &blocks, report)?;
    let rows = u64::from(job.size().height);
    let sums = Sums {
        firsts: pool.get(context, "first moments", 0, 16 * count)?,
        seconds: pool.get(context, "second moments", 0, 16 * count)?,
        colours: pool.get(context, "colour gradient sums", 0, 16 * count)?,
        rows: pool.get(context, "background gradient sums", 0, 16 * rows)?,
        rotations: pool.get(context, "rotation gradients", 0, 16 * count)?,
        translations: pool.get(context, "translation gradients", 0, 16 * count)?,
    };
    for buffer in [&sums.firsts, &sums.seconds, &sums.colours] {
        recorder.clear(buffer, 16 * count);
    }
    for window in windows {
        let lists = list(recorder, pool, &scene, &blocks[0], (&plan, window, report))?;
        let size = [job.size().width, strips[window.strip][1]];
        composite_backward(recorder, pool, &scene, (&lists, plan.capacity), &sums, &images.strips[window.strip], size)?;
    }

    recorder.stage("project backward");
    let mut first = 0;
    for (part, gradients) in job.gaussians.parts.iter().zip(&gradients.parts) {
        part_gradients(recorder, pool, (job, &blocks, first), (&scene, &sums), (part, gradients))?;
        first += part.count;
    }
    for (at, (vectors, count)) in
        [(&sums.rotations, count), (&sums.translations, count), (&sums.rows, rows)].into_iter().enumerate()
    {
        reduce(recorder, pool, vectors, count, (&gradients.pose_and_background, 16 * at as u64))?;
    }
    Ok(plan)
}

/// Backward pass of one window: pixels, their gradients, sums over each tile's pixels, sums over tiles.
fn composite_backward(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    scene: &Scene,
    (lists, capacity): (&Lists, u64),
    sums: &Sums,
    images: &GpuStripGradients,
    [width, rows]: [u32; 2],
) -> Result<(), GpuError> {
    let context = recorder.context();
    let pixels = u64::from(width) * u64::from(rows);
    let colours = pool.get(context, "colours", lists.window.strip, 16 * pixels)?;
    let extras = pool.get(context, "extras", lists.window.strip, 16 * pixels)?;
    composite(recorder, pool, scene, lists, &colours, Some(&extras))?;

    let seeds = pool.get(context, "seeds", 0, 32 * pixels)?;
    let d_background = pool.get(context, "background gradients", 0, 16 * pixels)?;
    let none = pool.get(context, "no extra gradients", 0, 16)?;
    let d_pair = pool.get(context, "pair sums", 0, BYTES_OF_SUMS * capacity)?;
    recorder.clear(&d_pair, BYTES_OF_SUMS * capacity);
    recorder.stage("composite backward");
    let mut block = lists.block;
    block.window[0] = word(pixels);
    let extra_gradients = images.extras.as_ref().unwrap_or(&none);
    let block = block.with_flag(flag::EXTRA_GRADIENTS, images.extras.is_some());
    let buffers = [&images.colours, extra_gradients, &colours, &extras, &seeds, &d_background];
    recorder.dispatch(Kernel::PixelGradients, block.bytes(), &buffers, pixels.div_ceil(64))?;
    for first in (0..width).step_by(context.columns_per_dispatch as usize) {
        let mut block = block;
        block.part = [first, context.columns_per_dispatch, 0, 0];
        recorder.dispatch(
            Kernel::RowSums,
            block.bytes(),
            &[&d_background, &sums.rows],
            u64::from(rows).div_ceil(64),
        )?;
    }
    let buffers = [
        &scene.shapes,
        &scene.positions,
        &scene.splat_colours,
        &lists.sorted,
        &lists.boxes,
        &lists.ranges,
        &seeds,
        &d_pair,
    ];
    for block in lists.passes() {
        recorder.dispatch(context.composite_backward(), block.bytes(), &buffers, lists.window.tiles())?;
    }
    let buffers = [&scene.order, &scene.offsets, &d_pair, &sums.firsts, &sums.seconds, &sums.colours];
    recorder.dispatch(Kernel::Gather, block.bytes(), &buffers, scene.count.div_ceil(64))
}

/// Backward pass from splats to one part's Gaussians, and their contributions to the pose gradient.
fn part_gradients(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    (job, blocks, first): (Job<'_>, &[ViewBlock], u32),
    (scene, sums): (&Scene, &Sums),
    (part, gradients): (&GpuPart, &GpuGradientPart),
) -> Result<(), GpuError> {
    let context = recorder.context();
    let (uniform, splats) = job.launch(context, blocks, (part, first));
    let records = pool.get(context, "records", 0, 4 * u64::from(layout::RECORD) * splats)?;
    let dummies = [pool.get(context, "no filter", 0, 4)?, pool.get(context, "no scalar gradient", 0, 4)?];
    let sh_bytes = 4 * numbers_of_sh(job);
    // In a batch, views have their own gradients at first.
    let mut of_views = |name, each: u64| pool.get(context, name, 0, if job.is_batch() { each * splats } else { 4 });
    let for_views = [of_views("SH gradients of views", sh_bytes)?, of_views("scalar gradients of views", 4)?];
    let [d_sh, d_scalars] = match &gradients.scalars {
        _ if job.is_batch() => for_views.each_ref(),
        Some(scalars) => [&gradients.sh, scalars],
        None => [&gradients.sh, &dummies[1]],
    };
    let groups = splats.div_ceil(64);
    let buffers = [&part.means, &part.sh, &sums.seconds, &sums.colours, &scene.reaches, &records, d_sh, d_scalars];
    recorder.dispatch(Kernel::ColourBackward.of_batch(job.is_batch()), &uniform, &buffers, groups)?;
    let buffers = [
        &part.means,
        &part.quaternions,
        &part.log_scales,
        &part.opacity_logits,
        part.filter_3d.as_ref().unwrap_or(&dummies[0]),
        &sums.firsts,
        &sums.seconds,
        &records,
    ];
    recorder.dispatch(Kernel::ProjectBackward.of_batch(job.is_batch()), &uniform, &buffers, groups)?;
    unpack(recorder, (job, splats, first), [&records, d_sh, d_scalars], sums, gradients)
}

/// Numbers of a Gaussian's SH coefficients.
fn numbers_of_sh(job: Job<'_>) -> u64 {
    3 * sh_coefficients(job.gaussians.sh_degree) as u64
}

/// From what the kernels wrote for each splat to the gradients of one part's Gaussians and the contributions to the pose gradient;
/// in a batch, gradients of Gaussians are summed over views.
fn unpack(
    recorder: &mut Recorder<'_>,
    (job, splats, first): (Job<'_>, u64, u32),
    [records, d_sh, d_scalars]: [&wgpu::Buffer; 3],
    sums: &Sums,
    gradients: &GpuGradientPart,
) -> Result<(), GpuError> {
    let records = (records, u64::from(layout::RECORD));
    let of_splats = [splats, splats, 1];
    let of_gaussians = if job.is_batch() {
        [job.gaussians.len(), job.gaussians_of_scene(), job.views_of_scene().into()]
    } else {
        of_splats
    };
    let fields = [
        Unpacked::new(&gradients.means, layout::OF_MEAN, 3),
        Unpacked::new(&gradients.quaternions, layout::OF_QUATERNION, 4),
        Unpacked::new(&gradients.log_scales, layout::OF_LOG_SCALES, 3),
        Unpacked::new(&gradients.opacity_logits, layout::OF_LOGIT, 1),
        Unpacked::new(&gradients.means_2d, layout::OF_CENTRE, 2),
        Unpacked::new(&gradients.conics, layout::OF_CONIC, 3),
    ];
    let screen = gradients.screen.as_ref().map(|screen| Unpacked::new(screen, layout::OF_SCREEN, 2));
    for field in fields.iter().chain(&screen) {
        field.unpack(recorder, records, of_gaussians)?;
    }
    for (result, from) in [(&sums.rotations, layout::OF_ROTATION), (&sums.translations, layout::OF_TRANSLATION)] {
        let field = Unpacked { stride: 4, first: first.into(), ..Unpacked::new(result, from, 3) };
        field.unpack(recorder, records, of_splats)?;
    }
    if job.is_batch() {
        let numbers = numbers_of_sh(job);
        Unpacked::new(&gradients.sh, 0, numbers).unpack(recorder, (d_sh, numbers), of_gaussians)?;
        if let Some(scalars) = &gradients.scalars {
            Unpacked::new(scalars, 0, 1).unpack(recorder, (d_scalars, 1), of_gaussians)?;
        }
    }
    Ok(())
}

/// Where some numbers of each record go.
#[derive(Clone, Copy)]
struct Unpacked<'a> {
    result: &'a wgpu::Buffer,
    /// Of the first in a record, and how many.
    from: u64,
    width: u64,
    /// Numbers of each Gaussian in the result, and its first Gaussian there.
    stride: u64,
    first: u64,
}

impl<'a> Unpacked<'a> {
    /// Numbers that fill the result.
    fn new(result: &'a wgpu::Buffer, from: u32, width: u64) -> Self {
        Self { result, from: from.into(), width, stride: width, first: 0 }
    }

    /// From records of `numbers` each: of `count` Gaussians, `each` per scene, summed over its `views`.
    fn unpack(
        &self,
        recorder: &mut Recorder<'_>,
        (records, numbers): (&wgpu::Buffer, u64),
        [count, each, views]: [u64; 3],
    ) -> Result<(), GpuError> {
        let Self { result, from, width, stride, first } = *self;
        let uniform = [words(&[count, from, width, stride]), words(&[first, numbers, each, views])].concat();
        recorder.dispatch(Kernel::Unpack, &uniform, &[records, result], count.div_ceil(64))
    }
}

/// Sums vectors as a tree, into `result` at `offset`.
fn reduce(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    vectors: &wgpu::Buffer,
    count: u64,
    (result, offset): (&wgpu::Buffer, u64),
) -> Result<(), GpuError> {
    let (mut vectors, mut count, mut level) = (vectors.clone(), count, 0);
    loop {
        let blocks = count.div_ceil(1024).max(1);
        let sums = pool.get(recorder.context(), "tree", level, 16 * blocks)?;
        recorder.dispatch(Kernel::Reduce, &words(&[count, blocks, 0, 0]), &[&vectors, &sums], blocks)?;
        if blocks == 1 {
            recorder.copy((&sums, 0), (result, offset), 16);
            return Ok(());
        }
        (vectors, count, level) = (sums, blocks, level + 1);
    }
}

fn check_images(
    context: &Context,
    strips: &[[u32; 2]],
    view: &View,
    images: &GpuImageGradients,
) -> Result<(), SplatError> {
    let mismatch = |expected: usize, found: usize| SplatError::Length { field: "strips of gradients", expected, found };
    if images.strips.len() != strips.len() {
        return Err(mismatch(strips.len(), images.strips.len()));
    }
    for ([_, rows], strip) in strips.iter().zip(&images.strips) {
        let expected = 4 * *rows as usize * view.size.width as usize;
        for buffer in std::iter::once(&strip.colours).chain(strip.extras.as_ref()) {
            let found = usize::try_from(buffer.size() / 4).unwrap_or(usize::MAX);
            if found < expected {
                return Err(SplatError::Length { field: "numbers of a strip of gradients", expected, found });
            }
            context.check_binding("gradients of a strip", buffer, 4 * expected as u64)?;
        }
    }
    debug_assert!(strips.iter().all(|[first, _]| first % TILE == 0));
    Ok(())
}
