//! The cameras of 3DGS' `cameras.json`, field by field.

use atsplat_camera::{Camera, CameraError, ImageSize, PixelIntrinsics, WorldFromCamera};
use serde_json::{Map, Value};

use crate::camera_file::FileCamera;
use crate::json::shown;

/// A camera as written by 3DGS' `camera_to_JSON` (graphdeco-inria/gaussian-splatting `utils/camera_utils.py`): centre and
/// axes of the camera in the world, focal lengths in pixels, the principal point in the middle. gaussian-splatting-lightning and
/// others also state the principal point in pixels, as `cx` and `cy`. `number` is its place in the file.
///
/// # Errors
/// The camera and the field, what was expected and found.
pub(crate) fn trained_camera(number: usize, entry: &Value) -> Result<FileCamera, String> {
    let Value::Object(fields) = entry else {
        return Err(format!("camera {number}: expected an object, found {}", shown(entry)));
    };
    let fields = Fields { number, fields };
    let size = ImageSize { width: fields.side("width")?, height: fields.side("height")? };
    let (focal, centre) = ([fields.number("fx")?, fields.number("fy")?], fields.principal_point(size)?);
    let [x, y, z] = fields.vector("position", fields.fields.get("position"))?;
    let [r0, r1, r2] = fields.rotation()?;
    let rows = [r0[0], r0[1], r0[2], x, r1[0], r1[1], r1[2], y, r2[0], r2[1], r2[2], z];
    let camera = camera(focal, centre, size, &rows).map_err(|error| format!("camera {number}: {error}"))?;
    let name = fields.text("img_name")?;
    Ok(FileCamera { number, name, camera, size: Some(size), exposure: None, timestamp_micros: None })
}

fn camera(
    [fx, fy]: [f64; 2],
    [cx, cy]: [f64; 2],
    size: ImageSize,
    world_from_camera: &[f64; 12],
) -> Result<Camera, CameraError> {
    let intrinsics = PixelIntrinsics::new(fx, fy, cx, cy)?.normalized_from_pixel(size)?;
    Ok(Camera::pinhole(WorldFromCamera::from_rows(world_from_camera)?.inverse(), intrinsics))
}

/// The fields of one camera.
struct Fields<'a> {
    number: usize,
    fields: &'a Map<String, Value>,
}

