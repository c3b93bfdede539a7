use std::path::Path;

use atsplat_camera::{CameraError, WorldFromCamera};
use atsplat_files::without_byte_order_mark;
use serde_json::{Map, Value};

use super::LensFields;
use super::unread_fields::{require_one_pose, require_opengl_axes, stated_split, unread_fields, unread_test_frames};
use crate::SceneError;
use crate::json::shown;
use crate::poses::is_last_row_of_pose;

/// What errors call the format: a file may have any name, which they state too.
pub(super) const FORMAT: &str = "nerfstudio cameras";

/// A parsed `transforms.json`.
#[derive(Clone, Debug, PartialEq)]
pub struct Transforms {
    /// Intrinsics of every frame that states none.
    pub lens: LensFields,
    /// Frames in the file's order, which DL3DV's evaluation indices refer to (DL3DV issue #16; depthsplat
    /// `src/scripts/convert_dl3dv_test.py`).
    pub frames: Vec<ListedFrame>,
    /// Row-major 3×4 transform that nerfstudio applied to the world of structure from motion before it wrote the poses.
    /// The feed-forward papers do not undo it, and neither does this loader: any relative or mean-pose normalisation
    /// removes it.
    pub applied_transform: Option<[f64; 12]>,
    /// Factor that nerfstudio applied to the world's lengths; not undone.
    pub applied_scale: Option<f64>,
    /// Global fields that are not read, although they are about images or intrinsics.
    pub unread_fields: Vec<&'static str>,
    /// Number of entries of `test_frames` (`ScanNet++`) that are not among the frames: they are not read.
    pub test_frames: usize,
    /// Names of the lists of the file's split (nerfstudio's `train_filenames`, `val_filenames`, `test_filenames`) and their numbers of
    /// images, without empty ones: the split is not used.
    pub split: Vec<(&'static str, usize)>,
}

/// One entry of `frames`.
#[derive(Clone, Debug, PartialEq)]
pub struct ListedFrame {
    /// The image's path in the file.
    pub file_path: String,
    /// Pose with OpenCV camera axes, converted from the file's OpenGL axes; its world is unchanged. An error if it is not finite
    /// or not a rotation.
    ///
    /// NoPoSplat, TokenGS and Long-LRM also permute the world's axes (NoPoSplat
    /// `src/scripts/convert_dl3dv.py:65-71`), a rotation that their pose normalisation removes again.
    pub world_from_camera: Result<WorldFromCamera, CameraError>,
    /// Intrinsics that this frame states itself.
    pub lens: LensFields,
    /// Fields that are not read, although they are about its image or intrinsics, such as `mask_path`.
    pub unread_fields: Vec<&'static str>,
}

/// Parses a `transforms.json`; `path` is for messages only.
///
/// Poses are camera-to-world, 4×4 or 3×4, OpenGL axes (+x right, +y up, +z back; nerfstudio
/// `docs/quickstart/data_conventions.md`). Other fields are ignored; those about images and intrinsics are listed in the result.
/// Numbers that are not finite (`NaN`, as Python writes them, or null) are accepted in poses and in ignored fields.
///
/// # Errors
/// [`SceneError::Malformed`] with line and column for invalid JSON and repeated keys, with the field (`frames[3].fl_x`)
/// for a wrong value, and for instant-ngp's scenes of Mitsuba and pairs of poses, whose cameras are other ones;
/// [`SceneError::UnsupportedCameraModel`].
pub fn parse_transforms(text: &[u8], path: &Path) -> Result<Transforms, SceneError> {
    let text = without_byte_order_mark(text);
    match crate::json::parse(text) {
        Ok(value) => read(&value, path),
        Err(error) => read_with_non_finite(text, path).ok_or_else(|| {
            let location = format!("line {} column {}", error.line(), error.column());
            let (expected, found) = crate::json::problem(text, &error, "JSON");
            SceneError::malformed(FORMAT, path, location, expected, found)
        }),
    }
}

/// A file that is not JSON because of numbers that are not finite, but has them only where that is accepted.
fn read_with_non_finite(text: &[u8], path: &Path) -> Option<Transforms> {
    let value = crate::json::parse(&crate::json::with_non_finite_as_text(text)?).ok()?;
    read(&value, path).ok()
}

fn read(value: &Value, path: &Path) -> Result<Transforms, SceneError> {
    let root = Object::new(value, String::new(), path)?;
    require_opengl_axes(&root)?;
    let listed = root.array("frames")?.ok_or_else(|| {
        let found = format!("nothing: the file seems to be {}", crate::json::describe(value));
        root.wrong("frames", "a list of frames", &found)
    })?;
    if listed.is_empty() {
        return Err(root.wrong("frames", "at least one frame", "an empty list"));
    }
    let lens = LensFields::read(&root)?;
    let frames = listed.iter().enumerate().map(|(at, frame)| read_frame(frame, at, path));
    let frames: Vec<ListedFrame> = frames.collect::<Result<_, _>>()?;
    Ok(Transforms {
        lens,
        test_frames: unread_test_frames(&root, &frames),
        frames,
        applied_transform: root.value("applied_transform").map(|_| root.matrix("applied_transform")).transpose()?,
        applied_scale: root.number("applied_scale")?,
        unread_fields: unread_fields(&root),
        split: stated_split(&root),
    })
}

fn read_frame(frame: &Value, at: usize, path: &Path) -> Result<ListedFrame, SceneError> {
    let frame = Object::new(frame, format!("frames[{at}]"), path)?;
    let file_path = frame.text("file_path")?.ok_or_else(|| frame.wrong("file_path", "an image's path", "nothing"))?;
    require_one_pose(&frame)?;
    let pose = WorldFromCamera::from_rows(&frame.matrix("transform_matrix")?);
    Ok(ListedFrame {
        file_path: file_path.to_owned(),
        world_from_camera: pose.map(|pose| pose.opencv_from_opengl()),
        lens: LensFields::read(&frame)?,
        unread_fields: unread_fields(&frame),
    })
}

/// A JSON object with its location in the file, for messages.
#[derive(Clone, Debug)]
pub(super) struct Object<'a> {
    fields: &'a Map<String, Value>,
    location: String,
    path: &'a Path,
}

