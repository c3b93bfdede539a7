//! Epipolar-ray overlap of ten thousand camera pairs at the published grid, 320×180 rays each way.
//! Pairs translate and rotate as RE10K's do, so that overlaps are spread over [0, 1].

use std::hint::black_box;

use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
use atsplat_numeric::SplitMix64;
use atsplat_protocol::overlap::EpipolarRays;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

const PAIRS: u64 = 10_000;

fn uniform(random: &mut SplitMix64, reach: f64) -> f64 {
    (random.next_u64() as f64 / u64::MAX as f64 * 2.0 - 1.0) * reach
}

fn camera(random: &mut SplitMix64) -> Option<Camera> {
    let turn = DMat3::from_rotation_y(uniform(random, 0.6)) * DMat3::from_rotation_x(uniform(random, 0.2));
    let centre = DVec3::new(uniform(random, 1.0), uniform(random, 0.1), uniform(random, 1.0));
    let pose = WorldFromCamera::new(turn, centre).ok()?;
    Some(Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.5, 0.89, 0.5, 0.5).ok()?))
}

fn overlap(criterion: &mut Criterion) {
    let mut random = SplitMix64::new(1);
    let pairs: Vec<(Camera, Camera)> =
        (0..PAIRS).filter_map(|_| camera(&mut random).zip(camera(&mut random))).collect();
    let rays = EpipolarRays::default();
    let mut group = criterion.benchmark_group("epipolar overlap");
    group.throughput(Throughput::Elements(PAIRS)).sample_size(20);
    group.bench_function("10000 pairs, one thread", |bencher| {
        bencher.iter(|| pairs.iter().filter_map(|(a, b)| rays.overlap(black_box(a), b).ok()).sum::<f64>());
    });
    group.bench_function("10000 pairs, all threads", |bencher| {
        bencher.iter(|| pairs.par_iter().filter_map(|(a, b)| rays.overlap(black_box(a), b).ok()).collect::<Vec<f64>>());
    });
    group.finish();
}

criterion_group!(benches, overlap);
criterion_main!(benches);
