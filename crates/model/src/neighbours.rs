//! Exact nearest neighbours of anchors, the same for any number of threads.

use rayon::prelude::*;

use crate::ModelError;

/// Largest number of points in a leaf, which are compared one by one.
const LEAF: usize = 12;

/// The nearest points of each point.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Neighbours {
    /// Number of neighbours of each point: as many as requested, or all points if there are fewer.
    pub per_point: usize,
    /// Neighbours point by point, nearest first.
    pub indices: Vec<u32>,
}

impl Neighbours {
    /// The neighbours of a point, nearest first.
    ///
    /// # Panics
    /// If there is no such point.
    pub fn of(&self, point: usize) -> &[u32] {
        &self.indices[point * self.per_point..(point + 1) * self.per_point]
    }
}

/// The `count` nearest points of every point, including itself; ties go to the lower index.
///
/// Distances are sums of squares in f64 of f32 coordinates: differences of f32 are exact in f64, and every machine orders
/// them in the same way. A k-d tree makes the search O(N log N); coincident points do not slow it down.
///
/// # Errors
/// [`ModelError::Malformed`] if a coordinate is not finite, or there are more than 2³² points.
pub fn nearest_neighbours(points: &[[f32; 3]], count: usize) -> Result<Neighbours, ModelError> {
    check_finite(points)?;
    if u32::try_from(points.len()).is_err() {
        return Err(ModelError::malformed("anchors", "count", "at most 4294967295", points.len()));
    }
    let per_point = count.min(points.len());
    if per_point == 0 {
        return Ok(Neighbours { per_point, indices: Vec::new() });
    }
    let tree = Tree::build(points);
    let mut indices = vec![0u32; per_point * points.len()];
    indices.par_chunks_mut(per_point).zip(points).for_each_with(Vec::new(), |nearest, (row, &point)| {
        nearest.clear();
        let mut search = Search { tree: &tree, point: point.map(f64::from), count: per_point, nearest };
        search.descend(0, tree.points.len(), 0);
        for (to, found) in row.iter_mut().zip(nearest.iter()) {
            *to = found.index;
        }
    });
    Ok(Neighbours { per_point, indices })
}

/// `(dx² + dy²) + dz²` in f64.
pub(crate) fn squared_distance(a: [f32; 3], b: [f32; 3]) -> f64 {
    let [dx, dy, dz] = [0, 1, 2].map(|axis| f64::from(a[axis]) - f64::from(b[axis]));
    (dx * dx + dy * dy) + dz * dz
}

pub(crate) fn check_finite(points: &[[f32; 3]]) -> Result<(), ModelError> {
    match points.iter().enumerate().find(|(_, point)| !point.iter().all(|coordinate| coordinate.is_finite())) {
        None => Ok(()),
        Some((anchor, point)) => {
            let found = format!("{point:?}");
            Err(ModelError::malformed("anchors", format!("anchor {anchor}"), "finite coordinates", found))
        }
    }
}

/// A balanced k-d tree without pointers: every range of `points` is divided at its middle.
struct Tree {
    points: Vec<([f32; 3], u32)>,
    /// Splits of all inner ranges, in preorder.
    splits: Vec<Split>,
}

#[derive(Clone, Copy)]
struct Split {
    axis: usize,
    at: f32,
    /// Number of splits of the left half, after which those of the right half follow.
    left_splits: usize,
    /// Lowest index in each half, to prune among equally near points.
    lowest: [u32; 2],
}

impl Tree {
    fn build(points: &[[f32; 3]]) -> Self {
        let numbered = points.iter().copied().zip(0u32..);
        let mut tree = Self { points: numbered.collect(), splits: Vec::new() };
        let mut points = std::mem::take(&mut tree.points);
        tree.divide(&mut points);
        tree.points = points;
        tree
    }

    /// Sorts a range into the tree and returns its lowest index.
    fn divide(&mut self, range: &mut [([f32; 3], u32)]) -> u32 {
        if range.len() <= LEAF {
            range.sort_unstable_by_key(|&(_, index)| index);
            return range.first().map_or(u32::MAX, |&(_, index)| index);
        }
        let axis = widest_axis(range);
        let middle = range.len() / 2;
        let (_, &mut (point, _), _) =
            range.select_nth_unstable_by(middle, |(a, i), (b, j)| a[axis].total_cmp(&b[axis]).then(i.cmp(j)));
        let number = self.splits.len();
        self.splits.push(Split { axis, at: point[axis], left_splits: 0, lowest: [0; 2] });
        let (left, right) = range.split_at_mut(middle);
        let lowest_left = self.divide(left);
        let left_splits = self.splits.len() - number - 1;
        let lowest = [lowest_left, self.divide(right)];
        let split = &mut self.splits[number];
        (split.left_splits, split.lowest) = (left_splits, lowest);
        lowest[0].min(lowest[1])
    }
}

