//! `cargo bench -p atsplat-nn`: single operations. `against_pytorch.py` in this folder times whole blocks.

use std::hint::black_box;

use atsplat_nn::{MatmulPrecision, ops};
use burn::Tensor;
use burn::tensor::{Device, Distribution, Int};
use criterion::{Criterion, criterion_group, criterion_main};

fn random<const D: usize>(shape: [usize; D], device: &Device) -> Tensor<D> {
    Tensor::random(shape, Distribution::Normal(0.0, 1.0), device)
}

fn forward(criterion: &mut Criterion) {
    let device = Device::flex();
    let mut group = criterion.benchmark_group("forward");
    group.sample_size(10);

    let (x, hidden) = (random::<3>([1, 514, 768], &device), random::<3>([1, 514, 3072], &device));
    let (weight, bias) = (random::<2>([768, 3072], &device), random::<1>([3072], &device));
    group.bench_function("linear, 514×768 to 3072", |bencher| {
        bencher.iter(|| ops::linear(black_box(x.clone()), weight.clone(), Some(bias.clone())));
    });
    group.bench_function("GELU, 514×3072", |bencher| bencher.iter(|| ops::gelu(black_box(hidden.clone()))));
    group.bench_function("linear, 514×768 to 3072, in bfloat16", |bencher| {
        MatmulPrecision::Bf16
            .scope(|| bencher.iter(|| ops::linear(black_box(x.clone()), weight.clone(), Some(bias.clone()))));
    });
    let gamma = random::<1>([768], &device);
    group.bench_function("layer norm, 514×768", |bencher| {
        bencher.iter(|| ops::layer_norm(black_box(x.clone()), gamma.clone(), None, 1e-5));
    });
    let packed = random::<3>([1, 514, 3 * 768], &device);
    group.bench_function("self-attention, 514 tokens, 12 heads of 64", |bencher| {
        bencher.iter(|| ops::self_attention(black_box(packed.clone()), 12));
    });
    group.bench_function("self-attention, 514 tokens, 12 heads of 64, in bfloat16", |bencher| {
        MatmulPrecision::Bf16.scope(|| bencher.iter(|| ops::self_attention(black_box(packed.clone()), 12)));
    });
    let (queries, keys_values) = (random::<3>([1, 2048, 768], &device), random::<3>([1, 8192, 1536], &device));
    group.bench_function("cross-attention, 2048 queries, 8192 keys", |bencher| {
        bencher.iter(|| ops::cross_attention(black_box(queries.clone()), keys_values.clone(), 12));
    });
    let (queries, keys_values) = (random::<3>([1, 2048, 192], &device), random::<3>([1, 8192, 384], &device));
    group.bench_function("cross-attention, 2048 queries, 8192 keys, 6 heads of 32", |bencher| {
        bencher.iter(|| ops::cross_attention(black_box(queries.clone()), keys_values.clone(), 6));
    });
    let rows = Tensor::<1, Int>::arange(0..8192, &device).reshape([1, 512, 16]).remainder_scalar(512);
    let features = random::<3>([1, 512, 768], &device);
    group.bench_function("largest of 16 rows, 512 times 768", |bencher| {
        bencher.iter(|| ops::gather_max(black_box(features.clone()), rows.clone()));
    });
    group.finish();
}

criterion_group!(benches, forward);
criterion_main!(benches);