impl Fields<'_> {
    fn side(&self, name: &str) -> Result<u32, String> {
        let value = self.fields.get(name);
        let side = value.and_then(Value::as_u64).and_then(|side| u32::try_from(side).ok());
        let expected = format!("1 to {} pixels", ImageSize::MAX_SIDE);
        side.filter(|side| (1..=ImageSize::MAX_SIDE).contains(side)).ok_or_else(|| self.wrong(name, &expected, value))
    }

    fn number(&self, name: &str) -> Result<f64, String> {
        let value = self.fields.get(name);
        value.and_then(Value::as_f64).ok_or_else(|| self.wrong(name, "a number", value))
    }

    /// The stated principal point, or the middle of the image.
    fn principal_point(&self, size: ImageSize) -> Result<[f64; 2], String> {
        let is_stated = |name: &str| self.fields.get(name).is_some_and(|value| !value.is_null());
        match ["cx", "cy"].map(is_stated) {
            [false, false] => Ok([size.width, size.height].map(|side| 0.5 * f64::from(side))),
            [true, true] => Ok([self.number("cx")?, self.number("cy")?]),
            [true, false] => Err(self.wrong("cy", "a number, as for cx", self.fields.get("cy"))),
            [false, true] => Err(self.wrong("cx", "a number, as for cy", self.fields.get("cx"))),
        }
    }

    fn text(&self, name: &str) -> Result<String, String> {
        let value = self.fields.get(name);
        value.and_then(Value::as_str).map(str::to_owned).ok_or_else(|| self.wrong(name, "text", value))
    }

    fn rotation(&self) -> Result<[[f64; 3]; 3], String> {
        let value = self.fields.get("rotation");
        let Some([first, second, third]) = value.and_then(Value::as_array).map(Vec::as_slice) else {
            return Err(self.wrong("rotation", "3 rows of 3 numbers", value));
        };
        let row = |at: usize, row| self.vector(&format!("rotation[{at}]"), Some(row));
        Ok([row(0, first)?, row(1, second)?, row(2, third)?])
    }

    fn vector(&self, name: &str, value: Option<&Value>) -> Result<[f64; 3], String> {
        let items = value.and_then(Value::as_array).map(Vec::as_slice);
        let Some([x, y, z]) = items else { return Err(self.wrong(name, "a list of 3 numbers", value)) };
        let number = |item: &Value| item.as_f64().ok_or_else(|| self.wrong(name, "numbers", Some(item)));
        Ok([number(x)?, number(y)?, number(z)?])
    }

    fn wrong(&self, field: &str, expected: &str, found: Option<&Value>) -> String {
        let found = found.map_or_else(|| "nothing".to_owned(), shown);
        format!("camera {}, {field}: expected {expected}, found {found}", self.number)
    }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;
    use glam::DVec3;
    use serde_json::json;

    use super::*;

    fn entry() -> Value {
        json!({
            "id": 7, "img_name": "b", "width": 40, "height": 30, "fx": 30.5, "fy": 31, "position": [1, 2, 3.5],
            "rotation": [[0, 1, 0], [0, 0, 1], [1, 0, 0]],
        })
    }

    #[test]
    fn centre_and_axes_are_those_in_the_world() {
        let read = trained_camera(4, &entry()).unwrap();
        assert_eq!((read.number, read.name.as_str(), read.size), (4, "b", Some(ImageSize { width: 40, height: 30 })));
        let pose = read.camera.camera_from_world.inverse();
        Tolerance::F64.assert(pose.centre().to_array(), [1.0, 2.0, 3.5], "centre");
        Tolerance::F64.assert(pose.transform_vector(DVec3::X).to_array(), [0.0, 0.0, 1.0], "axis");
        let k = read.camera.intrinsics.pixel_from_normalized(ImageSize { width: 40, height: 30 });
        Tolerance::F64.assert([k.fx, k.fy, k.cx, k.cy], [30.5, 31.0, 20.0, 15.0], "intrinsics");
    }

    #[test]
    fn a_stated_principal_point_is_read() {
        let centre = |cx: Value, cy: Value| {
            let mut entry = entry();
            (entry["cx"], entry["cy"]) = (cx, cy);
            let k = trained_camera(3, &entry)?.camera.intrinsics;
            let k = k.pixel_from_normalized(ImageSize { width: 40, height: 30 });
            Ok::<_, String>([k.cx, k.cy])
        };
        Tolerance::F64.assert(centre(json!(12.5), json!(21)).unwrap(), [12.5, 21.0], "of 40×30 pixels");
        Tolerance::F64.assert(centre(json!(null), json!(null)).unwrap(), [20.0, 15.0], "the middle");
        for (cx, cy, expected) in [
            (json!(12.5), json!(null), "camera 3, cy: expected a number, as for cx, found null"),
            (json!(null), json!(21), "camera 3, cx: expected a number, as for cy, found null"),
            (json!(12.5), json!("21"), "camera 3, cy: expected a number, found \"21\""),
        ] {
            assert_eq!(centre(cx, cy).unwrap_err(), expected);
        }
    }

    #[test]
    fn messages_name_the_camera_and_the_field() {
        let message = |field: &str, value: Value| {
            let mut entry = entry();
            entry[field] = value;
            trained_camera(1, &entry).unwrap_err()
        };
        for (field, value, expected) in [
            ("fx", json!("30"), "camera 1, fx: expected a number, found \"30\""),
            ("width", json!(40.5), "camera 1, width: expected 1 to 65535 pixels, found 40.5"),
            ("width", json!(1_000_000_000), "camera 1, width: expected 1 to 65535 pixels, found 1000000000"),
            ("height", json!(-1), "camera 1, height: expected 1 to 65535 pixels, found -1"),
            ("height", json!(0), "camera 1, height: expected 1 to 65535 pixels, found 0"),
            ("img_name", json!(null), "camera 1, img_name: expected text, found null"),
            ("position", json!([1, 2]), "camera 1, position: expected a list of 3 numbers, found a list of 2"),
            ("rotation", json!([[1, 0, 0]]), "camera 1, rotation: expected 3 rows of 3 numbers, found a list of 1"),
            (
                "rotation",
                json!([[1, 0, 0], [0, "1", 0], [0, 0, 1]]),
                "camera 1, rotation[1]: expected numbers, found \"1\"",
            ),
            ("fy", json!(0), "camera 1: fy: expected a positive number, found 0"),
        ] {
            assert_eq!(message(field, value), expected);
        }
        let mut without = entry();
        without.as_object_mut().unwrap().remove("fy");
        assert_eq!(trained_camera(2, &without).unwrap_err(), "camera 2, fy: expected a number, found nothing");
        assert_eq!(trained_camera(2, &json!([1])).unwrap_err(), "camera 2: expected an object, found a list of 1");
    }
}
