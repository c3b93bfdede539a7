//! What feed-forward methods put out: a Gaussian per input pixel, small and near its surface.

#![expect(clippy::expect_used, reason = "a benchmark stops at the first error")]

use std::hint::black_box;

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_splat::cpu::{CpuOptions, CpuRenderer, SimdLevel};
use atsplat_splat::{GaussianParts, Gaussians, ImageGradients, RenderOptions, View, sh_coefficients};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DMat3, DVec3};

/// One Gaussian behind each of `count` evenly spread points of the picture, 0.6 pixels wide, at smooth depths.
fn scene(count: usize, size: ImageSize, degree: u8) -> (Gaussians, View) {
    let intrinsics = NormalizedIntrinsics::new(0.9, 0.9 * f64::from(size.width) / f64::from(size.height), 0.5, 0.5);
    let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::ZERO).expect("a pose");
    let camera = Camera::pinhole(pose, intrinsics.expect("intrinsics"));
    let focal = 0.9 * size.width as f32;
    let mut state = 1u32;
    let mut uniform = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let mut parts = GaussianParts { sh_degree: degree, ..GaussianParts::default() };
    for _ in 0..count {
        let (u, v) = (uniform() * size.width as f32, uniform() * size.height as f32);
        let depth = 3.0 + (u * 0.02).sin() + (v * 0.03).cos() + 0.1 * uniform();
        let (x, y) = ((u - 0.5 * size.width as f32) / focal, (v - 0.5 * size.height as f32) / focal);
        parts.means.push([x * depth, y * depth, depth]);
        parts.quaternions.push([1.0, uniform(), uniform(), uniform()]);
        parts.log_scales.push([(0.6 * depth / focal).ln(); 3]);
        parts.opacity_logits.push(4.0 * uniform() - 1.0);
        parts.sh.extend((0..sh_coefficients(degree)).map(|_| [uniform() - 0.5, uniform() - 0.5, uniform() - 0.5]));
    }
    (Gaussians::new(parts).expect("Gaussians"), View { camera, size })
}

fn forward(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("forward");
    group.sample_size(20);
    let cases = [
        ("131072 to 256x256, degree 0", 131_072, ImageSize { width: 256, height: 256 }, 0),
        ("311040 to 960x512, degree 0", 311_040, ImageSize { width: 960, height: 512 }, 0),
        ("311040 to 960x512, degree 3", 311_040, ImageSize { width: 960, height: 512 }, 3),
    ];
    for (name, count, size, degree) in cases {
        let (gaussians, view) = scene(count, size, degree);
        group.throughput(Throughput::Elements(count as u64));
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let mut renderer = CpuRenderer::new(CpuOptions { simd: SimdLevel::best(), ..CpuOptions::default() });
            let options = RenderOptions::default();
            group.bench_function(format!("{name}, {threads} threads"), |bencher| {
                bencher.iter(|| {
                    pool.install(|| renderer.render(black_box(&gaussians), &view, &options)).expect("a picture")
                });
            });
        }
    }
    group.finish();
}

/// The derivative of the first scene, by colour: what one step of training adds to rendering.
fn backward(criterion: &mut Criterion) {
    let (gaussians, view) = scene(131_072, ImageSize { width: 256, height: 256 }, 0);
    let images = ImageGradients { rgb: vec![[1.0, 0.5, -0.5]; view.pixels()], alpha: None, depth: None, scalar: None };
    let mut group = criterion.benchmark_group("backward");
    group.sample_size(10).throughput(Throughput::Elements(131_072));
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let (mut renderer, options) = (CpuRenderer::default(), RenderOptions::default());
        group.bench_function(format!("131072 to 256x256, degree 0, {threads} threads"), |bencher| {
            bencher.iter(|| {
                pool.install(|| renderer.backward(black_box(&gaussians), &view, &options, &images))
                    .expect("derivatives")
            });
        });
    }
    group.finish();
}

criterion_group!(benches, forward, backward);
criterion_main!(benches);
