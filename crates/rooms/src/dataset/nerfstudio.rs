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
    let (k1, k2) = match camera.distortion {
        Distortion::OpenCv { k1, k2, .. } => (k1, k2),
        Distortion::None | Distortion::Fisheye { .. } => (0.0, 0.0),
    };
    json!({
        "w": size.width, "h": size.height, "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy,
        "k1": k1, "k2": k2, "p1": 0.0, "p2": 0.0, "camera_model": "OPENCV",
    })
}
