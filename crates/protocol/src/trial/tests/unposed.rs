//! Frames without a usable pose.

use atsplat_camera::CameraFromWorld;
use atsplat_scene::{FrameImage, SharedBytes};

use super::{entry, only_trial, recipe};
use crate::test_source::scene;
use crate::trial::SkipReason;

/// The frame's image cannot be read either: its pose is what the data's warning is about.
#[test]
fn an_entry_is_skipped_for_an_unusable_pose_and_not_for_its_image() {
    let mut broken = scene("s", 9, 1);
    let image = FrameImage::Encoded(SharedBytes::new(b"no image".to_vec()));
    broken.frames[4].image = image.clone().unposed("s.txt: no rotation");
    broken.frames[4].camera.camera_from_world = CameraFromWorld::UNKNOWN;
    broken.frames[5].image = image;
    let skipped = |context: [usize; 2], target: usize| {
        let skipped = only_trial(broken.clone(), entry(&context, &[target]), recipe()).err()?;
        Some((skipped.reason, skipped.frame, skipped.detail))
    };
    let detail = "frame 4 of scene \"s\" has no usable pose: s.txt: no rotation".to_owned();
    let unusable = Some((SkipReason::PoseUnusable, Some(4), detail));
    assert_eq!([skipped([2, 6], 4), skipped([4, 6], 3)], [unusable.clone(), unusable]);
    assert_eq!(skipped([2, 6], 5).map(|(reason, ..)| reason), Some(SkipReason::ImageUnreadable));
    assert_eq!(skipped([2, 6], 3), None);
}
