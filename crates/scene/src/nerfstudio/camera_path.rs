//! Camera paths that nerfstudio's viewer saves as `camera_paths/<name>.json`, and that `ns-render camera-path` takes.

use std::f64::consts::PI;
use std::path::Path;

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics, WorldFromCamera};
use serde_json::Value;

use super::lens::focal_of;
use super::transforms::Object;
use crate::camera_file::FileCamera;
use crate::checks::cameras::count_and_first;
use crate::files::last_name;
use crate::json::shown;
use crate::poses::is_last_row_of_pose;
use crate::{SceneError, WarningKind, Warnings};

const CAMERAS: &str = "camera_path";
const POSE: &str = "camera_to_world";

/// Relative difference of an aspect ratio from that of the images that rounding does not explain.
const SAME_ASPECT: f64 = 0.01;

/// Whether a file is a camera path, which a dataset is not.
pub(crate) fn is_camera_path(value: &Value) -> bool {
    value.get(CAMERAS).is_some() && value.get("frames").is_none()
}

/// The cameras of a camera path; `path` is for messages only.
///
/// As nerfstudio's `get_path_from_json` (`nerfstudio/cameras/camera_paths.py`) reads it: images of `render_width` × `render_height`,
/// poses as 16 numbers of a row-major camera-to-world matrix with OpenGL axes, the vertical field of view in degrees, and no
/// distortion. The world is that of the trained model, which `ns-export gaussian-splat` exports.
///
/// # Errors
/// [`SceneError::Malformed`] and [`SceneError::Camera`] with the field, [`SceneError::UnsupportedCameraModel`] for a panorama or a
/// fisheye.
pub(crate) fn camera_path(value: &Value, path: &Path, warnings: &mut Warnings) -> Result<Vec<FileCamera>, SceneError> {
    let root = Object::new(value, String::new(), path)?;
    if let Some(model) = root.text("camera_type")?.filter(|model| !model.eq_ignore_ascii_case("perspective")) {
        return Err(root.unsupported("camera_type", model, "paths of perspective cameras alone are read"));
    }
    let size = ImageSize { width: side(&root, "render_width")?, height: side(&root, "render_height")? };
    let entries = root.array(CAMERAS)?.ok_or_else(|| root.wrong(CAMERAS, "a list of cameras", "nothing"))?;
    let mut cameras = Vec::with_capacity(entries.len());
    for (number, entry) in entries.iter().enumerate() {
        let entry = Object::new(entry, format!("{CAMERAS}[{number}]"), path)?;
        cameras.push(FileCamera {
            number,
            name: number.to_string(),
            camera: Camera::pinhole(pose(&entry, path)?, intrinsics(&entry, size, path)?),
            size: Some(size),
            exposure: None,
            timestamp_micros: None,
        });
    }
    report_unread(&root, entries, size, path, warnings);
    Ok(cameras)
}

fn side(root: &Object<'_>, name: &str) -> Result<u32, SceneError> {
    let value = root.value(name);
    let side = value.and_then(Value::as_u64).and_then(|side| u32::try_from(side).ok());
    side.filter(|side| (1..=ImageSize::MAX_SIDE).contains(side)).ok_or_else(|| {
        let found = value.map_or_else(|| "nothing".to_owned(), shown);
        root.wrong(name, &format!("1 to {} pixels", ImageSize::MAX_SIDE), &found)
    })
}

fn pose(entry: &Object<'_>, path: &Path) -> Result<CameraFromWorld, SceneError> {
    let matrix = entry.numbers::<16>(POSE)?;
    let matrix = matrix.ok_or_else(|| entry.wrong(POSE, "a list of 16 numbers", "nothing"))?;
    let [upper @ .., l0, l1, l2, l3] = matrix;
    if !is_last_row_of_pose([l0, l1, l2, l3]) {
        let found = format!("{l0} {l1} {l2} {l3}");
        return Err(entry.wrong(POSE, "0 0 0 1 as the last row of a row-major matrix", &found));
    }
    let pose = WorldFromCamera::from_rows(&upper).map_err(SceneError::camera(path, entry.field(POSE)))?;
    Ok(pose.opencv_from_opengl().inverse())
}

