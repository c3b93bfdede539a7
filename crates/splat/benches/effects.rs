//! What is not called for costs nothing: pairs of a bare request, and of one that asks for everything in vain.

#![expect(clippy::expect_used, reason = "a benchmark stops at the first error")]

use std::hint::black_box;

use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::effects::{EffectPlan, EffectSelection};
use atsplat_splat::{Channels, Exposure, GaussianParts, Gaussians, RenderOptions, View, sh_coefficients};
use criterion::{Criterion, criterion_group, criterion_main};
use glam::{DMat3, DVec3};

const COUNT: usize = 131_072;
const SIZE: ImageSize = ImageSize { width: 256, height: 256 };

/// A Gaussian per input pixel of two views, 0.6 pixels wide; harmonics above degree 0 are all zero.
fn scene(degree: u8) -> (Gaussians, View) {
    let intrinsics = NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).expect("intrinsics");
    let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::ZERO).expect("a pose");
    let focal = 0.9 * SIZE.width as f32;
    let mut state = 1u32;
    let mut uniform = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    let mut parts = GaussianParts { sh_degree: degree, scalars: Some(vec![0.0; COUNT]), ..GaussianParts::default() };
    for _ in 0..COUNT {
        let (u, v) = (uniform() * SIZE.width as f32, uniform() * SIZE.height as f32);
        let depth = 3.0 + (u * 0.02).sin() + (v * 0.03).cos() + 0.1 * uniform();
        let (x, y) = ((u - 0.5 * SIZE.width as f32) / focal, (v - 0.5 * SIZE.height as f32) / focal);
        parts.means.push([x * depth, y * depth, depth]);
        parts.quaternions.push([1.0, uniform(), uniform(), uniform()]);
        parts.log_scales.push([(0.6 * depth / focal).ln(); 3]);
        parts.opacity_logits.push(4.0 * uniform() - 1.0);
        parts.sh.push([uniform(), uniform(), uniform()]);
        parts.sh.extend((1..sh_coefficients(degree)).map(|_| [0.0; 3]));
    }
    (Gaussians::new(parts).expect("Gaussians"), View { camera: Camera::pinhole(pose, intrinsics), size: SIZE })
}

fn nothing_called_for(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("effects");
    group.sample_size(20);
    let bare = RenderOptions { max_sh_degree: 0, ..RenderOptions::default() };
    let in_vain = RenderOptions {
        exposure: Some(Exposure::IDENTITY),
        channels: Channels { scalar: true, ..Channels::default() },
        ..RenderOptions::default()
    };
    for degree in [0, 3] {
        let (gaussians, view) = scene(degree);
        let mut through = view;
        through.camera.distortion = Distortion::OpenCv { k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
        let mut renderer = CpuRenderer::default();
        group.bench_function(format!("degree {degree}, bare"), |bencher| {
            bencher.iter(|| renderer.render(black_box(&gaussians), &view, &bare).expect("a picture"));
        });
        for selection in [EffectSelection::Auto, EffectSelection::All] {
            group.bench_function(format!("degree {degree}, in vain, {selection}"), |bencher| {
                bencher.iter(|| {
                    let plan = EffectPlan::for_scene(
                        black_box(&gaussians),
                        &through,
                        &in_vain,
                        &selection,
                        EffectPlan::TOLERANCE,
                    );
                    plan.expect("a plan").render(&mut renderer, &gaussians).expect("a picture")
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, nothing_called_for);
criterion_main!(benches);
