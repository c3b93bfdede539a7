//! Tests of internals: limits of drivers, and pooled buffers.

use atsplat_tests::{skip, skip_without_graphics};

use super::context::Context;
use super::kernels::{Kernel, Pipelines, Pool};
use super::record::Recorder;
use super::{AdapterChoice, GpuError, GpuOptions, GpuRenderer, adapters};
use crate::{GaussianParts, Gaussians, ImageGradients, RenderOptions, Renderer, View};

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
        atsplat_camera::CameraFromWorld::new(glam::DMat3::IDENTITY, glam::DVec3::ZERO).unwrap(),
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
