//! The graphics processor against the f64 reference and the processor.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_splat::gpu::{AdapterChoice, GpuOptions, GpuRenderer};
use atsplat_splat::{Channels, GaussianParts, Gaussians, RenderOptions, Renderer, View, reference};
use glam::{DMat3, DVec3};

fn cloud(count: usize, degree: u8, seed: u32) -> Gaussians {
    let mut state = seed;
    let mut uniform = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let mut parts = GaussianParts { sh_degree: degree, scalars: Some(Vec::new()), ..GaussianParts::default() };
    for _ in 0..count {
        let mut spread = |width: f32| width * (2.0 * uniform() - 1.0);
        parts.means.push([spread(2.5), spread(2.0), 4.0 + spread(3.5)]);
        parts.quaternions.push([spread(1.0), spread(1.0), spread(1.0), spread(1.0)]);
        parts.log_scales.push([-3.0 + spread(2.0), -3.0 + spread(2.0), -3.5 + spread(2.0)]);
        parts.opacity_logits.push(spread(5.0));
        parts.scalars.iter_mut().for_each(|scalars| scalars.push(spread(1.0)));
        for _ in 0..atsplat_splat::sh_coefficients(degree) {
            parts.sh.push([spread(0.8), spread(0.8), spread(0.8)]);
        }
    }
    Gaussians::new(parts).unwrap()
}

fn view(width: u32, height: u32) -> View {
    let rotation = DMat3::from_rotation_y(0.2) * DMat3::from_rotation_x(0.1);
    let pose = CameraFromWorld::new(rotation, DVec3::new(0.3, -0.1, 0.4)).unwrap();
    let intrinsics = NormalizedIntrinsics::new(0.8, 0.8 * f64::from(width) / f64::from(height), 0.48, 0.53).unwrap();
    View { camera: Camera::pinhole(pose, intrinsics), size: ImageSize { width, height } }
}

fn everything() -> RenderOptions {
    RenderOptions {
        background: [0.1, 0.6, 0.3],
        channels: Channels { depth: true, scalar: true, median_depth: true },
        ..RenderOptions::default()
    }
}

#[test]
fn first() {
    println!("{:#?}", atsplat_splat::gpu::adapters());
    let mut gpu = GpuRenderer::new(&AdapterChoice::Automatic, GpuOptions::default()).unwrap();
    let (gaussians, view) = (cloud(3000, 3, 7), view(97, 61));
    let actual = gpu.render(&gaussians, &view, &everything()).unwrap();
    let expected = reference::render(&gaussians, &view, &everything()).unwrap();
    println!("{:?} {:?}", actual.census, expected.census);
    let mut worst = 0.0f64;
    let mut beyond = 0;
    for (a, e) in actual.rgb.iter().flatten().zip(expected.rgb.iter().flatten()) {
        let d = (f64::from(*a) - e).abs();
        if !(d <= worst) {
            worst = d;
        }
        if !(d <= 1e-5) {
            beyond += 1;
        }
    }
    println!("worst {worst:e} beyond {beyond} {:?}", gpu.stages());
    let again = gpu.render(&gaussians, &view, &everything()).unwrap();
    assert!(again == actual);
    println!("{:?}", gpu.stages());
}

#[test]
fn second() {
    use atsplat_camera::Distortion;
    use atsplat_splat::{ImageGradients, RasterMode, RendererConstants};
    let mut gpu = GpuRenderer::new(&AdapterChoice::Automatic, GpuOptions::default()).unwrap();
    for case in 0..4 {
        let (gaussians, mut view) = (cloud(600, 3, 21), view(61, 45));
        if case == 2 {
            view.camera.distortion = Distortion::OpenCv { k1: -0.1, k2: 0.02, k3: 0.0, p1: 0.003, p2: -0.002 };
        }
        if case == 3 {
            view.camera.distortion = Distortion::Fisheye { k: [0.02, -0.01, 0.003, -0.001] };
        }
        let mode = if case == 1 { RasterMode::Antialiased } else { RasterMode::Classic };
        let constants = RendererConstants { min_alpha: 1e-5, ..RendererConstants::default() };
        let options = RenderOptions { constants, mode, ..everything() };
        let wave = |phase: f64| (0..view.pixels()).map(move |n| (n as f64 * 0.37 + phase).sin()).collect::<Vec<_>>();
        let (red, green, blue) = (wave(0.0), wave(1.0), wave(2.0));
        let images = ImageGradients {
            rgb: red.into_iter().zip(green).zip(blue).map(|((r, g), b)| [r, g, b]).collect(),
            alpha: Some(wave(3.0)),
            depth: Some(wave(4.0)),
            scalar: Some(wave(5.0)),
        };
        let expected = reference::backward(&gaussians, &view, &options, &images).unwrap();
        let actual = gpu.backward(&gaussians, &view, &options, &images.map(|v| v as f32)).unwrap().map(f64::from);
        let again = gpu.backward(&gaussians, &view, &options, &images.map(|v| v as f32)).unwrap().map(f64::from);
        assert!(again == actual);
        let show = |name: &str, a: &[f64], e: &[f64]| {
            let size = e.iter().fold(0.0f64, |m, v| if v.abs() > m { v.abs() } else { m });
            let worst = a.iter().zip(e).fold((0.0f64, 0.0, 0.0), |m, (a, e)| {
                if !((a - e).abs() <= m.0) { ((a - e).abs(), *a, *e) } else { m }
            });
            println!("{case} {name}: size {size:e} worst {:e} ({} vs {})", worst.0 / size, worst.1, worst.2);
        };
        show("means", actual.means.as_flattened(), expected.means.as_flattened());
        show("quats", actual.quaternions.as_flattened(), expected.quaternions.as_flattened());
        show("logs", actual.log_scales.as_flattened(), expected.log_scales.as_flattened());
        show("logits", &actual.opacity_logits, &expected.opacity_logits);
        show("sh", actual.sh.as_flattened(), expected.sh.as_flattened());
        show("scalars", &actual.scalars, &expected.scalars);
        show("means2d", actual.means_2d.as_flattened(), expected.means_2d.as_flattened());
        show("conics", actual.conics.as_flattened(), expected.conics.as_flattened());
        show("background", &actual.background, &expected.background);
        show("pose", &actual.pose, &expected.pose);
    }
    println!("{:?}", gpu.stages());
}
