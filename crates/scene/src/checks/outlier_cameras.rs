//! Cameras far outside the others of their scene.

use atsplat_numeric::median;
use glam::DVec3;

use crate::Scene;

/// Frames below which "the others" are too few to say where cameras are.
const MIN_FRAMES: usize = 8;

/// Share of a scene's cameras that are taken to be in place, as a fraction.
const IN_PLACE: (usize, usize) = (9, 10);

/// How many times farther from the median centre than those in place.
const FAR_OUTSIDE: f64 = 20.0;

/// How many times farther than the next camera inwards. A camera that stands still for most of a clip and then moves away
/// is gradually farther, one that structure from motion failed to place suddenly.
const GAP: f64 = 5.0;

/// What is suspicious about cameras that are far outside the others, with their number and the first of them.
///
/// Distances are from the median of the centres, coordinate by coordinate. A camera is far outside if its distance is more
/// than [`FAR_OUTSIDE`] times the 90th percentile (of the two distances around it the smaller, so that one frame of eight
/// does not count as in place), and there is a gap of [`GAP`] times in the distances before it. Centres with coordinates
/// beyond `farthest` are left out. There are none in scenes of fewer than [`MIN_FRAMES`], or with nine tenths of the
/// cameras in one place.
pub(crate) fn outlier_cameras(scene: &Scene, farthest: f64) -> Option<String> {
    let centres = scene.frames.iter().map(|frame| frame.camera.camera_from_world.inverse().centre());
    let near: Vec<(usize, DVec3)> =
        centres.enumerate().filter(|(_, centre)| centre.abs().max_element() <= farthest).collect();
    if near.len() < MIN_FRAMES {
        return None;
    }
    let along = |axis: fn(&DVec3) -> f64| median(near.iter().map(|(_, centre)| axis(centre)));
    let middle = DVec3::new(along(|c| c.x)?, along(|c| c.y)?, along(|c| c.z)?);
    let distances: Vec<(usize, f64)> = near.iter().map(|(at, centre)| (*at, centre.distance(middle))).collect();
    let mut sorted: Vec<f64> = distances.iter().map(|(_, distance)| *distance).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let in_place = *sorted.get((sorted.len() - 1) * IN_PLACE.0 / IN_PLACE.1)?;
    let is_gap = |pair: &[f64]| match pair {
        [inner, outer] => *outer > FAR_OUTSIDE * in_place && *outer > GAP * inner,
        _ => false,
    };
    // If nine tenths are in one place, any other camera would be infinitely many times farther.
    let edge = sorted.windows(2).find(|pair| in_place > 0.0 && is_gap(pair))?;
    let edge = *edge.last()?;
    let mut outside = distances.iter().filter(|(_, distance)| *distance >= edge);
    let (first, distance) = outside.next()?;
    let count = outside.count() + 1;
    Some(format!(
        "{count} of {} frames, first {first}: {distance:.4e} from the median centre, where nine tenths of the cameras are \
         within {in_place:.4e}",
        scene.frames.len()
    ))
}

#[cfg(all(test, feature = "columns"))]
mod tests {
    use super::*;
    use crate::test_source::{camera_at, scene};

    /// Cameras on the x axis.
    fn found(along: impl IntoIterator<Item = f64>) -> Option<String> {
        outlier_cameras(&scene("s", along.into_iter().map(|x| camera_at([x, 0.0, 5.0]))), 1e9)
    }

    fn line(frames: u32) -> impl Iterator<Item = f64> {
        (0..frames).map(f64::from)
    }

    #[test]
    fn one_distant_camera_is_outside_and_named() {
        let with_last = |frames: u32, last: f64| found(line(frames - 1).chain([last]));
        let detail = with_last(24, 1e6).unwrap();
        assert!(detail.starts_with("1 of 24 frames, first 23: 9.9999e5 from the median centre"), "{detail}");
        assert!(detail.ends_with("within 1.0500e1"), "nine tenths of 24: the 21st of the sorted distances: {detail}");
        assert!(with_last(8, -1e3).is_some(), "one of eight is not in place itself");
        assert_eq!((with_last(7, 1e6), with_last(24, 100.0)), (None, None), "too few, and 8.4 times as far");
        assert_eq!(with_last(24, 1e10), None, "reported as a distant camera");
        let two = found([1e6].into_iter().chain(line(30)).chain([1e6 + 1.0])).unwrap();
        assert!(
            two.starts_with("2 of 32 frames, first 0: "),
            "two far cameras next to each other are both outside: {two}"
        );
    }

    #[test]
    fn a_clip_that_stands_still_before_it_moves_has_no_camera_outside() {
        let still = (0..200).map(|at| 1e-3 * f64::from(at % 7));
        let moving = (1..10).map(|at| 0.05 * f64::from(at * at));
        assert_eq!(found(still.clone().chain(moving.clone())), None);
        assert_eq!(found(still.clone().chain(moving).map(|x| 1e3 * x)), None, "in a smaller unit of length");
        assert!(found(still.chain([40.0])).is_some());
        assert_eq!(found(std::iter::repeat_n(0.0, 100).chain([1e-15])), None, "a tripod, with rounding");
    }
}
