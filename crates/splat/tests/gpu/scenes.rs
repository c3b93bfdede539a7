//! Test scenes, and the device shared by all tests.

use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_numeric::Tolerance;
use atsplat_splat::gpu::{
    AdapterChoice, GpuError, GpuImageGradients, GpuOptions, GpuOverrides, GpuRenderer, GpuStrip, GpuStripGradients,
    SelfTestKey, SelfTestObserver, SelfTestResult, select,
};
use atsplat_splat::{Gaussians, ImageGradients, RenderOptions, Renderer, Rendering, View};
use atsplat_tests::{skip, skip_without_graphics};

pub(crate) use crate::cloud::{cloud, everything, image_gradients, narrow, view};

/// The default options, except for these overrides.
pub(crate) fn overriding(overrides: GpuOverrides) -> GpuOptions {
    GpuOptions { overrides, ..GpuOptions::default() }
}

/// Opens a renderer on a device of its own, which passes the self-test with these options; `None` if there is no adapter and none is
/// required.
pub(crate) fn open(options: GpuOptions) -> Option<GpuRenderer> {
    observed(options, &())
}

/// As [`open`] with the default options, without their self-test, which [`gpu`] has passed.
pub(crate) fn open_untested() -> Option<GpuRenderer> {
    struct Passed;
    impl SelfTestObserver for Passed {
        fn cached(&self, _key: &SelfTestKey) -> Option<SelfTestResult> {
            Some(SelfTestResult { fault: None })
        }
    }
    observed(GpuOptions::default(), &Passed)
}

/// Another renderer on the device of one, without a self-test: for tests that compare it with a renderer that has passed its own.
pub(crate) fn beside(gpu: &GpuRenderer, options: GpuOptions) -> GpuRenderer {
    GpuRenderer::with_device(gpu.device().clone(), gpu.queue().clone(), options).unwrap()
}

fn observed(options: GpuOptions, observer: &dyn SelfTestObserver) -> Option<GpuRenderer> {
    match GpuRenderer::observed(&AdapterChoice::Automatic, options, observer) {
        Ok(renderer) => Some(renderer),
        Err(error @ GpuError::NoAdapter { .. }) => {
            skip_without_graphics("splat gpu", error);
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// The shared renderer.
pub(crate) fn gpu() -> Option<MutexGuard<'static, GpuRenderer>> {
    static SHARED: OnceLock<Option<Mutex<GpuRenderer>>> = OnceLock::new();
    let shared = SHARED.get_or_init(|| open(GpuOptions::default()).map(Mutex::new)).as_ref()?;
    Some(shared.lock().unwrap_or_else(PoisonError::into_inner))
}

/// A device not opened by this crate, with lowered limits, on the adapter of [`gpu`]; `None` if that is OpenGL's.
pub(crate) fn external_device(lower: impl FnOnce(&mut wgpu::Limits)) -> Option<(wgpu::Device, wgpu::Queue)> {
    // wgpu panics if devices of two instances are mixed.
    static INSTANCE: OnceLock<wgpu::Instance> = OnceLock::new();
    let instance = INSTANCE.get_or_init(|| wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle()));
    let (number, chosen) = select(&AdapterChoice::Automatic).ok()?;
    if chosen.backend == "Gl" {
        skip("external_device", "the adapter is OpenGL's");
        return None;
    }
    // In the order in which this crate numbers them.
    let backends = [wgpu::Backends::VULKAN, wgpu::Backends::METAL, wgpu::Backends::DX12, wgpu::Backends::GL];
    let mut listed = backends.into_iter().flat_map(|one| pollster::block_on(instance.enumerate_adapters(one)));
    let adapter = listed.nth(number).unwrap();
    let info = adapter.get_info();
    assert_eq!(format!("{} ({:?})", info.name, info.backend), chosen.to_string());
    let mut required_limits = adapter.limits();
    lower(&mut required_limits);
    // As this crate's own devices, which otherwise round gradients differently.
    let required_features = adapter.features() & wgpu::Features::SUBGROUP;
    let descriptor = wgpu::DeviceDescriptor { required_limits, required_features, ..wgpu::DeviceDescriptor::default() };
    Some(pollster::block_on(adapter.request_device(&descriptor)).unwrap())
}

/// Gradients of images below each other, on the device in one strip; zeros for images that have none.
pub(crate) fn on_device(gpu: &GpuRenderer, images: &[ImageGradients<f32>]) -> GpuImageGradients {
    let plane = |image: &Option<Vec<f32>>, pixel: usize| image.as_ref().map_or(0.0, |image| image[pixel]);
    let (mut colours, mut extras) = (Vec::new(), Vec::new());
    for image in images {
        for (pixel, [red, green, blue]) in image.rgb.iter().enumerate() {
            colours.push([*red, *green, *blue, plane(&image.alpha, pixel)]);
            extras.push([plane(&image.depth, pixel), plane(&image.scalar, pixel), 0.0, 0.0]);
        }
    }
    let put = |values: &[[f32; 4]]| {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let size = 16 * values.len() as u64;
        let descriptor = wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false };
        let buffer = gpu.device().create_buffer(&descriptor);
        gpu.queue().write_buffer(&buffer, 0, bytemuck::cast_slice(values));
        buffer
    };
    GpuImageGradients { strips: vec![GpuStripGradients { colours: put(&colours), extras: Some(put(&extras)) }] }
}

/// An image as its own gradient, that of half its sum of squares.
pub(crate) fn as_gradients(strips: &[GpuStrip]) -> GpuImageGradients {
    let of = |strip: &GpuStrip| GpuStripGradients { colours: strip.colours.clone(), extras: strip.extras.clone() };
    GpuImageGradients { strips: strips.iter().map(of).collect() }
}

