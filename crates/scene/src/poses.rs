//! Camera poses as a JSON list of matrices: the trajectories of MotionCtrl and its successors.
//!
//! Each is the row-major world-to-camera matrix `[R | t]` with OpenCV axes: 12 numbers (TencentARC/MotionCtrl
//! `examples/camera_poses/*.json`, `gradio_utils/camera_utils.py`: `reshape(-1, 3, 4)`, relative poses as `Eᵢ · E₀⁻¹`,
//! "Zoom In" along −z), here also 16, or three or four rows of four. The file has no intrinsics.

use std::path::Path;

use atsplat_camera::CameraFromWorld;
use atsplat_numeric::Tolerance;
use serde_json::Value;

use crate::SceneError;

/// Whether a value is a list that starts with something shaped like a camera matrix.
pub fn is_list_of_poses(value: &Value) -> bool {
    let is_matrix = |entry: &Value| match entry.as_array() {
        Some(rows) if rows.iter().all(Value::is_number) => matches!(rows.len(), 12 | 16),
        Some(rows) => matches!(rows.len(), 3 | 4) && rows.iter().all(is_row),
        None => false,
    };
    value.as_array().and_then(|entries| entries.first()).is_some_and(is_matrix)
}

/// Whether the last row of a 4×4 matrix is that of a pose: 0 0 0 1 up to the rounding of f32, which programs that invert matrices
/// in it, such as Blender, leave there.
pub(crate) fn is_last_row_of_pose(row: [f64; 4]) -> bool {
    row.into_iter()
        .zip([0.0, 0.0, 0.0, 1.0])
        .all(|(found, expected)| Tolerance::F32_ROUND_TRIP.accepts(found, expected))
}

fn is_row(row: &Value) -> bool {
    row.as_array().is_some_and(|numbers| numbers.len() == 4 && numbers.iter().all(Value::is_number))
}

/// The poses of a list for which [`is_list_of_poses`] holds; `path` is for messages only.
///
/// # Errors
/// [`SceneError::Malformed`] with matrix and number, [`SceneError::Camera`] for a matrix that is not a pose.
pub fn poses(list: &[Value], path: &Path) -> Result<Vec<CameraFromWorld>, SceneError> {
    list.iter().enumerate().map(|(at, entry)| pose(entry, at, path)).collect()
}

fn pose(entry: &Value, at: usize, path: &Path) -> Result<CameraFromWorld, SceneError> {
    let wrong = |field: &str, expected: &str, found: String| {
        SceneError::malformed("list of camera matrices", path, format!("matrix {at}{field}"), expected, found)
    };
    let mut numbers = Vec::with_capacity(16);
    let rows = entry.as_array().map(Vec::as_slice).unwrap_or_default();
    let flat = rows.iter().flat_map(|row| row.as_array().map_or(std::slice::from_ref(row), Vec::as_slice));
    for (position, number) in flat.enumerate() {
        let number =
            number.as_f64().ok_or_else(|| wrong(&format!(", number {position}"), "a number", number.to_string()));
        numbers.push(number?);
    }
    let is_shaped = rows.iter().all(Value::is_number) || rows.iter().all(is_row);
    let (upper, last) = match (numbers.as_slice().split_first_chunk::<12>(), is_shaped) {
        (Some((upper, last)), true) if matches!(last.len(), 0 | 4) => (upper, last),
        _ => return Err(wrong("", "12 or 16 numbers, or 3 or 4 rows of 4", format!("{} numbers", numbers.len()))),
    };
    if last.first_chunk().is_some_and(|row| !is_last_row_of_pose(*row)) {
        return Err(wrong(", last row", "0 0 0 1", format!("{last:?}")));
    }
    CameraFromWorld::from_rows(upper).map_err(SceneError::camera(path, format!("matrix {at}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use serde_json::json;

    fn read(list: &Value) -> Result<Vec<CameraFromWorld>, SceneError> {
        assert!(is_list_of_poses(list));
        poses(list.as_array().unwrap(), Path::new("poses.json"))
    }

    /// A world-to-camera matrix, rotated by 90° about y and translated, in every notation.
    #[test]
    fn every_notation_is_world_to_camera() {
        let rows = [[0, 0, -1, 1], [0, 1, 0, 2], [1, 0, 0, 3], [0, 0, 0, 1]];
        let flat = rows.as_flattened();
        for matrix in [json!(flat[..12]), json!(flat), json!(rows[..3]), json!(rows)] {
            let poses = read(&json!([matrix, matrix])).unwrap();
            assert_eq!(poses.len(), 2);
            assert_eq!(poses[1].translation(), DVec3::new(1.0, 2.0, 3.0));
            assert_eq!(poses[1].inverse().centre(), DVec3::new(-3.0, -2.0, 1.0), "not the translation");
            assert_eq!(poses[1].inverse().forward(), DVec3::X, "the third row is the forward direction");
        }
    }

    /// MotionCtrl's "Zoom In": the file's translation is along −z, so the camera moves forward.
    #[test]
    fn zooming_in_moves_forward() {
        let step = |z: f64| json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, z]);
        let poses = read(&json!([step(-0.2), step(-0.2875)])).unwrap();
        let [first, second] = [0, 1].map(|at: usize| poses[at].inverse().centre().z);
        assert!(second > first && first > 0.0);
    }

    #[test]
    fn the_last_row_may_be_rounded() {
        let is_last = |[a, b, c, d]: [f64; 4]| [is_last_row_of_pose([a, b, c, d]), is_last_row_of_pose([d, c, b, a])];
        assert_eq!(is_last([0.0, -0.0, 3e-8, 0.999_999_94]), [true, false]);
        assert_eq!(is_last([0.0, 0.0, 0.0, 1.000_01]), [false; 2]);
        for beyond in [1e-5, -1e-5, f64::NAN, f64::INFINITY] {
            assert_eq!(is_last([beyond, 0.0, 0.0, 1.0]), [false; 2], "{beyond}");
        }
    }

    #[test]
    fn errors_name_matrix_and_number() {
        let good = json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]);
        for (bad, expected) in [
            (json!([1, 0, 0]), "matrix 1: expected 12 or 16 numbers"),
            (json!({}), "matrix 1: expected 12 or 16 numbers"),
            (json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, "x", 0]), "matrix 1, number 10: expected a number, found \"x\""),
            (json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 2, 0]), "matrix 1: rotation"),
            (json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 2]), "matrix 1, last row: expected 0 0 0 1"),
            (json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1e-4, 0, 0, 1]), "matrix 1, last row: expected 0 0 0 1"),
            (json!([[1, 0, 0, 0, 0, 1], [0, 0, 0, 0, 1, 0]]), "matrix 1: expected 12 or 16 numbers"),
        ] {
            let error = read(&json!([good, bad])).unwrap_err().to_string();
            assert!(error.contains(expected) && error.contains("poses.json"), "{error}\ndoes not contain {expected}");
        }
    }

    #[test]
    fn other_json_is_not_a_list_of_poses() {
        for other in
            [json!([]), json!([1, 2]), json!([[1, 2, 3]]), json!([{ "a": 1 }]), json!({}), json!([[[1, 0, 0, 0]]])]
        {
            assert!(!is_list_of_poses(&other), "{other}");
        }
    }
}
