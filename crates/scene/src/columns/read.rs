use std::path::PathBuf;

use arrow_array::cast::AsArray;
use arrow_array::types::{ArrowPrimitiveType, Float64Type, Int64Type, UInt32Type, UInt64Type};
use arrow_array::{Array, ArrayRef, PrimitiveArray, RecordBatch, StringArray};
use arrow_schema::DataType;
use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};

use atsplat_files::shortened;

use super::schema::{INTRINSICS, LENS, POSE};
use super::{ColumnsError, SCHEMA_VERSION};
use crate::Picture;

/// One row of a camera table.
#[derive(Clone, Debug)]
pub struct CameraRow {
    /// Scene key.
    pub scene: String,
    /// Source of the capture.
    pub url: Option<String>,
    /// Position in the scene, from 0.
    pub frame: u64,
    /// The frame's name in the source.
    pub name: String,
    /// Microseconds since the start of the video.
    pub timestamp_micros: Option<i64>,
    /// Pose, intrinsics and lens, bit for bit as written.
    pub camera: Camera,
    /// Picture size in pixels according to the metadata.
    pub stated_size: Option<ImageSize>,
    /// Where the picture is; `None` for one that was encoded in a chunk or generated, which a table does not hold.
    pub picture: Option<Picture>,
}

/// The rows of a batch of [`super::schema()`]. Columns are found by name, additional ones are ignored, and text may have
/// any of Arrow's three string types (polars writes views).
///
/// # Errors
/// [`ColumnsError`] for another schema version, a column that is missing or of another type, a null in a required cell,
/// or an invalid camera.
pub fn rows_from_batch(batch: &RecordBatch) -> Result<Vec<CameraRow>, ColumnsError> {
    if let Some(version) = batch.schema_ref().metadata().get("atsplat.version")
        && version != SCHEMA_VERSION
    {
        return Err(ColumnsError::Version { expected: SCHEMA_VERSION, found: version.clone() });
    }
    let columns = Columns::find(batch)?;
    (0..batch.num_rows()).map(|row| columns.row(row)).collect()
}

