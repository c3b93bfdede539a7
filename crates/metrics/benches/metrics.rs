//! Time of each metric on one thread: `cargo bench -p atsplat-metrics`. Against skimage: `benches/against_skimage.py`.

use std::hint::black_box;

use atsplat_metrics::{Pair, Ssim, Values, l1, psnr, ssim};
use atsplat_pixels::Image;
use criterion::{Criterion, criterion_group, criterion_main};

fn image(width: u32, height: u32, factor: u32) -> Image {
    let ten_bits = |i: u32| u16::try_from(i.wrapping_mul(factor) >> 22).unwrap_or_else(|error| unreachable!("{error}"));
    let samples = (0..width * height * 3).map(|i| f32::from(ten_bits(i)) / 1023.0);
    Image::new(width, height, samples.collect()).unwrap_or_else(|error| unreachable!("{error}"))
}

fn metrics(criterion: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap_or_else(|error| unreachable!("{error}"));
    for (width, height) in [(256, 256), (960, 512)] {
        let (a, b) = (image(width, height, 2_654_435_761), image(width, height, 2_246_822_519));
        let pair = Pair::new(&a, &b).unwrap_or_else(|error| unreachable!("{error}"));
        let mut group = criterion.benchmark_group(format!("{width}x{height}"));
        group.bench_function("check", |bencher| bencher.iter(|| Pair::new(black_box(&a), &b).is_ok()));
        group.bench_function("psnr", |bencher| {
            bencher.iter(|| pool.install(|| psnr(black_box(&pair), Values::Clipped)));
        });
        group.bench_function("l1", |bencher| bencher.iter(|| pool.install(|| l1(black_box(&pair), Values::Clipped))));
        for (name, convention) in
            [("ssim", Ssim::SKIMAGE_GAUSSIAN), ("ssim-inria", Ssim::INRIA), ("ssim-uniform-7x7", Ssim::SKIMAGE_UNIFORM)]
        {
            group.bench_function(name, |bencher| {
                bencher.iter(|| pool.install(|| ssim(black_box(&pair), Values::AsRendered, convention).ok()));
            });
        }
        group.finish();
    }
}

criterion_group!(benches, metrics);
criterion_main!(benches);