/// The same with a 3D filter.
pub(crate) fn filtered(gaussians: &Gaussians) -> Gaussians {
    let mut parts = gaussians.parts().clone();
    parts.filter_3d =
        Some((0..gaussians.len()).map(|n| if n % 5 == 0 { 0.0 } else { 0.01 * (n % 7) as f32 }).collect());
    Gaussians::new(parts).unwrap()
}

/// Small Gaussians, for scenes of hundreds of thousands.
pub(crate) fn dust(count: usize) -> Gaussians {
    let mut parts = cloud(count, 0, 77).into_parts();
    parts.log_scales.iter_mut().for_each(|logs| *logs = logs.map(|log| log - 2.5));
    Gaussians::new(parts).unwrap()
}

/// Pixel-sized Gaussians barely above the alpha threshold: hundreds on a pixel leave it transparent.
pub(crate) fn specks(count: usize) -> Gaussians {
    let mut parts = cloud(count, 0, 78).into_parts();
    parts.log_scales.iter_mut().for_each(|logs| *logs = [-8.0; 3]);
    parts.opacity_logits.iter_mut().for_each(|logit| *logit = -5.3);
    Gaussians::new(parts).unwrap()
}

/// Parallel needles along the image diagonal: the bounding box of each is the whole image, but each touches few pixels
/// with low alpha, so that none occludes another.
pub(crate) fn needles(count: usize) -> Gaussians {
    let mut parts = cloud(count, 0, 79).into_parts();
    let (sine, cosine) = std::f32::consts::FRAC_PI_8.sin_cos();
    for (n, mean) in parts.means.iter_mut().enumerate() {
        let across = 0.55 * ((n % 101) as f32 / 50.0 - 1.0);
        *mean = [across, -across, 2.0 + 0.001 * (n % 997) as f32];
    }
    parts.quaternions.iter_mut().for_each(|quaternion| *quaternion = [cosine, 0.0, 0.0, sine]);
    parts.log_scales.iter_mut().for_each(|logs| *logs = [1.6, -4.0, -4.0]);
    parts.opacity_logits.iter_mut().for_each(|logit| *logit = -5.2);
    Gaussians::new(parts).unwrap()
}

/// A view along +z from the origin.
pub(crate) fn straight(width: u32, height: u32) -> View {
    let intrinsics = NormalizedIntrinsics::new(0.9, 0.9 * f64::from(width) / f64::from(height), 0.5, 0.5).unwrap();
    View { camera: Camera::pinhole(CameraFromWorld::IDENTITY, intrinsics), size: ImageSize { width, height } }
}

/// Asserts the documented bound: 99.99 % of all pixels within 1/255, a PSNR of at least 60 dB, and equal counts of Gaussians.
pub(crate) fn assert_bound(actual: &Rendering<f32>, expected: &Rendering<f64>, what: &str) {
    assert_eq!(actual.counts, expected.counts, "{what}");
    let flat: Vec<f64> = actual.rgb.iter().flatten().map(|value| f64::from(*value)).collect();
    within(&flat, expected.rgb.as_flattened(), 1.0 / 255.0, &format!("{what}: rgb"));
    let image = |values: &[f32]| values.iter().map(|value| f64::from(*value)).collect::<Vec<_>>();
    within(&image(&actual.alpha), &expected.alpha, 1.0 / 255.0, &format!("{what}: alpha"));
    let pairs = [
        ("depth", &actual.depth, &expected.depth, 1.0 / 255.0),
        ("scalar", &actual.scalar, &expected.scalar, 1.0 / 255.0),
    ];
    for (name, actual, expected, bound) in pairs {
        assert_eq!(actual.is_some(), expected.is_some(), "{what}: {name}");
        if let (Some(actual), Some(expected)) = (actual, expected) {
            let scale = 1.0 + expected.iter().fold(0.0f64, |most, value| if *value > most { *value } else { most });
            within(&image(actual), expected, bound * scale, &format!("{what}: {name}"));
        }
    }
    if let (Some(actual), Some(expected)) = (&actual.median_depth, &expected.median_depth) {
        // At the threshold of one half, another Gaussian may be chosen.
        let near = Tolerance { absolute: 1e-4, relative: 1e-4 };
        let apart = image(actual).iter().zip(expected).filter(|(a, e)| !near.accepts(**a, **e)).count();
        assert!(apart * 1000 <= expected.len(), "{what}: {apart} median depths of {}", expected.len());
    }
}

fn within(actual: &[f64], expected: &[f64], bound: f64, what: &str) {
    assert_eq!(actual.len(), expected.len(), "{what}");
    let mut squares = 0.0;
    let mut beyond = 0;
    for (actual, expected) in actual.iter().zip(expected) {
        assert!(actual.is_finite(), "{what}");
        let apart = actual - expected;
        squares += (apart / (255.0 * bound)).powi(2);
        beyond += usize::from(apart.abs() > bound);
    }
    let decibels = -10.0 * (squares / actual.len() as f64).log10();
    assert!(beyond * 10_000 <= actual.len(), "{what}: {beyond} of {} beyond 1/255", actual.len());
    assert!(decibels >= 60.0, "{what}: {decibels} dB");
}

/// Asserts that two renderers give bit-identical images and gradients.
pub(crate) fn assert_identical(
    actual: &mut GpuRenderer,
    expected: &mut GpuRenderer,
    gaussians: &Gaussians,
    view: &View,
    options: &RenderOptions,
) {
    let images = narrow(&image_gradients(view));
    let rendering = expected.render(gaussians, view, options).unwrap();
    assert!(actual.render(gaussians, view, options).unwrap() == rendering);
    let gradients = expected.backward(gaussians, view, options, &images).unwrap();
    assert!(actual.backward(gaussians, view, options, &images).unwrap() == gradients);
}
