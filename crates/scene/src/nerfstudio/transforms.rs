use std::path::Path;

use atsplat_camera::WorldFromCamera;
use serde_json::{Map, Value};

use super::LensFields;
use crate::SceneError;

const FORMAT: &str = "transforms.json";

/// A `transforms.json`, before its pictures are looked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Transforms {
    /// Intrinsics that hold for every frame that does not state its own.
    pub lens: LensFields,
    /// Frames in the order listed, which is the order that DL3DV's evaluation indices count in (DL3DV
    /// issue #16; depthsplat `src/scripts/convert_dl3dv_test.py`).
    pub frames: Vec<ListedFrame>,
    /// Row-major 3×4 transform that nerfstudio applied to the world of its structure from motion before
    /// it wrote the poses. The feed-forward papers do not undo it, and neither does a loader here
    /// unless asked to: any relative or mean-pose normalisation removes it.
    pub applied_transform: Option<[f64; 12]>,
    /// Factor that nerfstudio applied to the world's lengths; kept, not undone.
    pub applied_scale: Option<f64>,
}

/// One entry of `frames`.
#[derive(Clone, Debug, PartialEq)]
pub struct ListedFrame {
    /// The picture's path as written.
    pub file_path: String,
    /// Pose with OpenCV camera axes: the file's OpenGL axes are converted, its world is kept.
    ///
    /// NoPoSplat, TokenGS and Long-LRM also permute the world's axes (NoPoSplat
    /// `src/scripts/convert_dl3dv.py:65-71`), a rotation that their pose normalisation removes again.
    pub world_from_camera: WorldFromCamera,
    /// Intrinsics of this frame alone; empty where the global ones hold.
    pub lens: LensFields,
}

/// Parses a `transforms.json`; `path` is for messages only.
///
/// Poses are camera-to-world, 4×4 or 3×4, OpenGL axes (+x right, +y up, +z back; nerfstudio
/// `docs/quickstart/data_conventions.md`). Fields that the toolkit has no use for are ignored.
///
/// # Errors
/// [`SceneError::Malformed`] with line and column for broken JSON and repeated keys, with the field (`frames[3].fl_x`) for
/// a wrong value; [`SceneError::Camera`] for a pose that is no rotation or not finite;
/// [`SceneError::UnsupportedCameraModel`].
pub fn parse_transforms(text: &[u8], path: &Path) -> Result<Transforms, SceneError> {
    let value = crate::json::parse(text).map_err(|error| SceneError::Malformed {
        format: FORMAT,
        path: path.to_owned(),
        location: format!("line {} column {}", error.line(), error.column()),
        expected: "JSON with each key of an object once".to_owned(),
        found: error.to_string(),
    })?;
    let root = Object::new(&value, String::new(), path)?;
    let listed = root.array("frames")?.ok_or_else(|| {
        let found = format!("nothing: the file seems to be {}", crate::json::describe(&value));
        root.wrong("frames", "a list of frames", &found)
    })?;
    if listed.is_empty() {
        return Err(root.wrong("frames", "at least one frame", "an empty list"));
    }
    let frames = listed.iter().enumerate();
    Ok(Transforms {
        lens: LensFields::read(&root)?,
        frames: frames.map(|(at, frame)| read_frame(frame, at, path)).collect::<Result<_, _>>()?,
        applied_transform: root.value("applied_transform").map(|_| root.matrix("applied_transform")).transpose()?,
        applied_scale: root.number("applied_scale")?,
    })
}

fn read_frame(frame: &Value, at: usize, path: &Path) -> Result<ListedFrame, SceneError> {
    let frame = Object::new(frame, format!("frames[{at}]"), path)?;
    let file_path = frame.text("file_path")?.ok_or_else(|| frame.wrong("file_path", "a picture's path", "nothing"))?;
    let rows = frame.matrix("transform_matrix")?;
    let pose = WorldFromCamera::from_rows(&rows).map_err(|source| SceneError::Camera {
        path: path.to_owned(),
        location: frame.field("transform_matrix"),
        source,
    })?;
    Ok(ListedFrame {
        file_path: file_path.to_owned(),
        world_from_camera: pose.opencv_from_opengl(),
        lens: LensFields::read(&frame)?,
    })
}

/// A JSON object that knows where it stands, so that each complaint can say so.
#[derive(Clone, Debug)]
pub(super) struct Object<'a> {
    fields: &'a Map<String, Value>,
    location: String,
    path: &'a Path,
}

impl<'a> Object<'a> {
    fn new(value: &'a Value, location: String, path: &'a Path) -> Result<Self, SceneError> {
        match value {
            Value::Object(fields) => Ok(Self { fields, location, path }),
            other => Err(SceneError::Malformed {
                format: FORMAT,
                path: path.to_owned(),
                location: if location.is_empty() { "top level".to_owned() } else { location },
                expected: "an object".to_owned(),
                found: shown(other),
            }),
        }
    }

    /// The field's value; `None` where it is absent or null.
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

    fn array(&self, name: &str) -> Result<Option<&'a Vec<Value>>, SceneError> {
        self.value(name)
            .map(|value| value.as_array().ok_or_else(|| self.wrong(name, "a list", &shown(value))))
            .transpose()
    }

    /// The upper 3×4 part of a 3×4 or 4×4 matrix, whose fourth row must be 0 0 0 1.
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
                let number = entry.as_f64();
                *slot =
                    number.ok_or_else(|| self.wrong(&format!("{row_name}[{column}]"), "a number", &shown(entry)))?;
            }
        }
        let [upper @ .., l0, l1, l2, l3] = numbers;
        let homogeneous = [l0, l1, l2, l3 - 1.0].iter().all(|entry| *entry == 0.0);
        if rows.len() == 4 && !homogeneous {
            let found = format!("{l0} {l1} {l2} {l3}");
            return Err(self.wrong(&format!("{name}[3]"), "the row 0 0 0 1", &found));
        }
        Ok(upper)
    }

    /// The full name of one of this object's fields.
    pub(super) fn field(&self, name: &str) -> String {
        if self.location.is_empty() { name.to_owned() } else { format!("{}.{name}", self.location) }
    }

    pub(super) fn wrong(&self, name: &str, expected: &str, found: &str) -> SceneError {
        SceneError::Malformed {
            format: FORMAT,
            path: self.path.to_owned(),
            location: self.field(name),
            expected: expected.to_owned(),
            found: found.to_owned(),
        }
    }

    pub(super) fn unsupported(&self, name: &str, model: &str, reason: &str) -> SceneError {
        SceneError::UnsupportedCameraModel {
            location: self.field(name),
            model: model.to_owned(),
            reason: reason.to_owned(),
            path: self.path.to_owned(),
        }
    }
}

/// A value as an error message shows it: what it is, and its text where that is short.
fn shown(value: &Value) -> String {
    match value {
        Value::Array(items) => format!("a list of {}", items.len()),
        Value::Object(_) => "an object".to_owned(),
        Value::String(text) if text.chars().count() > 40 => {
            format!("{:?}…", text.chars().take(40).collect::<String>())
        }
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests;