struct Columns<'a> {
    scene: Text<'a>,
    url: Text<'a>,
    frame: Numbers<'a, UInt64Type>,
    name: Text<'a>,
    timestamp_micros: Numbers<'a, Int64Type>,
    intrinsics: [Numbers<'a, Float64Type>; INTRINSICS.len()],
    distortion: Text<'a>,
    lens: [Numbers<'a, Float64Type>; LENS.len()],
    pose: [Numbers<'a, Float64Type>; POSE.len()],
    stated_width: Numbers<'a, UInt32Type>,
    stated_height: Numbers<'a, UInt32Type>,
    picture: Text<'a>,
    picture_path: Text<'a>,
}

impl<'a> Columns<'a> {
    fn find(batch: &'a RecordBatch) -> Result<Self, ColumnsError> {
        Ok(Self {
            scene: Text::find(batch, "scene")?,
            url: Text::find(batch, "url")?,
            frame: Numbers::find(batch, "frame", "UInt64")?,
            name: Text::find(batch, "name")?,
            timestamp_micros: Numbers::find(batch, "timestamp_micros", "Int64")?,
            intrinsics: floats(batch, INTRINSICS)?,
            distortion: Text::find(batch, "distortion")?,
            lens: floats(batch, LENS)?,
            pose: floats(batch, POSE)?,
            stated_width: Numbers::find(batch, "stated_width", "UInt32")?,
            stated_height: Numbers::find(batch, "stated_height", "UInt32")?,
            picture: Text::find(batch, "picture")?,
            picture_path: Text::find(batch, "picture_path")?,
        })
    }

    fn row(&self, row: usize) -> Result<CameraRow, ColumnsError> {
        let stated_size = match (self.stated_width.get(row), self.stated_height.get(row)) {
            (None, None) => None,
            (Some(width), Some(height)) if width > 0 && height > 0 => Some(ImageSize { width, height }),
            (width, height) => {
                let side = |side: Option<u32>| side.map_or_else(|| "null".to_owned(), |side| side.to_string());
                return Err(ColumnsError::UnknownValue {
                    column: "stated_width",
                    row,
                    expected: "width and height of at least one pixel, or null for both",
                    found: format!("{}×{}", side(width), side(height)),
                });
            }
        };
        Ok(CameraRow {
            scene: self.scene.required(row)?.to_owned(),
            url: self.url.get(row).map(str::to_owned),
            frame: self.frame.required(row)?,
            name: self.name.required(row)?.to_owned(),
            timestamp_micros: self.timestamp_micros.get(row),
            camera: self.camera(row)?,
            stated_size,
            picture: self.picture(row)?,
        })
    }

    fn camera(&self, row: usize) -> Result<Camera, ColumnsError> {
        let invalid = |source| ColumnsError::Camera { row, source };
        let [fx, fy, cx, cy] = required(&self.intrinsics, row)?;
        Ok(Camera {
            camera_from_world: CameraFromWorld::from_rows(&required(&self.pose, row)?).map_err(invalid)?,
            intrinsics: NormalizedIntrinsics::new(fx, fy, cx, cy).map_err(invalid)?,
            distortion: self.lens(row)?,
        })
    }

    fn lens(&self, row: usize) -> Result<Distortion, ColumnsError> {
        let [k1, k2, k3, k4, p1, p2] = &self.lens;
        match self.distortion.required(row)? {
            "none" => Ok(Distortion::None),
            "opencv" => {
                let [k1, k2, k3, p1, p2] = required_of([k1, k2, k3, p1, p2], row)?;
                Ok(Distortion::OpenCv { k1, k2, k3, p1, p2 })
            }
            "fisheye" => Ok(Distortion::Fisheye { k: required_of([k1, k2, k3, k4], row)? }),
            found => Err(ColumnsError::UnknownValue {
                column: "distortion",
                row,
                expected: "none, opencv or fisheye",
                found: shortened(found, 40),
            }),
        }
    }

    fn picture(&self, row: usize) -> Result<Option<Picture>, ColumnsError> {
        let path = || self.picture_path.required(row).map(PathBuf::from);
        match self.picture.required(row)? {
            "absent" => Ok(Some(Picture::Absent)),
            "missing" => Ok(Some(Picture::Missing(path()?))),
            "file" => Ok(Some(Picture::File(path()?))),
            "encoded" | "generated" | "made" => Ok(None),
            found => Err(ColumnsError::UnknownValue {
                column: "picture",
                row,
                expected: "absent, missing, file, encoded or generated",
                found: shortened(found, 40),
            }),
        }
    }
}

fn column<'a>(batch: &'a RecordBatch, name: &'static str) -> Result<&'a ArrayRef, ColumnsError> {
    batch.column_by_name(name).ok_or(ColumnsError::MissingColumn { column: name })
}

/// A column of numbers.
struct Numbers<'a, T: ArrowPrimitiveType> {
    name: &'static str,
    values: &'a PrimitiveArray<T>,
}

// Derived, these would require Arrow's marker types to be `Copy`.
impl<T: ArrowPrimitiveType> Copy for Numbers<'_, T> {}
impl<T: ArrowPrimitiveType> Clone for Numbers<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<'a, T: ArrowPrimitiveType> Numbers<'a, T> {
    fn find(batch: &'a RecordBatch, name: &'static str, expected: &'static str) -> Result<Self, ColumnsError> {
        let array = column(batch, name)?;
        let values = array.as_primitive_opt::<T>().ok_or_else(|| ColumnsError::WrongType {
            column: name,
            expected,
            found: array.data_type().clone(),
        })?;
        Ok(Self { name, values })
    }

    fn get(&self, row: usize) -> Option<T::Native> {
        (row < self.values.len() && self.values.is_valid(row)).then(|| self.values.value(row))
    }

    fn required(&self, row: usize) -> Result<T::Native, ColumnsError> {
        self.get(row).ok_or(ColumnsError::Null { column: self.name, row })
    }
}

fn floats<'a, const N: usize>(
    batch: &'a RecordBatch,
    names: [&'static str; N],
) -> Result<[Numbers<'a, Float64Type>; N], ColumnsError> {
    // Every table has this column; it only fills the array until each entry is replaced.
    let mut found = [Numbers::find(batch, "fx", "Float64")?; N];
    for (slot, name) in found.iter_mut().zip(names) {
        *slot = Numbers::find(batch, name, "Float64")?;
    }
    Ok(found)
}

fn required<const N: usize>(columns: &[Numbers<'_, Float64Type>; N], row: usize) -> Result<[f64; N], ColumnsError> {
    required_of(columns.each_ref(), row)
}

fn required_of<const N: usize>(columns: [&Numbers<'_, Float64Type>; N], row: usize) -> Result<[f64; N], ColumnsError> {
    let mut values = [0.0; N];
    for (value, column) in values.iter_mut().zip(columns) {
        *value = column.required(row)?;
    }
    Ok(values)
}

/// A column of text, in any of Arrow's string layouts.
struct Text<'a> {
    name: &'static str,
    values: TextArray<'a>,
}

enum TextArray<'a> {
    Short(&'a StringArray),
    Long(&'a arrow_array::LargeStringArray),
    View(&'a arrow_array::StringViewArray),
}

impl<'a> Text<'a> {
    fn find(batch: &'a RecordBatch, name: &'static str) -> Result<Self, ColumnsError> {
        let array = column(batch, name)?;
        let values = match array.data_type() {
            DataType::Utf8 => array.as_string_opt().map(TextArray::Short),
            DataType::LargeUtf8 => array.as_string_opt().map(TextArray::Long),
            DataType::Utf8View => array.as_string_view_opt().map(TextArray::View),
            _ => None,
        };
        let values = values.ok_or_else(|| ColumnsError::WrongType {
            column: name,
            expected: "Utf8, LargeUtf8 or Utf8View",
            found: array.data_type().clone(),
        })?;
        Ok(Self { name, values })
    }

    fn get(&self, row: usize) -> Option<&'a str> {
        macro_rules! cell {
            ($array:expr) => {
                (row < $array.len() && $array.is_valid(row)).then(|| $array.value(row))
            };
        }
        match self.values {
            TextArray::Short(array) => cell!(array),
            TextArray::Long(array) => cell!(array),
            TextArray::View(array) => cell!(array),
        }
    }

    fn required(&self, row: usize) -> Result<&'a str, ColumnsError> {
        self.get(row).ok_or(ColumnsError::Null { column: self.name, row })
    }
}