fn intrinsics(entry: &Object<'_>, size: ImageSize, path: &Path) -> Result<NormalizedIntrinsics, SceneError> {
    const EXPECTED: &str = "a vertical field of view between 0 and 180 degrees";
    let degrees = entry.number("fov")?.ok_or_else(|| entry.wrong("fov", EXPECTED, "nothing"))?;
    let angle = degrees.to_radians();
    let is_possible = angle > 0.0 && angle < PI;
    if !is_possible {
        return Err(entry.wrong("fov", EXPECTED, &degrees.to_string()));
    }
    let fy = focal_of(angle, 1.0);
    let fx = fy * f64::from(size.height) / f64::from(size.width);
    NormalizedIntrinsics::new(fx, fy, 0.5, 0.5).map_err(SceneError::camera(path, entry.field("fov")))
}

/// Counts what the file says about its images and is not read.
fn report_unread(root: &Object<'_>, entries: &[Value], size: ImageSize, path: &Path, warnings: &mut Warnings) {
    let name = last_name(path);
    if root.value("crop").is_some() {
        warnings.push(WarningKind::UnreadField, name.clone(), "crop is not read: whole scenes are rendered");
    }
    let timed = |entry: &Value| {
        let time = entry.get("render_time").filter(|time| !time.is_null())?;
        Some(format!("render_time ({}) is not read; scenes do not change with time", shown(time)))
    };
    if let Some(detail) = count_and_first(entries, "cameras", timed) {
        warnings.push(WarningKind::UnreadField, name.clone(), detail);
    }
    let ratio = f64::from(size.width) / f64::from(size.height);
    let squeezed = |entry: &Value| {
        let aspect = entry.get("aspect")?.as_f64()?;
        let differs = (aspect / ratio - 1.0).abs() > SAME_ASPECT;
        differs.then(|| format!("aspect is {aspect}, but render_width and render_height are {size}, which are used"))
    };
    if let Some(detail) = count_and_first(entries, "cameras", squeezed) {
        warnings.push(WarningKind::UnexpectedSize, name, detail);
    }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;
    use glam::DVec3;
    use serde_json::json;

    use super::*;

    /// A camera at (1, 2, 3.5) that looks along +x of a world whose +z is up, so that its right is −y.
    fn file() -> Value {
        let matrix = json!([0, 0, -1, 1, -1, 0, 0, 2, 0, 1, 0, 3.5, 0, 0, 0, 1]);
        let camera = |fov: f64| json!({ "camera_to_world": matrix, "fov": fov, "aspect": 2.0 });
        json!({
            "keyframes": [], "camera_type": "perspective", "render_height": 300, "render_width": 600, "fps": 24,
            "seconds": 4, "is_cycle": false, "crop": null, "camera_path": [camera(90.0), camera(60.0)],
        })
    }

    fn read(value: &Value) -> (Result<Vec<FileCamera>, String>, Warnings) {
        assert!(is_camera_path(value));
        let mut warnings = Warnings::new();
        let cameras = camera_path(value, Path::new("a/orbit.json"), &mut warnings);
        (cameras.map_err(|error| error.to_string()), warnings)
    }

    #[test]
    fn poses_are_row_major_camera_to_world_with_opengl_axes() {
        let (cameras, warnings) = read(&file());
        let cameras = cameras.unwrap();
        assert_eq!((cameras.len(), warnings.total()), (2, 0));
        assert_eq!((cameras[1].number, cameras[1].name.as_str()), (1, "1"));
        let pose = cameras[1].camera.camera_from_world.inverse();
        Tolerance::F64.assert(pose.centre().to_array(), [1.0, 2.0, 3.5], "centre");
        Tolerance::F64.assert(pose.forward().to_array(), DVec3::X.to_array(), "forward is −z of OpenGL");
        Tolerance::F64.assert(pose.down().to_array(), [0.0, 0.0, -1.0], "down is −y of OpenGL");
        Tolerance::F64.assert(pose.right().to_array(), [0.0, -1.0, 0.0], "right");
    }

    /// Of 90°, half of the height is the focal length.
    #[test]
    fn the_field_of_view_is_the_vertical_one_of_each_camera() {
        let cameras = read(&file()).0.unwrap();
        let size = ImageSize { width: 600, height: 300 };
        let pixels = |at: usize| {
            let camera = &cameras[at];
            assert_eq!(camera.size, Some(size));
            let k = camera.camera.intrinsics.pixel_from_normalized(size);
            [k.fx, k.fy, k.cx, k.cy]
        };
        Tolerance::relative(1e-12).assert(pixels(0), [150.0, 150.0, 300.0, 150.0], "90°");
        let narrow = 150.0 * 3f64.sqrt();
        Tolerance::relative(1e-12).assert(pixels(1), [narrow, narrow, 300.0, 150.0], "60°");
    }

    #[test]
    fn other_cameras_and_broken_fields_are_errors_that_name_them() {
        let error = |change: &dyn Fn(&mut Value)| {
            let mut file = file();
            change(&mut file);
            read(&file).0.unwrap_err()
        };
        for (field, value, expected) in [
            ("camera_type", json!("fisheye"), "camera_type"),
            ("camera_type", json!("equirectangular"), "equirectangular"),
            ("camera_type", json!(2), "camera_type: expected text, found 2"),
            ("render_height", json!(null), "render_height: expected 1 to 65535 pixels, found nothing"),
            ("render_width", json!(0), "render_width: expected 1 to 65535 pixels, found 0"),
            ("camera_path", json!({}), "camera_path: expected a list, found an object"),
        ] {
            let error = error(&|file| file[field] = value.clone());
            assert!(error.contains(expected) && error.contains("orbit.json"), "{field}: {error}");
        }
        let transposed = json!([0, -1, 0, 0, 0, 0, 1, 0, -1, 0, 0, 0, 1, 2, 3.5, 1]);
        let mirrored = json!([0, 0, 1, 1, -1, 0, 0, 2, 0, 1, 0, 3, 0, 0, 0, 1]);
        for (field, value, expected) in [
            ("fov", json!(null), "camera_path[1].fov: expected a vertical field of view"),
            ("fov", json!(180), "between 0 and 180 degrees, found 180"),
            ("camera_to_world", json!([1, 2]), "camera_path[1].camera_to_world: expected a list of 16 numbers"),
            ("camera_to_world", transposed, "0 0 0 1 as the last row of a row-major matrix, found 1 2 3.5 1"),
            ("camera_to_world", mirrored, "camera_path[1].camera_to_world: rotation"),
        ] {
            let error = error(&|file| file["camera_path"][1][field] = value.clone());
            assert!(error.contains(expected) && error.contains("orbit.json"), "{field}: {error}");
        }
    }

    #[test]
    fn what_is_not_read_is_counted() {
        let mut file = file();
        file["crop"] = json!({ "crop_center": [0, 0, 0] });
        file["camera_path"][1]["render_time"] = json!(0.25);
        file["camera_path"][1]["aspect"] = json!(0.5);
        let (cameras, warnings) = read(&file);
        assert_eq!(cameras.unwrap().len(), 2);
        let counts = [WarningKind::UnreadField, WarningKind::UnexpectedSize].map(|kind| warnings.count(kind));
        assert_eq!((counts, warnings.total()), ([2, 1], 3));
        let details: Vec<&str> = warnings.kept().iter().map(|warning| warning.detail.as_str()).collect();
        assert!(details[0].starts_with("crop is not read"), "{details:?}");
        assert!(details[1].starts_with("1 of 2 cameras, first 1: render_time (0.25) is not read"), "{details:?}");
        assert!(details[2].starts_with("1 of 2 cameras, first 1: aspect is 0.5, but render_width"), "{details:?}");
        assert!(warnings.kept().iter().all(|warning| warning.scene == "orbit.json"));
    }
}
