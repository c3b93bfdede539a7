//! Tests of internals: limits of drivers, and pooled buffers.

use std::collections::BTreeSet;

use atsplat_tests::{skip, skip_without_graphics};

use super::context::Context;
use super::kernels::{Kernel, Pipelines, Pool};
use super::record::Recorder;
use super::status::{self, Status};
use super::{AdapterChoice, GpuError, GpuOptions, GpuRenderer, ImageFormat, ImageNumbers, adapters};
use crate::{GaussianParts, Gaussians, ImageGradients, RenderOptions, Renderer, SplatError, View, reference};

/// `None` if there is no adapter and none is required.
fn opened<T>(opened: Result<T, GpuError>) -> Option<T> {
    match opened {
        Ok(opened) => Some(opened),
        Err(error @ GpuError::NoAdapter { .. }) => {
            skip_without_graphics("splat::gpu", error);
            None
        }
        Err(error) => panic!("{error}"),
    }
}

fn context(options: &GpuOptions) -> Option<Context> {
    let chosen = adapters::choose(&AdapterChoice::Automatic);
    opened(chosen.and_then(|(adapter, description)| Context::open(&adapter, &description, options)))
}

fn scene() -> (Gaussians, View) {
    let spread = |n: u16, step: f32| (f32::from(n) * step).sin();
    let count = 400;
    let parts = GaussianParts {
        means: (0..count).map(|n| [1.5 * spread(n, 1.3), spread(n, 2.1), 3.0 + spread(n, 0.7)]).collect(),
        quaternions: (0..count).map(|n| [1.0, spread(n, 0.3), spread(n, 0.4), spread(n, 0.5)]).collect(),
        log_scales: (0..count).map(|n| [-2.0 + spread(n, 0.9), -2.5, -3.0]).collect(),
        opacity_logits: (0..count).map(|n| spread(n, 0.6)).collect(),
        sh: (0..count).map(|n| [spread(n, 0.8), spread(n, 1.8), spread(n, 2.8)]).collect(),
        ..GaussianParts::default()
    };
    let camera = atsplat_camera::Camera::pinhole(
        atsplat_camera::CameraFromWorld::IDENTITY,
        atsplat_camera::NormalizedIntrinsics::new(0.9, 1.2, 0.5, 0.5).unwrap(),
    );
    (Gaussians::new(parts).unwrap(), View { camera, size: atsplat_camera::ImageSize { width: 90, height: 70 } })
}

/// Windows of few tiles and partial row sums, as large images need on drivers that limit loop iterations.
#[test]
fn limiting_iterations_does_not_change_results() {
    let Some(mut gpu) = opened(GpuRenderer::new(&AdapterChoice::Automatic, GpuOptions::default())) else { return };
    let ((gaussians, view), options) = (scene(), RenderOptions::default());
    let images = ImageGradients {
        rgb: (0..view.pixels()).map(|n| [0.1, (n % 7) as f32, (n % 3) as f32 - 1.0]).collect(),
        alpha: None,
        depth: None,
        scalar: None,
    };
    let rendering = gpu.render(&gaussians, &view, &options).unwrap();
    let gradients = gpu.backward(&gaussians, &view, &options, &images).unwrap();
    for iterations in [14, 2, 1] {
        (gpu.context.tiles_per_window, gpu.context.columns_per_dispatch) = (u64::from(iterations), iterations);
        assert!(gpu.render(&gaussians, &view, &options).unwrap() == rendering, "{iterations}");
        assert!(gpu.backward(&gaussians, &view, &options, &images).unwrap() == gradients, "{iterations}");
    }
}

/// One needle of this length at an angle in the image's plane, in units of depth 3.
fn needle(length: f32, degrees: u16) -> Gaussians {
    let half = f32::from(degrees).to_radians() / 2.0;
    let parts = GaussianParts {
        means: vec![[0.2, -0.1, 3.0]],
        quaternions: vec![[half.cos(), 0.0, 0.0, half.sin()]],
        log_scales: vec![[length.ln(), -5.5, -5.5]],
        opacity_logits: vec![3.0],
        sh: vec![[1.0, 0.5, 0.2]],
        ..GaussianParts::default()
    };
    Gaussians::new(parts).unwrap()
}

