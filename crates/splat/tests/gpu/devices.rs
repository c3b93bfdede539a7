use atsplat_camera::ImageSize;
use atsplat_splat::gpu::{GpuError, GpuOptions, GpuRenderer};
use atsplat_splat::{Renderer, SplatError, View};

use crate::scenes::{cloud, everything, gpu, guest_device, narrow, open, ripples, view};

/// Buffers of a picture, and of the derivatives by some Gaussians, each fit the device, but not together.
#[test]
fn more_is_read_than_one_buffer_holds() {
    let small = |limits: &mut wgpu::Limits| {
        (limits.max_buffer_size, limits.max_storage_buffer_binding_size) = (128 << 10, 128 << 10);
    };
    let (Some(mut gpu), Some((device, queue))) = (gpu(), guest_device(small)) else { return };
    let mut cut = GpuRenderer::with_device(device, queue, GpuOptions::default()).unwrap();
    let (gaussians, view) = (cloud(3000, 3, 7), view(97, 71));
    let whole = gpu.render(&gaussians, &view, &everything()).unwrap();
    assert!(cut.render(&gaussians, &view, &everything()).unwrap() == whole);
    let images = narrow(&ripples(&view));
    let whole = gpu.backward(&gaussians, &view, &everything(), &images).unwrap();
    assert!(cut.backward(&gaussians, &view, &everything(), &images).unwrap() == whole);
}

#[test]
fn no_strips_of_no_picture() {
    let Some(gpu) = gpu() else { return };
    for size in [[0, 3], [3, 0], [0, 0], [70_000, 3], [3, 70_000]] {
        let outcome = gpu.strips(&View { size: ImageSize { width: size[0], height: size[1] }, ..view(3, 3) });
        assert!(matches!(outcome, Err(SplatError::View { .. })), "{size:?}: {outcome:?}");
    }
    assert_eq!(gpu.strips(&view(7, 5)).unwrap(), [[0, 5]]);
}

/// Who shares the device learns of his mistake once, and the renderer goes on.
#[test]
fn mistakes_of_others_are_told_once() {
    let Some(mut gpu) = open(GpuOptions::default()) else { return };
    let mut render = || gpu.render(&cloud(10, 0, 1), &view(8, 8), &everything());
    let picture = render().unwrap();
    let mistaken = wgpu::BufferDescriptor {
        label: Some("mistaken"),
        size: 256,
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::UNIFORM,
        mapped_at_creation: false,
    };
    drop(gpu.device().create_buffer(&mistaken));
    let mut render = || gpu.render(&cloud(10, 0, 1), &view(8, 8), &everything());
    let outcome = render();
    assert!(
        matches!(&outcome, Err(SplatError::Gpu(GpuError::Refused { reason, .. })) if reason.contains("outside")),
        "{outcome:?}"
    );
    assert!(render().unwrap() == picture);
}