fn widest_axis(range: &[([f32; 3], u32)]) -> usize {
    let extent = |axis: usize| {
        let bounds = range.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], (point, _)| {
            let x = point[axis];
            [if x < low { x } else { low }, if x > high { x } else { high }]
        });
        f64::from(bounds[1]) - f64::from(bounds[0])
    };
    let extents = [0, 1, 2].map(extent);
    (1..3).fold(0, |widest, axis| if extents[axis] > extents[widest] { axis } else { widest })
}

#[derive(Clone, Copy)]
struct Found {
    distance: f64,
    index: u32,
}

impl Found {
    fn is_before(self, other: Self) -> bool {
        self.distance < other.distance || (self.distance <= other.distance && self.index < other.index)
    }
}

struct Search<'a> {
    tree: &'a Tree,
    point: [f64; 3],
    count: usize,
    /// Sorted, at most `count`.
    nearest: &'a mut Vec<Found>,
}

impl Search<'_> {
    /// Searches a range whose first split is `split`.
    fn descend(&mut self, start: usize, end: usize, split: usize) {
        if end - start <= LEAF {
            for &(point, index) in &self.tree.points[start..end] {
                let [dx, dy, dz] = [0, 1, 2].map(|axis| self.point[axis] - f64::from(point[axis]));
                self.offer(Found { distance: (dx * dx + dy * dy) + dz * dz, index });
            }
            return;
        }
        let Split { axis, at, left_splits, lowest } = self.tree.splits[split];
        let middle = start + (end - start) / 2;
        let beyond = self.point[axis] - f64::from(at);
        let halves = [(start, middle, split + 1), (middle, end, split + 1 + left_splits)];
        let near = usize::from(beyond > 0.0);
        let (from, to, next) = halves[near];
        self.descend(from, to, next);
        let far = 1 - near;
        // Rounding is monotone, so no point beyond the plane has a smaller computed distance than the plane.
        if self.may_enter(Found { distance: beyond * beyond, index: lowest[far] }) {
            let (from, to, next) = halves[far];
            self.descend(from, to, next);
        }
    }

    fn may_enter(&self, found: Found) -> bool {
        self.nearest.len() < self.count || self.nearest.last().is_none_or(|last| found.is_before(*last))
    }

    fn offer(&mut self, found: Found) {
        if self.may_enter(found) {
            self.nearest.truncate(self.count - 1);
            let place = self.nearest.partition_point(|other| other.is_before(found));
            self.nearest.insert(place, found);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_tests::on_threads;
    use proptest::prelude::*;

    fn by_brute_force(points: &[[f32; 3]], count: usize) -> Vec<u32> {
        let row = |&point: &[f32; 3]| {
            let mut order: Vec<(f64, u32)> =
                points.iter().zip(0..).map(|(&other, index)| (squared_distance(point, other), index)).collect();
            order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            order.truncate(count);
            order.into_iter().map(|(_, index)| index)
        };
        points.iter().flat_map(row).collect()
    }

    fn on_a_grid() -> impl Strategy<Value = Vec<[f32; 3]>> {
        prop::collection::vec(prop::array::uniform3((-2i8..3).prop_map(f32::from)), 0..150)
    }

    fn anywhere() -> impl Strategy<Value = Vec<[f32; 3]>> {
        prop::collection::vec(prop::array::uniform3(prop_oneof![-1e3f32..1e3, -1e-3f32..1e-3]), 0..150)
    }

    proptest! {
        #[test]
        fn agrees_with_brute_force(points in prop_oneof![on_a_grid(), anywhere()], count in 0usize..20) {
            let found = nearest_neighbours(&points, count).unwrap();
            prop_assert_eq!(found.per_point, count.min(points.len()));
            prop_assert_eq!(found.indices, by_brute_force(&points, count));
        }
    }

    #[test]
    fn coincident_points_do_not_slow_the_search() {
        let points = vec![[0.5; 3]; 20_000];
        let found = nearest_neighbours(&points, 16).unwrap();
        assert!((0..points.len()).all(|point| found.of(point).iter().copied().eq(0..16)));
    }

    #[test]
    fn results_are_the_same_on_any_number_of_threads() {
        let stream = crate::hash::Stream::of(&[3]);
        #[expect(clippy::cast_possible_truncation, reason = "f32 coordinates")]
        let points: Vec<[f32; 3]> =
            (0..3000u64).map(|point| [0, 1, 2].map(|axis| stream.signed_unit(3 * point + axis) as f32)).collect();
        let with = |threads| on_threads(threads, || nearest_neighbours(&points, 16).unwrap());
        assert_eq!(with(1), with(7));
        assert_eq!(with(1).indices, by_brute_force(&points, 16));
    }

    #[test]
    fn names_points_that_are_not_finite() {
        let error = nearest_neighbours(&[[0.0; 3], [0.0, f32::INFINITY, 0.0]], 1).unwrap_err().to_string();
        assert!(error.contains("anchor 1") && error.contains("inf"), "{error}");
        let far = [[f32::MAX; 3], [-f32::MAX; 3], [0.0; 3]];
        assert_eq!(nearest_neighbours(&far, 3).unwrap().of(0), [0, 2, 1]);
    }
}
