//! Nearest neighbours and farthest points at the sizes of the paper's settings.

use std::hint::black_box;

use atsplat_model::farthest_point::farthest_points;
use atsplat_model::neighbours::nearest_neighbours;
use criterion::{Criterion, criterion_group, criterion_main};

/// Points on a bumpy surface, like unprojected depths.
#[expect(clippy::cast_possible_truncation, reason = "coordinates")]
fn surface(count: usize) -> Vec<[f32; 3]> {
    let side = (count as f64).sqrt();
    let point = |index: usize| {
        let (x, y) = ((index as f64 / side).floor() / side, (index as f64 % side) / side);
        [x as f32, y as f32, ((9.0 * x).sin() * (7.0 * y).cos()) as f32]
    };
    (0..count).map(point).collect()
}

fn bench(criterion: &mut Criterion) {
    for count in [512, 5760, 19_440] {
        let points = surface(count);
        criterion.bench_function(&format!("nearest 16 of {count}"), |bencher| {
            bencher.iter(|| nearest_neighbours(black_box(&points), 16));
        });
    }
    let points = surface(15_552);
    criterion.bench_function("farthest 3888 of 15552", |bencher| {
        bencher.iter(|| farthest_points(black_box(&points), 3888));
    });
}

criterion_group! { name = benches; config = Criterion::default().sample_size(10); targets = bench }
criterion_main!(benches);
