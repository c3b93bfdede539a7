//! `cargo bench -p atsplat-pixels --bench resize`; `pillow_resize.py` compares with Pillow in the same run.
#![expect(clippy::unwrap_used, reason = "a benchmark stops at the first error")]

use std::hint::black_box;

use atsplat_pixels::{Filter, ImageU8, resize};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

/// Source and target sizes of the published protocols (conventions B1, B3).
const SIZES: [[u32; 4]; 4] = [[640, 360, 455, 256], [480, 270, 398, 224], [960, 540, 796, 448], [1920, 1080, 960, 540]];

fn sizes(criterion: &mut Criterion) {
    for [width, height, to_width, to_height] in SIZES {
        let samples = (0..width * height * 3).map(|i| i.wrapping_mul(2_654_435_761).to_be_bytes()[0]).collect();
        let image = ImageU8::new(width, height, samples).unwrap();
        let mut group = criterion.benchmark_group(format!("{width}x{height} to {to_width}x{to_height}"));
        group.throughput(Throughput::Elements(u64::from(width) * u64::from(height)));
        for filter in [Filter::Lanczos, Filter::Bilinear, Filter::Box] {
            group.bench_function(format!("{filter:?}"), |bencher| {
                bencher.iter(|| resize(black_box(&image), to_width, to_height, filter).unwrap());
            });
        }
        group.finish();
    }
}

criterion_group!(benches, sizes);
criterion_main!(benches);
