//! Cameras that stand still for a part of their scene, or only turn.

use std::collections::BTreeMap;

use atsplat_numeric::Tolerance;
use glam::DVec3;

use crate::Scene;
use crate::checks::still_cameras::{FEWEST_FRAMES, one_pose, poses};

/// Centres are computed from rotations and translations, which rounds.
const COINCIDE: Tolerance = Tolerance { absolute: 1e-9, relative: 1e-9 };

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
    let place = are_in_one_place(scene).then(|| "all camera centres coincide".to_owned());
    let found: Vec<String> = repeated.into_iter().chain(place).collect();
    (!found.is_empty()).then(|| found.join("; "))
}

fn are_in_one_place(scene: &Scene) -> bool {
    let posed = scene.frames.iter().filter(|frame| frame.has_pose());
    let centres: Vec<DVec3> = posed.map(|frame| frame.camera.camera_from_world.inverse().centre()).collect();
    let Some(first) = centres.first() else { return false };
    let is_first = |centre: &DVec3| {
        std::iter::zip(centre.to_array(), first.to_array()).all(|(found, first)| COINCIDE.accepts(found, first))
    };
    centres.len() >= FEWEST_FRAMES && centres.iter().all(is_first)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_source::{camera_at, frame, rotated_camera_at};
    use atsplat_camera::Camera;

    fn scene(cameras: &[Camera]) -> Scene {
        let frames = cameras.iter().enumerate().map(|(at, camera)| frame(at, *camera)).collect();
        Scene { key: "s".to_owned(), url: None, frames }
    }

    #[test]
    fn repeated_poses_are_counted() {
        let [a, b, c] = [0.1, 0.2, 0.3].map(|x| camera_at([x, 0.0, 0.0]));
        assert_eq!(still_cameras(&scene(&[a; 3])), None, "said when a scene is loaded");
        assert_eq!(still_cameras(&scene(&[a, b, c])), None);
        let expected = "3 of 6 frames repeat an earlier pose, first frame 3 that of frame 1";
        assert_eq!(still_cameras(&scene(&[a, b, c, b, b, a])).as_deref(), Some(expected));
    }

    #[test]
    fn cameras_that_only_turn_are_in_one_place() {
        let turned = |angles: &[f64]| {
            let cameras: Vec<Camera> = angles.iter().map(|angle| rotated_camera_at([9.3, -4.1, 2.7], *angle)).collect();
            still_cameras(&scene(&cameras))
        };
        assert_eq!(turned(&[0.0, 11.0, 37.0]).as_deref(), Some("all camera centres coincide"));
        let expected =
            "1 of 3 frames repeat an earlier pose, first frame 2 that of frame 0; all camera centres coincide";
        assert_eq!(turned(&[0.0, 11.0, 0.0]).as_deref(), Some(expected));
        assert_eq!(turned(&[0.0, 11.0]), None, "two frames");
    }
}
