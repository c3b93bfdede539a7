use atsplat_camera::ImageSize;
use atsplat_splat::gpu::{GpuError, GpuOptions, GpuRenderer};
use atsplat_splat::{Renderer, SplatError, View};

use crate::scenes::{assert_identical, cloud, everything, external_device, gpu, open_untested, view};

/// The buffers of an image, and of the gradients, each fit the device, but not together.
#[test]
fn reads_more_than_the_largest_buffer() {
    let small = |limits: &mut wgpu::Limits| {
        (limits.max_buffer_size, limits.max_storage_buffer_binding_size) = (128 << 10, 128 << 10);
    };
    let (Some(mut gpu), Some((device, queue))) = (gpu(), external_device(small)) else { return };
    let mut limited = GpuRenderer::with_device(device, queue, GpuOptions::default()).unwrap();
    let (gaussians, view) = (cloud(3000, 3, 7), view(97, 71));
    assert_identical(&mut limited, &mut gpu, &gaussians, &view, &everything());
}

#[test]
fn a_device_of_the_caller_is_on_the_adapter_of_the_shared_renderer() {
    let (Some(gpu), Some((device, queue))) = (gpu(), external_device(|_| ())) else { return };
    let external = GpuRenderer::with_device(device, queue, GpuOptions::default()).unwrap();
    assert_eq!(external.adapter(), gpu.adapter());
}

#[test]
fn rejects_uniform_buffers_below_what_adapters_guarantee() {
    let lower = |limits: &mut wgpu::Limits| limits.max_uniform_buffer_binding_size = 8 << 10;
    let (Some(_lock), Some((device, queue))) = (gpu(), external_device(lower)) else { return };
    let outcome = GpuRenderer::with_device(device, queue, GpuOptions::default());
    assert!(matches!(outcome, Err(GpuError::Unfit { what: "bytes of a uniform buffer", .. })), "{outcome:?}");
}

/// Without an error handler, wgpu panics for an error outside of a scope.
#[test]
fn errors_of_guarded_commands_are_returned_at_once() {
    let (Some(_lock), Some((device, queue))) = (gpu(), external_device(|_| ())) else { return };
    let mut gpu = GpuRenderer::with_device(device, queue, GpuOptions::default()).unwrap();
    let (gaussians, view) = (cloud(10, 0, 1), view(8, 8));
    let expected = gpu.render(&gaussians, &view, &everything()).unwrap();
    let buffer = |size: u64, gpu: &GpuRenderer| {
        let usage = wgpu::BufferUsages::STORAGE;
        let descriptor = wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false };
        gpu.guarded(|| Ok(gpu.device().create_buffer(&descriptor)))
    };
    let outcome = buffer(1 << 62, &gpu);
    let is_typed = matches!(outcome, Err(SplatError::Gpu(GpuError::Rejected { .. } | GpuError::OutOfMemory { .. })));
    assert!(is_typed, "{outcome:?}");
    assert_eq!(buffer(48, &gpu).unwrap().size(), 48);
    assert!(gpu.render(&gaussians, &view, &everything()).unwrap() == expected);
}

#[test]
fn rejects_strips_of_invalid_sizes() {
    let Some(gpu) = gpu() else { return };
    for size in [[0, 3], [3, 0], [0, 0], [70_000, 3], [3, 70_000]] {
        let outcome = gpu.strips(&View { size: ImageSize { width: size[0], height: size[1] }, ..view(3, 3) });
        assert!(matches!(outcome, Err(SplatError::View { .. })), "{size:?}: {outcome:?}");
    }
    assert_eq!(gpu.strips(&view(7, 5)).unwrap(), [[0, 5]]);
}

/// An error by another user of the device is reported once, and the renderer continues to work.
#[test]
fn errors_of_other_users_are_reported_once() {
    let Some(mut gpu) = open_untested() else { return };
    let mut render = || gpu.render(&cloud(10, 0, 1), &view(8, 8), &everything());
    let expected = render().unwrap();
    let invalid = wgpu::BufferDescriptor {
        label: Some("invalid"),
        size: 256,
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::UNIFORM,
        mapped_at_creation: false,
    };
    drop(gpu.device().create_buffer(&invalid));
    let mut render = || gpu.render(&cloud(10, 0, 1), &view(8, 8), &everything());
    let outcome = render();
    assert!(
        matches!(&outcome, Err(SplatError::Gpu(GpuError::Rejected { reason, .. })) if reason.contains("outside")),
        "{outcome:?}"
    );
    assert!(render().unwrap() == expected);
}
