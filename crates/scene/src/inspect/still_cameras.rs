//! Cameras that stand still for a part of their scene, or only turn.

use std::collections::BTreeMap;

use atsplat_camera::{CentreSpread, WorldFromCamera};

use crate::Scene;
use crate::checks::still_cameras::{MIN_FRAMES, one_pose, poses};

/// What is said about frames with exactly an earlier frame's pose, and about a scene whose cameras are all in one place; `None` where
/// [`one_pose`] says it. Videos have still stretches.
pub(super) fn still_cameras(scene: &Scene) -> Option<String> {
    if one_pose(scene).is_some() {
        return None;
    }
    let mut first_with: BTreeMap<[u64; 12], usize> = BTreeMap::new();
    let mut repeats: Vec<(usize, usize)> = Vec::new();
    for (at, pose) in poses(scene) {
        let earlier = *first_with.entry(pose).or_insert(at);
        if earlier != at {
            repeats.push((earlier, at));
        }
    }
    let repeated = repeats.first().map(|(earlier, at)| {
        let (count, frames) = (repeats.len(), scene.frames.len());
        format!("{count} of {frames} frames repeat an earlier pose, first frame {at} that of frame {earlier}")
    });
    let place = match spread(scene) {
        CentreSpread::Apart => None,
        CentreSpread::Close => {
            Some("all camera centres are closer together than 1e-6 of their distance from the origin")
        }
        CentreSpread::Coincident => Some("all camera centres coincide"),
    };
    let found: Vec<String> = repeated.into_iter().chain(place.map(str::to_owned)).collect();
    (!found.is_empty()).then(|| found.join("; "))
}

/// Whether all cameras of a scene are in one place, so that nothing in it has a depth.
pub(super) fn is_in_one_place(scene: &Scene) -> bool {
    spread(scene) == CentreSpread::Coincident
}

/// That of the usable poses; [`CentreSpread::Apart`] for a few, which may well be from one place.
fn spread(scene: &Scene) -> CentreSpread {
    let posed = scene.frames.iter().filter(|frame| frame.has_pose());
    let views: Vec<WorldFromCamera> = posed.map(|frame| frame.camera.camera_from_world.inverse()).collect();
    if views.len() >= MIN_FRAMES { CentreSpread::of(&views) } else { CentreSpread::Apart }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_source::{camera_at, rotated_camera_at, scene};
    use atsplat_camera::{Camera, CameraFromWorld};

    #[test]
    fn repeated_poses_are_counted() {
        let [a, b, c] = [0.1, 0.2, 0.3].map(|x| camera_at([x, 0.0, 0.0]));
        assert_eq!(still_cameras(&scene("s", [a; 3])), None, "said when a scene is loaded");
        assert_eq!(still_cameras(&scene("s", [a, b, c])), None);
        let expected = "3 of 6 frames repeat an earlier pose, first frame 3 that of frame 1";
        assert_eq!(still_cameras(&scene("s", [a, b, c, b, b, a])).as_deref(), Some(expected));
    }

    #[test]
    fn cameras_that_only_turn_are_in_one_place() {
        let turned = |angles: &[f64]| {
            let cameras: Vec<Camera> = angles.iter().map(|angle| rotated_camera_at([9.3, -4.1, 2.7], *angle)).collect();
            still_cameras(&scene("s", cameras))
        };
        assert_eq!(turned(&[0.0, 11.0, 37.0]).as_deref(), Some("all camera centres coincide"));
        let expected =
            "1 of 3 frames repeat an earlier pose, first frame 2 that of frame 0; all camera centres coincide";
        assert_eq!(turned(&[0.0, 11.0, 0.0]).as_deref(), Some(expected));
        assert_eq!(turned(&[0.0, 11.0]), None, "two frames");
    }

    /// As `run` says of the same cameras.
    #[test]
    fn rounding_is_no_motion_and_a_motion_is_no_rounding() {
        let found = |places: [f64; 3], rounded: fn(f64) -> f64| {
            let cameras = [(places[0], 3.0), (places[1], 11.0), (places[2], 37.0)].map(|(x, angle)| {
                let camera = rotated_camera_at([x, -4.1, 2.7], angle);
                let rows = camera.camera_from_world.to_rows().map(rounded);
                Camera { camera_from_world: CameraFromWorld::from_rows(&rows).unwrap(), ..camera }
            });
            still_cameras(&scene("s", cameras))
        };
        #[expect(clippy::cast_possible_truncation, reason = "what a chunk stores")]
        let in_f32 = |number: f64| f64::from(number as f32);
        assert_eq!(found([9.3; 3], in_f32).as_deref(), Some("all camera centres coincide"));
        assert_eq!(found([9.3, 9.301, 9.302], in_f32), None);
        let close = "all camera centres are closer together than 1e-6 of their distance from the origin";
        assert_eq!(found([1e6, 1e6 + 1e-1, 1e6 - 2e-1], |number| number).as_deref(), Some(close));
    }
}
