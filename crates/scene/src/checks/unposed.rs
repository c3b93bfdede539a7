//! Frames whose pose is not finite or not a rotation: they keep their position, and whatever uses them fails.

use crate::{Frame, FrameImage, Scene, SceneError};

pub(crate) fn no_pose(scene: &str, frame: usize, reason: &str) -> SceneError {
    SceneError::NoPose { scene: scene.to_owned(), frame, reason: reason.to_owned() }
}

impl Frame {
    /// Whether the frame has a usable pose.
    pub const fn has_pose(&self) -> bool {
        !matches!(self.image, FrameImage::Unposed { .. })
    }

    /// Rejects a frame without a usable pose. `scene` and `position` identify it in the message.
    ///
    /// # Errors
    /// [`SceneError::NoPose`].
    pub fn require_pose(&self, scene: &str, position: usize) -> Result<(), SceneError> {
        match &self.image {
            FrameImage::Unposed { reason, .. } => Err(no_pose(scene, position, reason)),
            _ => Ok(()),
        }
    }
}

impl Scene {
    /// The scene, unless none of its frames has a usable pose: then its file is wrong, and not a frame.
    pub(crate) fn require_a_pose(self) -> Result<Self, SceneError> {
        if let Some(first) = self.frames.first()
            && !self.frames.iter().any(Frame::has_pose)
        {
            first.require_pose(&self.key, 0)?;
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use atsplat_pixels::{DecodeLimits, ImageU8, encode_png};

    use super::*;
    use crate::torch::ChunkScene;
    use crate::{SceneSource as _, SharedBytes, WarningKind, Warnings, open};

    /// World-to-camera rows of the frame at a position: at 1 all are NaN, at 3 the rotation is doubled.
    fn rows(at: usize) -> [f64; 12] {
        if at == 1 {
            return [f64::NAN; 12];
        }
        let scale = if at == 3 { 2.0 } else { 1.0 };
        [scale, 0.0, 0.0, at as f64, 0.0, scale, 0.0, 0.0, 0.0, 0.0, scale, 0.0]
    }

    fn png() -> Vec<u8> {
        encode_png(&ImageU8::new(4, 3, vec![9; 36]).unwrap()).unwrap()
    }

    fn write(folder: &Path, name: &str, bytes: &[u8]) {
        atsplat_tests::write_file(&folder.join(name), bytes);
    }

    fn write_trajectory(folder: &Path, frames: &[usize]) {
        let row = |at: &usize| {
            let pose: Vec<String> = rows(*at).iter().map(f64::to_string).collect();
            format!("{at} 0.75 1 0.5 0.5 0 0 {}\n", pose.join(" "))
        };
        write(folder, "s.txt", frames.iter().map(row).collect::<String>().as_bytes());
    }

    /// As Python writes it, with NaN.
    fn write_transforms(folder: &Path, frames: &[usize]) {
        let frame = |at: &usize| {
            let matrix: Vec<Vec<f64>> = rows(*at).chunks(4).map(<[f64]>::to_vec).collect();
            format!(r#"{{"file_path": "images/{at}.png", "transform_matrix": {matrix:?}, "sharpness": NaN}}"#)
        };
        let listed: Vec<String> = frames.iter().map(frame).collect();
        let root = format!(r#"{{"w": 4, "h": 3, "fl_x": 3, "frames": [{}]}}"#, listed.join(", "));
        write(folder, "s/transforms.json", root.as_bytes());
    }

    fn write_model(folder: &Path, frames: &[usize]) {
        let image = |at: &usize| {
            let w = [1.0, f64::NAN, 1.0, 0.0, 1.0][*at];
            format!("{at} {w} 0 0 0 {at} 0 0 1 {at}.png\n\n")
        };
        write(folder, "s/sparse/0/cameras.txt", b"1 PINHOLE 4 3 3 3 2 1.5\n");
        write(folder, "s/sparse/0/images.txt", frames.iter().map(image).collect::<String>().as_bytes());
    }

    /// A dataset of one scene in each format but that of chunks.
    fn loaded(write_poses: fn(&Path, &[usize]), frames: &[usize]) -> Result<(Scene, Warnings), SceneError> {
        let folder = tempfile::tempdir().unwrap();
        for images in ["s", "s/images"] {
            for at in frames {
                write(folder.path(), &format!("{images}/{at}.png"), &png());
            }
        }
        write_poses(folder.path(), frames);
        let mut warnings = Warnings::new();
        let scene = open(folder.path(), &mut warnings)?.load("s", &mut warnings)?;
        assert_eq!(scene.decode(0, &DecodeLimits::default()).unwrap().width(), 4);
        Ok((scene, warnings))
    }

    #[test]
    fn a_frame_without_a_pose_keeps_its_position_and_the_others_are_usable() {
        type Write = fn(&Path, &[usize]);
        let formats: [(Write, [&str; 2], &str); 3] = [
            (write_trajectory, ["line 2: pose: expected a finite", "line 4: rotation: expected"], "s.txt"),
            (write_transforms, ["frames[1].transform_matrix: pose: ", "frames[3].transform_matrix: rot"], "s.json"),
            (write_model, ["line 3, QW: expected a quaternion", "line 7, QW: expected a quaternion"], "images.txt"),
        ];
        for (write_poses, places, file) in formats {
            let (scene, warnings) = loaded(write_poses, &[0, 1, 2, 3, 4]).unwrap();
            let has_pose: Vec<bool> = scene.frames.iter().map(Frame::has_pose).collect();
            assert_eq!(has_pose, [true, false, true, false, true], "{file}");
            let centres = scene.frames.iter().map(|frame| frame.camera.camera_from_world.inverse().centre().x);
            assert_eq!(centres.map(f64::is_nan).collect::<Vec<_>>(), [false, true, false, true, false], "{file}");
            for (at, place) in [(1, places[0]), (3, places[1])] {
                let frame = &scene.frames[at];
                let image = frame.image.listed_file().unwrap();
                assert!(image.ends_with(format!("{at}.png")) && frame.image.file().is_none(), "{image:?}");
                for error in [frame.header("s", at).unwrap_err(), frame.require_pose("s", at).unwrap_err()] {
                    let message = error.to_string();
                    let start = format!("frame {at} of scene \"s\" has no usable pose: ");
                    assert!(message.starts_with(&start) && message.contains(place), "{message}");
                    assert!(message.contains(file), "{message}");
                }
            }
            assert_eq!(warnings.count(WarningKind::BadCamera), 1, "{file}: {:?}", warnings.kept());
            let warning = warnings.kept().iter().find(|warning| warning.kind == WarningKind::BadCamera).unwrap();
            assert!(warning.detail.starts_with("2 of 5 frames, first 1: ") && warning.detail.contains(places[0]));
            assert!(warning.detail.contains("1.png: "), "the image: {}", warning.detail);
            let error = loaded(write_poses, &[1, 3]).unwrap_err();
            assert!(matches!(error, SceneError::NoPose { frame: 0, .. }), "without any pose: {error}");
        }
    }

    #[test]
    fn a_row_of_a_chunk_without_a_pose_leaves_the_others_usable() {
        let row = |at: &usize| {
            let mut row = [0.0; 18];
            row[..4].copy_from_slice(&[0.75, 1.0, 0.5, 0.5]);
            row[6..].copy_from_slice(&rows(*at));
            row
        };
        let stored = |frames: &[usize]| ChunkScene {
            key: "s".to_owned(),
            url: String::new(),
            timestamps: frames.iter().map(|at| i64::try_from(*at).unwrap()).collect(),
            cameras: frames.iter().map(row).collect(),
            images: frames.iter().map(|_| SharedBytes::new(png())).collect(),
        };
        let path = Path::new("0.torch");
        let scene = stored(&[0, 1, 2, 3]).to_scene(path).unwrap();
        for at in [0, 2] {
            assert_eq!(scene.decode(at, &DecodeLimits::default()).unwrap().width(), 4, "{at}");
        }
        for (at, place) in [(1, "frame 1: pose: expected a finite"), (3, "frame 3: rotation: expected")] {
            let message = scene.decode(at, &DecodeLimits::default()).unwrap_err().to_string();
            assert!(message.contains(&format!("scene \"s\", {place}")) && message.contains("0.torch"), "{message}");
        }
        assert!(matches!(stored(&[3, 1]).to_scene(path), Err(SceneError::NoPose { frame: 0, .. })));
        let stored_again = ChunkScene::from_scene(&scene, &mut Warnings::new());
        assert!(matches!(stored_again, Err(SceneError::NoPose { frame: 1, .. })), "{stored_again:?}");
    }
}
