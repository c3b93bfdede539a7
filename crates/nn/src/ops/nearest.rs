use burn::Tensor;
use burn::tensor::Int;
use rayon::prelude::*;

use super::top_k::indices;

/// The numbers of the `k` points nearest to each query, nearest first: `[batch, queries, dimensions]` and
/// `[batch, points, dimensions]` to `[batch, queries, k]`.
///
/// Distances are Euclidean, in f32. Of points equally far the one with the lower number comes first; where queries are
/// the points themselves, each is therefore its own first neighbour unless an earlier one coincides with it. A distance
/// that is not a number counts as infinite. Every pair is looked at: for 6 000 points that takes a few hundredths of a second.
/// No gradient flows.
///
/// # Panics
/// When the shapes do not fit together, when there are fewer than `k` points, or when the points cannot be read from
/// their device.
pub fn nearest_neighbours(queries: Tensor<3>, points: Tensor<3>, k: usize) -> Tensor<3, Int> {
    let ([batch, query_count, dimensions], [samples, count, others]) = (queries.dims(), points.dims());
    assert_eq!([batch, dimensions], [samples, others], "batch and dimensions of queries, and of points");
    assert!(k <= count, "{k} nearest of {count} points");
    let device = points.device();
    let (queries, points) = (queries.into_data_as::<f32>(), points.into_data_as::<f32>());
    let queries = queries.as_slice::<f32>().unwrap_or_default();
    let points = by_dimension(points.as_slice::<f32>().unwrap_or_default(), count, dimensions);
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
    indices(all.into_iter().flatten(), [batch, query_count, k], &device)
}

/// In each sample, all first coordinates, then all second ones.
fn by_dimension(points: &[f32], count: usize, dimensions: usize) -> Vec<f32> {
    let size = (count * dimensions).max(1);
    let samples = points.chunks_exact(size);
    samples
        .flat_map(|sample| (0..dimensions).flat_map(move |at| sample.iter().skip(at).step_by(dimensions)))
        .copied()
        .collect()
}

/// The places of the `k` smallest, the smallest first.
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
