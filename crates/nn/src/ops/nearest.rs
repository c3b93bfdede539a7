use burn::Tensor;
use burn::tensor::{Int, TensorData};
use rayon::prelude::*;

use crate::f32_values;

/// Indices of the `k` points nearest to each query, nearest first: `[batch, queries, dimensions]` and
/// `[batch, points, dimensions]` to `[batch, queries, k]`.
///
/// Distances are Euclidean, in f32. Ties go to the lower index; if the queries are the points themselves, each is therefore
/// its own first neighbour unless an earlier one coincides with it. A distance of NaN counts as infinite. All pairs are
/// compared: a few hundredths of a second for 6 000 points. There is no gradient.
///
/// # Panics
/// If the shapes do not fit together, there are fewer than `k` points, or the points cannot be read from their device.
pub fn nearest_neighbours(queries: Tensor<3>, points: Tensor<3>, k: usize) -> Tensor<3, Int> {
    let ([batch, query_count, dimensions], [samples, count, others]) = (queries.dims(), points.dims());
    assert_eq!([batch, dimensions], [samples, others], "batch and dimensions of queries and points");
    assert!(k <= count, "expected at least {k} points, found {count}");
    let device = points.device();
    let queries = f32_values(queries);
    let points = by_dimension(&f32_values(points), count, dimensions);
    let all = (0..batch * query_count).into_par_iter().map_init(
        || vec![0.0; count],
        |distances, query| {
            let sample = query / query_count;
            let points = &points[sample * count * dimensions..(sample + 1) * count * dimensions];
            distances.fill(0.0);
            for (dimension, &from) in queries[query * dimensions..(query + 1) * dimensions].iter().enumerate() {
                let coordinates = &points[dimension * count..(dimension + 1) * count];
                for (distance, &to) in distances.iter_mut().zip(coordinates) {
                    *distance += (from - to) * (from - to);
                }
            }
            smallest(distances, k)
        },
    );
    let all: Vec<Vec<usize>> = all.collect();
    let numbers: Vec<i64> = all.into_iter().flatten().map(|number| number.cast_signed() as i64).collect();
    Tensor::from_data(TensorData::new(numbers, [batch, query_count, k]), &device)
}

/// Transposes each sample: all first coordinates, then all second ones.
fn by_dimension(points: &[f32], count: usize, dimensions: usize) -> Vec<f32> {
    let size = (count * dimensions).max(1);
    let samples = points.chunks_exact(size);
    samples
        .flat_map(|sample| (0..dimensions).flat_map(move |at| sample.iter().skip(at).step_by(dimensions)))
        .copied()
        .collect()
}

/// Indices of the `k` smallest distances, smallest first.
fn smallest(distances: &[f32], k: usize) -> Vec<usize> {
    let mut best: Vec<(f32, usize)> = Vec::with_capacity(k + 1);
    for (place, &distance) in distances.iter().enumerate() {
        let full = best.len() == k;
        if full && !best.last().is_some_and(|&(worst, _)| distance < worst) {
            continue;
        }
        let distance = if distance.is_nan() { f32::INFINITY } else { distance };
        let at = best.partition_point(|&(before, _)| before <= distance);
        best.insert(at, (distance, place));
        best.truncate(k);
    }
    best.into_iter().map(|(_, place)| place).collect()
}
