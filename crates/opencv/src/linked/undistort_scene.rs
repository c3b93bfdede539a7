use std::collections::BTreeSet;
use std::path::Path;

use atsplat_camera::{Camera, ImageSize};
use atsplat_files::AtomicFile;
use atsplat_pixels::{DecodeLimits, encode_png};
use atsplat_scene::{Frame, Picture, Scene, WarningKind, Warnings, is_plain_name};
use serde_json::{Value, json};

use super::{OpenCvError, UndistortMode, Undistorter};

/// Frames of an undistorted scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UndistortedFrames {
    /// Pictures written.
    pub written: u64,
    /// Frames without a readable picture.
    pub skipped: u64,
}

/// Writes a scene's undistorted pictures as `<folder>/images/<frame>.png`, and their pinhole cameras as
/// `<folder>/transforms.json`. `progress` is called for each frame; pictures that cannot be read are in `warnings`.
///
/// # Errors
/// [`OpenCvError::Io`] and [`OpenCvError::Pixels`] if a file cannot be written, and as [`Undistorter::new`].
pub fn undistort_scene(
    scene: &Scene,
    mode: UndistortMode,
    folder: &Path,
    warnings: &mut Warnings,
    progress: &dyn Fn(),
) -> Result<UndistortedFrames, OpenCvError> {
    let images = folder.join("images");
    std::fs::create_dir_all(&images).map_err(OpenCvError::io("creating a folder for pictures", &images))?;
    let list = folder.join("transforms.json");
    let list_file = AtomicFile::create(&list).map_err(OpenCvError::io("writing cameras", &list))?;
    let mut undistorter: Option<(Camera, ImageSize, Undistorter)> = None;
    let (mut frames, mut names, mut skipped) = (Vec::new(), BTreeSet::new(), 0);
    for (position, frame) in scene.frames.iter().enumerate() {
        progress();
        if matches!(frame.picture, Picture::Absent | Picture::Missing(_)) {
            skipped += 1;
            continue;
        }
        let picture = match scene.decode(position, &DecodeLimits::default()) {
            Ok(picture) => picture,
            Err(error) => {
                skipped += 1;
                warnings.push(WarningKind::UnreadablePicture, &scene.key, error.to_string());
                continue;
            }
        };
        let size = ImageSize { width: picture.width(), height: picture.height() };
        let fits = |(camera, of_size, _): &(Camera, ImageSize, Undistorter)| {
            camera.intrinsics == frame.camera.intrinsics
                && camera.distortion == frame.camera.distortion
                && *of_size == size
        };
        // Frames with the same lens share a map.
        let current = match undistorter.take().filter(fits) {
            Some(current) => current,
            None => (frame.camera, size, Undistorter::new(&frame.camera, size, mode)?),
        };
        let straight = current.2.undistort(&picture)?;
        let name = format!("images/{}.png", unique_name(frame, position, &mut names));
        let path = folder.join(&name);
        atsplat_files::write(&path, &encode_png(&straight)?).map_err(OpenCvError::io("writing a picture", &path))?;
        frames.push(frame_json(frame, &name, size, &current.2));
        undistorter = Some(current);
    }
    let written = frames.len() as u64;
    let transforms = json!({ "camera_model": "PINHOLE", "frames": frames });
    let outcome = serde_json::to_writer_pretty(list_file.writer(), &transforms).map_err(std::io::Error::from);
    outcome.and_then(|()| list_file.commit()).map_err(OpenCvError::io("writing cameras", &list))?;
    Ok(UndistortedFrames { written, skipped })
}

/// The frame's name, with its position if the name is taken or is not a file name.
fn unique_name(frame: &Frame, position: usize, taken: &mut BTreeSet<String>) -> String {
    let mut name = if is_plain_name(&frame.name) { frame.name.clone() } else { "frame".to_owned() };
    while !taken.insert(name.clone()) {
        name = format!("{name}_{position:06}");
    }
    name
}

/// A frame in nerfstudio's format: OpenGL camera-to-world, pinhole intrinsics in pixels.
fn frame_json(frame: &Frame, name: &str, size: ImageSize, undistorter: &Undistorter) -> Value {
    let pose = frame.camera.camera_from_world.inverse().opengl_from_opencv().to_rows();
    let mut matrix: Vec<Vec<f64>> = pose.chunks(4).map(<[f64]>::to_vec).collect();
    matrix.push(vec![0.0, 0.0, 0.0, 1.0]);
    let k = undistorter.intrinsics().pixel_from_normalized(size);
    json!({
        "file_path": name,
        "w": size.width, "h": size.height,
        "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy,
        "transform_matrix": matrix,
    })
}
