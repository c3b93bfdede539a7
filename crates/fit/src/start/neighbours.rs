//! Distances to the nearest points, with a k-d tree.

use rayon::prelude::*;

/// Neighbours whose distances are averaged.
const NEIGHBOURS: usize = 3;
/// Points in a leaf.
const LEAF: usize = 12;

/// Mean squared distance of each point from its three nearest others; there must be at least four points.
pub(super) fn mean_squared_distances(points: &[[f64; 3]]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    sort(points, &mut order, 0);
    let of = |(at, point): (usize, &[f64; 3])| {
        let mut nearest = [f64::INFINITY; NEIGHBOURS];
        search(points, &order, 0, (at, *point), &mut nearest);
        nearest.iter().sum::<f64>() / NEIGHBOURS as f64
    };
    points.par_iter().enumerate().map(of).collect()
}

/// Orders the points so that the middle one separates the halves along an axis, which changes from level to level.
fn sort(points: &[[f64; 3]], order: &mut [usize], axis: usize) {
    if order.len() <= LEAF {
        return;
    }
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |a, b| coordinate(points, *a, axis).total_cmp(&coordinate(points, *b, axis)));
    let (below, rest) = order.split_at_mut(middle);
    sort(points, below, (axis + 1) % 3);
    if let Some((_, above)) = rest.split_first_mut() {
        sort(points, above, (axis + 1) % 3);
    }
}

fn search(points: &[[f64; 3]], order: &[usize], axis: usize, of: (usize, [f64; 3]), nearest: &mut [f64; NEIGHBOURS]) {
    if order.len() <= LEAF {
        for other in order {
            consider(points, *other, of, nearest);
        }
        return;
    }
    let (below, rest) = order.split_at(order.len() / 2);
    let Some((&middle, above)) = rest.split_first() else { return };
    consider(points, middle, of, nearest);
    let offset = along(&of.1, axis) - coordinate(points, middle, axis);
    let (near, far) = if offset < 0.0 { (below, above) } else { (above, below) };
    search(points, near, (axis + 1) % 3, of, nearest);
    if offset * offset < nearest[NEIGHBOURS - 1] {
        search(points, far, (axis + 1) % 3, of, nearest);
    }
}

fn consider(points: &[[f64; 3]], other: usize, (position, at): (usize, [f64; 3]), nearest: &mut [f64; NEIGHBOURS]) {
    let Some(point) = points.get(other).filter(|_| other != position) else { return };
    let squared: f64 = point.iter().zip(at).map(|(a, b)| (a - b).powi(2)).sum();
    if squared < nearest[NEIGHBOURS - 1] {
        nearest[NEIGHBOURS - 1] = squared;
        nearest.sort_by(f64::total_cmp);
    }
}

#[expect(clippy::expect_used, reason = "the order lists each point once")]
fn coordinate(points: &[[f64; 3]], at: usize, axis: usize) -> f64 {
    along(points.get(at).expect("a listed point"), axis)
}

#[expect(clippy::expect_used, reason = "axes are counted modulo 3")]
fn along(point: &[f64; 3], axis: usize) -> f64 {
    *point.get(axis).expect("an axis below 3")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};

    #[test]
    fn agrees_with_comparing_all_pairs() {
        let mut random = stream(3, Purpose::Start, 0);
        let mut points: Vec<[f64; 3]> = (0..300).map(|_| std::array::from_fn(|_| random.unit())).collect();
        points.extend_from_within(0..5);
        let expected = points.iter().enumerate().map(|(position, at)| {
            let others = points.iter().enumerate().filter(|(other, _)| *other != position);
            let mut all: Vec<f64> =
                others.map(|(_, point)| point.iter().zip(at).map(|(a, b)| (a - b).powi(2)).sum()).collect();
            all.sort_by(f64::total_cmp);
            (all[0] + all[1] + all[2]) / 3.0
        });
        assert_eq!(mean_squared_distances(&points), expected.collect::<Vec<_>>());
    }
}