/// The bounding boxes of slanted needles are mostly empty. The longest have more tiles than a mask has bits.
#[test]
fn lists_hold_the_tiles_that_an_ellipse_touches() {
    let Some(mut gpu) = opened(GpuRenderer::new(&AdapterChoice::Automatic, GpuOptions::default())) else { return };
    let (width, height) = (310_usize, 203_usize);
    let view = View { size: atsplat_camera::ImageSize { width: 310, height: 203 }, ..scene().1 };
    let tile = |x: usize, y: usize| (x / 16, y / 16);
    let (mut listed, mut boxed) = (0, 0);
    let lengths = [0.03f32, 0.1, 0.4, 3.0];
    for (length, degrees) in
        lengths.into_iter().flat_map(|length| (7..180).step_by(15).map(move |angle| (length, angle)))
    {
        let case = format!("length {length}, {degrees} degrees");
        let gaussians = needle(length, degrees);
        let expected = reference::render(&gaussians, &view, &RenderOptions::default()).unwrap().alpha;
        let found = gpu.render(&gaussians, &view, &RenderOptions::default()).unwrap().alpha;
        // Of what is on the threshold, rounding decides.
        let lost =
            expected.iter().zip(&found).filter(|(expected, found)| **expected > 1.01 / 255.0 && !(**found > 0.0));
        assert_eq!(lost.count(), 0, "{case}: a tile is missing");

        let report = gpu.pool.get(&gpu.context, "report", 0, status::BYTES).unwrap();
        let bytes = gpu.context.read(&[(&report, status::BYTES)]).unwrap().concat();
        let pairs = usize::try_from(Status::parse("", &bytes).unwrap().pairs).unwrap();
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let coloured: Vec<_> = pixels.zip(&expected).filter(|(_, alpha)| **alpha > 0.0).map(|(at, _)| at).collect();
        let steps = [0, 2, 4];
        let near: BTreeSet<_> = coloured
            .iter()
            .flat_map(|(x, y)| steps.into_iter().flat_map(move |right| steps.map(|down| (x + right, y + down))))
            .map(|(x, y)| tile(x.saturating_sub(2).min(width - 1), y.saturating_sub(2).min(height - 1)))
            .collect();
        let columns = near.iter().map(|(column, _)| column);
        let rows = near.iter().map(|(_, row)| row);
        let span = |low: Option<&usize>, high: Option<&usize>| 1 + high.unwrap() - low.unwrap();
        let tiles = span(columns.clone().min(), columns.max()) * span(rows.clone().min(), rows.max());
        if tiles <= 32 {
            assert!(pairs <= near.len(), "{case}: {pairs} tiles are listed, the ellipse is near {}", near.len());
        }
        (listed, boxed) = (listed + pairs, boxed + tiles);
    }
    assert!(3 * listed < 2 * boxed, "{listed} tiles of {boxed}");
}

/// Each batch kernel sees every image from the first view; the kernels of single views are right.
#[test]
fn the_self_test_detects_each_wrong_kernel_of_a_batch() {
    let Some(mut gpu) = opened(GpuRenderer::new(&AdapterChoice::Automatic, GpuOptions::default())) else { return };
    for kernel in [Kernel::Project, Kernel::Colour, Kernel::ColourBackward, Kernel::ProjectBackward] {
        let kernel = kernel.of_batch(true);
        let right = gpu.pipelines.clone();
        gpu.pipelines.miscompile(&gpu.context, kernel, ["view = views[image];", "view = views[0];"]);
        let outcome = gpu.self_test();
        gpu.pipelines = right;
        assert!(
            matches!(&outcome, Err(GpuError::SelfTest { what, .. }) if what.ends_with(" of a batch")),
            "{kernel:?}: {outcome:?}"
        );
    }
    gpu.self_test().unwrap();
}