impl<'a> Object<'a> {
    pub(super) fn new(value: &'a Value, location: String, path: &'a Path) -> Result<Self, SceneError> {
        match value {
            Value::Object(fields) => Ok(Self { fields, location, path }),
            other => {
                let location = if location.is_empty() { "top level".to_owned() } else { location };
                Err(SceneError::malformed(FORMAT, path, location, "an object", shown(other)))
            }
        }
    }

    /// The field's value; `None` if it is absent or null.
    pub(super) fn value(&self, name: &str) -> Option<&'a Value> {
        self.fields.get(name).filter(|value| !value.is_null())
    }

    pub(super) fn number(&self, name: &str) -> Result<Option<f64>, SceneError> {
        self.value(name)
            .map(|value| value.as_f64().ok_or_else(|| self.wrong(name, "a number", &shown(value))))
            .transpose()
    }

    pub(super) fn text(&self, name: &str) -> Result<Option<&'a str>, SceneError> {
        self.value(name).map(|value| value.as_str().ok_or_else(|| self.wrong(name, "text", &shown(value)))).transpose()
    }

    pub(super) fn flag(&self, name: &str) -> Result<bool, SceneError> {
        let flag = |value: &Value| value.as_bool().ok_or_else(|| self.wrong(name, "true or false", &shown(value)));
        self.value(name).map_or(Ok(false), flag)
    }

    pub(super) fn array(&self, name: &str) -> Result<Option<&'a Vec<Value>>, SceneError> {
        self.value(name)
            .map(|value| value.as_array().ok_or_else(|| self.wrong(name, "a list", &shown(value))))
            .transpose()
    }

    /// A list of `N` numbers.
    pub(super) fn numbers<const N: usize>(&self, name: &str) -> Result<Option<[f64; N]>, SceneError> {
        let Some(list) = self.array(name)? else { return Ok(None) };
        let numbers: Vec<f64> = list.iter().filter_map(Value::as_f64).collect();
        <[f64; N]>::try_from(numbers).ok().filter(|_| list.len() == N).map(Some).ok_or_else(|| {
            let other = list.iter().find(|item| !item.is_number());
            let found = other.map_or_else(|| format!("a list of {}", list.len()), shown);
            self.wrong(name, &format!("a list of {N} numbers"), &found)
        })
    }

    /// The upper 3×4 part of a 3×4 or 4×4 matrix; a fourth row must be 0 0 0 1 up to rounding. With one that is not finite, all of
    /// it is NaN.
    fn matrix(&self, name: &str) -> Result<[f64; 12], SceneError> {
        let rows = self.array(name)?.ok_or_else(|| self.wrong(name, "a 4×4 or 3×4 matrix", "nothing"))?;
        if !matches!(rows.len(), 3 | 4) {
            return Err(self.wrong(name, "3 or 4 rows", &rows.len().to_string()));
        }
        let mut numbers = [0.0; 16];
        for (at, row) in rows.iter().enumerate() {
            let row_name = format!("{name}[{at}]");
            let entries = row.as_array().filter(|row| row.len() == 4);
            let entries = entries.ok_or_else(|| self.wrong(&row_name, "a row of 4 numbers", &shown(row)))?;
            for (column, (slot, entry)) in numbers.iter_mut().skip(4 * at).zip(entries).enumerate() {
                let number = crate::json::number_of_python(entry);
                *slot =
                    number.ok_or_else(|| self.wrong(&format!("{row_name}[{column}]"), "a number", &shown(entry)))?;
            }
        }
        let [upper @ .., l0, l1, l2, l3] = numbers;
        if rows.len() == 4 && !is_last_row_of_pose([l0, l1, l2, l3]) {
            if ![l0, l1, l2, l3].iter().all(|entry| entry.is_finite()) {
                return Ok([f64::NAN; 12]);
            }
            let found = format!("{l0} {l1} {l2} {l3}");
            return Err(self.wrong(&format!("{name}[3]"), "the row 0 0 0 1", &found));
        }
        Ok(upper)
    }

    /// The full path of one of this object's fields.
    pub(super) fn field(&self, name: &str) -> String {
        if self.location.is_empty() { name.to_owned() } else { format!("{}.{name}", self.location) }
    }

    pub(super) fn wrong(&self, name: &str, expected: &str, found: &str) -> SceneError {
        SceneError::malformed(FORMAT, self.path, self.field(name), expected, found)
    }

    pub(super) fn unsupported(&self, name: &str, model: &str, reason: &str) -> SceneError {
        SceneError::unsupported_model(self.path, self.field(name), model, reason)
    }
}

#[cfg(test)]
mod tests;
