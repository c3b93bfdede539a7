use std::path::Path;

use atsplat_camera::{Camera, Distortion, ImageSize};
use atsplat_files::FileError;
use atsplat_scene::Scene;
use serde_json::{Value, json};

use super::{ImageEncoding, encoded, make_folder, write_file};
use crate::RoomsError;

/// File name of an image without extension, numbered from 1 as in DL3DV.
pub(super) fn stem(position: usize) -> String {
    format!("frame_{:05}", position + 1)
}

/// Writes `<key>/nerfstudio/transforms.json` and `images/` next to it. Poses are camera-to-world with OpenGL axes.
pub(super) fn write(folder: &Path, scene: &Scene, encoding: ImageEncoding, size: ImageSize) -> Result<(), RoomsError> {
    let folder = folder.join(&scene.key).join("nerfstudio");
    make_folder(&folder.join("images"))?;
    let mut root = lens(&scene.frames[0].camera, size);
    let mut frames = Vec::with_capacity(scene.frames.len());
    for (at, frame) in scene.frames.iter().enumerate() {
        let file = format!("images/{}.{}", stem(at), encoding.extension());
        write_file(&folder.join(&file), encoded(frame))?;
        let rows = frame.camera.camera_from_world.inverse().opengl_from_opencv().to_rows();
        let mut matrix = rows.as_chunks::<4>().0.to_vec();
        matrix.push([0.0, 0.0, 0.0, 1.0]);
        // Cameras of a given route may differ in their focal length.
        let stated = lens(&frame.camera, size);
        let mut listed = if stated == root { json!({}) } else { stated };
        listed["file_path"] = json!(file);
        listed["transform_matrix"] = json!(matrix);
        frames.push(listed);
    }
    root["frames"] = Value::Array(frames);
    let path = folder.join("transforms.json");
    let text = serde_json::to_vec_pretty(&root).map_err(std::io::Error::from);
    let text = text.map_err(FileError::during::<RoomsError>("writing cameras", &path))?;
    write_file(&path, &text)
}

fn lens(camera: &Camera, size: ImageSize) -> Value {
    let k = camera.intrinsics.pixel_from_normalized(size);
    let (k1, k2, p1, p2) = match camera.distortion {
        Distortion::None => (0.0, 0.0, 0.0, 0.0),
        Distortion::OpenCv { k1, k2, p1, p2, .. } => (k1, k2, p1, p2),
        Distortion::Fisheye { k: [k1, k2, k3, k4] } => {
            return json!({
                "w": size.width, "h": size.height, "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy,
                "k1": k1, "k2": k2, "k3": k3, "k4": k4, "camera_model": "OPENCV_FISHEYE",
            });
        }
    };
    let mut lens = json!({
        "w": size.width, "h": size.height, "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy,
        "k1": k1, "k2": k2, "p1": p1, "p2": p2, "camera_model": "OPENCV",
    });
    // Files of lenses without it stay as they were.
    if let Distortion::OpenCv { k3, .. } = camera.distortion
        && k3 != 0.0
    {
        lens["k3"] = json!(k3);
    }
    lens
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{CameraFromWorld, NormalizedIntrinsics};
    use atsplat_pixels::{ImageU8, encode_png};
    use atsplat_scene::{Frame, FrameImage, SceneSource as _, SharedBytes, Warnings, open};
    use glam::{DMat3, DVec3};

    use super::*;

    /// The first lens is the file's; each other frame states its own.
    #[test]
    fn every_coefficient_of_a_lens_is_read_back() {
        let size = ImageSize { width: 8, height: 6 };
        let png = encode_png(&ImageU8::new(8, 6, vec![9; 8 * 6 * 3]).unwrap()).unwrap();
        let whole = Distortion::OpenCv { k1: -0.05, k2: 0.02, k3: 0.003, p1: 0.0015, p2: -0.001 };
        let radial = Distortion::OpenCv { k1: 0.04, k2: -0.01, k3: 0.0, p1: 0.0, p2: 0.0 };
        let fisheye = Distortion::Fisheye { k: [0.03, -0.004, 0.001, -0.0005] };
        for lenses in [[whole, fisheye, Distortion::None, radial], [fisheye, radial, whole, Distortion::None]] {
            let frame = |(distortion, at): (Distortion, i64)| {
                let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-0.1 * at as f64, 0.0, 0.0)).unwrap();
                let intrinsics = NormalizedIntrinsics::new(0.9, 1.2, 0.5, 0.5).unwrap();
                Frame {
                    name: at.to_string(),
                    timestamp_micros: Some(at),
                    camera: Camera { distortion, ..Camera::pinhole(pose, intrinsics) },
                    stated_size: Some(size),
                    image: FrameImage::Encoded(SharedBytes::new(png.clone())),
                }
            };
            let frames = lenses.into_iter().zip(1..).map(frame).collect();
            let folder = tempfile::tempdir().unwrap();
            let scene = Scene { key: "lenses".to_owned(), url: None, frames };
            write(folder.path(), &scene, ImageEncoding::Png, size).unwrap();
            let mut warnings = Warnings::default();
            let read = open(folder.path(), &mut warnings).unwrap().load("lenses", &mut warnings).unwrap();
            let found: Vec<Distortion> = read.frames.iter().map(|frame| frame.camera.distortion).collect();
            assert_eq!(found, lenses);
        }
    }
}