/// The image fits the largest buffer of the device, but not with the quarter that the pool adds.
#[test]
fn a_buffer_of_a_reading_that_cannot_be_allocated_is_an_error_and_not_kept() {
    let Some((adapter, _)) = opened(adapters::choose(&AdapterChoice::Automatic)) else { return };
    let mut required_limits = adapter.limits();
    (required_limits.max_buffer_size, required_limits.max_storage_buffer_binding_size) = (128 << 10, 128 << 10);
    let descriptor = wgpu::DeviceDescriptor { required_limits, ..wgpu::DeviceDescriptor::default() };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).unwrap();
    let mut gpu = GpuRenderer::with_device(device, queue, GpuOptions::default()).unwrap();
    gpu.context.binding_limit = 1 << 30;
    let view = View { size: atsplat_camera::ImageSize { width: 90, height: 80 }, ..scene().1 };
    let resident = gpu.upload(&needle(0.4, 30)).unwrap();
    let image = gpu.render_resident(&resident, &view, &RenderOptions::default()).unwrap();
    let whole = gpu.read_image(&image, ImageFormat { numbers: ImageNumbers::F32, alpha: true });
    assert!(matches!(whole, Err(SplatError::Gpu(GpuError::Rejected { .. }))), "{whole:?}");
    let small = gpu.read_image(&image, ImageFormat { numbers: ImageNumbers::U8, alpha: false }).unwrap();
    assert!(small.bytes.len() == 3 * 90 * 80 && small.bytes.iter().any(|byte| *byte > 0));
}

#[test]
fn a_pool_stays_within_the_limit() {
    let Some(context) = context(&GpuOptions { memory_limit: 10_000, ..GpuOptions::default() }) else { return };
    let mut pool = Pool::default();
    let size = |pool: &mut Pool, name, bytes| pool.get(&context, name, 0, bytes).unwrap().size();
    assert_eq!(size(&mut pool, "a", 4096), 5120);
    assert_eq!((size(&mut pool, "a", 5000), pool.bytes()), (5120, 5120), "kept");
    // Padding does not fit.
    assert_eq!((size(&mut pool, "b", 4096), pool.bytes()), (4096, 9216));
    pool.begin_frame();
    assert_eq!((size(&mut pool, "b", 4096), pool.bytes()), (4096, 9216));
    // `a` is not used in this frame.
    assert_eq!((size(&mut pool, "c", 2048), pool.bytes()), (2560, 6656));
}

/// A stage continues after a copy; if some of it cannot be timed, no times are returned.
#[test]
fn stages_are_timed_completely_or_not_at_all() {
    let Some(context) = context(&GpuOptions::default()) else { return };
    if !context.timestamps {
        skip("stages_are_timed_completely_or_not_at_all", "this adapter has no timestamps");
        return;
    }
    let mut pipelines = Pipelines::default();
    let runs = |runs: usize, pipelines: &mut Pipelines| {
        let mut recorder = Recorder::new(&context, pipelines).timed();
        let result = context.buffer("probe", 8).unwrap();
        recorder.stage("stage");
        for _ in 0..runs {
            recorder.dispatch(Kernel::Probe, bytemuck::bytes_of(&[5u32, 0, 0, 0]), &[&result], 1).unwrap();
            recorder.clear(&result, 8);
        }
        recorder.dispatch(Kernel::Probe, bytemuck::bytes_of(&[5u32, 0, 0, 0]), &[&result], 1).unwrap();
        let finished = recorder.submit_and_read(&[(&result, 8)]).unwrap();
        assert_eq!(finished.contents.concat().len(), 8);
        finished.timings.into_iter().map(|(name, _)| name).collect::<Vec<_>>()
    };
    assert_eq!(runs(2, &mut pipelines), ["stage"; 3]);
    assert_eq!(runs(40, &mut pipelines), ["stage"; 41]);
    assert!(runs(2048, &mut pipelines).is_empty());
}
