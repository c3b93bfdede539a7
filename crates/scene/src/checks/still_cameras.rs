//! Scenes whose cameras stand still.

use crate::Scene;

/// Frames below which a scene may well be from one place.
pub(crate) const MIN_FRAMES: usize = 3;

/// What is said about a scene in which all frames have the same pose, bit for bit.
pub(crate) fn one_pose(scene: &Scene) -> Option<String> {
    let poses = poses(scene);
    let (_, first) = poses.first()?;
    let is_one = poses.len() >= MIN_FRAMES && poses.iter().all(|(_, pose)| pose == first);
    is_one.then(|| format!("all {} frames have the same pose: were the poses lost?", poses.len()))
}

/// The poses that are usable, as bits.
pub(crate) fn poses(scene: &Scene) -> Vec<(usize, [u64; 12])> {
    let frames = scene.frames.iter().enumerate().filter(|(_, frame)| frame.has_pose());
    frames.map(|(at, frame)| (at, frame.camera.camera_from_world.to_rows().map(f64::to_bits))).collect()
}

#[cfg(all(test, feature = "columns"))]
mod tests {
    use super::*;
    use crate::FrameImage;
    use crate::test_source::{camera_at, scene};

    #[test]
    fn scenes_with_one_pose_are_found() {
        let here = camera_at([0.3, 0.0, -7.0]);
        let all = scene("s", [here; 4]);
        assert_eq!(one_pose(&all).as_deref(), Some("all 4 frames have the same pose: were the poses lost?"));
        assert_eq!(one_pose(&scene("s", [here; 2])), None, "a still pair");
        let mut with_unposed = scene("s", [here, here, camera_at([0.0; 3]), here]);
        assert_eq!(one_pose(&with_unposed), None);
        with_unposed.frames[2].image = FrameImage::Absent.unposed("no rotation");
        assert!(one_pose(&with_unposed).unwrap().starts_with("all 3 frames"));
    }
}
