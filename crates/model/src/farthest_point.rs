//! Farthest point sampling: the alternative to selection by uncertainty in the paper's ablation.

use crate::ModelError;
use crate::neighbours::{check_finite, squared_distance};

/// Selects `count` points, or all if there are fewer: the first, then repeatedly the point farthest from those chosen so
/// far; ties go to the lower index. Returned indices ascend.
///
/// Distances are sums of squares in f64 of f32 coordinates, so that every machine selects the same points.
///
/// # Errors
/// [`ModelError::Malformed`] if a coordinate is not finite.
pub fn farthest_points(points: &[[f32; 3]], count: usize) -> Result<Vec<usize>, ModelError> {
    check_finite(points)?;
    if count >= points.len() {
        return Ok((0..points.len()).collect());
    }
    let mut chosen = Vec::with_capacity(count);
    let mut distances = vec![f64::INFINITY; points.len()];
    let mut next = 0;
    while chosen.len() < count {
        chosen.push(next);
        let latest = points[next];
        // Below every distance, so that coincident points are chosen in order and none twice.
        distances[next] = -1.0;
        let mut farthest = -1.0;
        for (index, (distance, &point)) in distances.iter_mut().zip(points).enumerate() {
            let to_latest = squared_distance(point, latest);
            if to_latest < *distance {
                *distance = to_latest;
            }
            if *distance > farthest {
                (farthest, next) = (*distance, index);
            }
        }
    }
    chosen.sort_unstable();
    Ok(chosen)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn corners_come_before_the_middle() {
        let points = [[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
        assert_eq!(farthest_points(&points, 1).unwrap(), [0]);
        assert_eq!(farthest_points(&points, 2).unwrap(), [0, 3]);
        assert_eq!(farthest_points(&points, 3).unwrap(), [0, 2, 3]);
        assert_eq!(farthest_points(&points, 9).unwrap(), [0, 1, 2, 3]);
        assert!(farthest_points(&points, 0).unwrap().is_empty());
    }

    #[test]
    fn coincident_points_are_selected_once_each_in_order() {
        assert_eq!(farthest_points(&[[1.0; 3]; 6], 4).unwrap(), [0, 1, 2, 3]);
        let mut points = vec![[0.0; 3]; 5];
        points.push([1.0; 3]);
        assert_eq!(farthest_points(&points, 3).unwrap(), [0, 1, 5]);
        assert!(farthest_points(&[[f32::NAN, 0.0, 0.0]], 1).is_err());
    }

    proptest! {
        #[test]
        fn each_choice_maximises_the_distance_to_the_earlier_ones(
            points in prop::collection::vec(prop::array::uniform3((-3i8..4).prop_map(f32::from)), 1..40),
            count in 0usize..40,
        ) {
            let count = count.min(points.len());
            let mut chosen: Vec<usize> = Vec::new();
            for _ in 0..count {
                let nearest = |index: usize| chosen.iter()
                    .map(|&other| squared_distance(points[index], points[other]))
                    .fold(f64::INFINITY, |least, distance| if distance < least { distance } else { least });
                let best = (0..points.len()).filter(|index| !chosen.contains(index))
                    .rev().max_by(|&a, &b| nearest(a).total_cmp(&nearest(b)));
                chosen.push(best.unwrap());
            }
            // `max_by` keeps the last of equals, and the indices run backwards.
            chosen.sort_unstable();
            prop_assert_eq!(farthest_points(&points, count).unwrap(), chosen);
        }
    }
}
