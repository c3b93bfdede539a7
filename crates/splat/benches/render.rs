//! Scenes like the output of feed-forward methods: one Gaussian per input pixel, small and near its surface.

#![expect(clippy::expect_used, reason = "a benchmark stops at the first error")]

mod scene;

use std::hint::black_box;

use atsplat_camera::ImageSize;
use atsplat_splat::cpu::{CpuOptions, CpuRenderer, SimdLevel};
use atsplat_splat::{ImageGradients, RenderOptions};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use scene::scene;

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
                    pool.install(|| renderer.render(black_box(&gaussians), &view, &options)).expect("an image")
                });
            });
        }
    }
    group.finish();
}

/// The backward pass of the first scene for a colour loss: what a training step adds to rendering.
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
                pool.install(|| renderer.backward(black_box(&gaussians), &view, &options, &images)).expect("gradients")
            });
        });
    }
    group.finish();
}

criterion_group!(benches, forward, backward);
criterion_main!(benches);
