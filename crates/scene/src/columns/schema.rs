use std::sync::{Arc, LazyLock};

use arrow_schema::{DataType, Field, Schema, SchemaRef};

/// Version of the schema; incremented when a column changes its meaning.
pub const SCHEMA_VERSION: &str = "2";

/// The convention of poses and intrinsics, stored in the schema's metadata under `atsplat.convention`.
pub const CONVENTION: &str = "One row per frame, in the source's order. r00..r22 and t0..t2 are the row-major 3x4 \
world-to-camera matrix [R|t] with OpenCV camera axes (+x right, +y down, +z forward), the rotation as stored, not \
re-orthonormalised. fx, fy, cx, cy are intrinsics in units of the image's width and height. Lens coefficients are \
OpenCV's, on the z = 1 plane. Lengths are scene units.";

/// The columns of a camera table.
///
/// | column | type | meaning |
/// |---|---|---|
/// | `scene` | Utf8 | scene key |
/// | `url` | Utf8? | source of the capture |
/// | `frame` | `UInt64` | position in the scene, from 0, as in evaluation indices |
/// | `name` | Utf8 | the frame's name in the source: a timestamp or a file stem |
/// | `timestamp_micros` | `Int64`? | [`crate::Frame::timestamp_micros`]; null in files of [`crate::export`] if it is no time |
/// | `fx` `fy` | `Float64` | focal lengths over image width and height |
/// | `cx` `cy` | `Float64` | principal point over image width and height |
/// | `distortion` | Utf8 | `none`, `opencv` or `fisheye` |
/// | `k1` `k2` `k3` `k4` `p1` `p2` | `Float64`? | lens coefficients; null if the model does not have them |
/// | `r00` … `r22` | `Float64` | rotation of the world-to-camera transform, row by row; NaN for `unposed` frames |
/// | `t0` `t1` `t2` | `Float64` | its translation, in scene units; NaN like the rotation |
/// | `centre_x` `centre_y` `centre_z` | `Float64` | camera centre in the world; derived from the pose |
/// | `stated_width` `stated_height` | `UInt32`? | image size in pixels according to the metadata |
/// | `image` | Utf8 | `absent`, `missing`, `file`, `encoded`, `generated`, or `unposed` if the pose is unusable |
/// | `image_path` | Utf8? | the file, found or missing, also if `unposed`; null if several may be it; bytes beyond UTF-8 become U+FFFD |
/// | `image_bytes` | `UInt64`? | length of an image encoded in a chunk |
pub fn schema() -> SchemaRef {
    static SCHEMA: LazyLock<SchemaRef> = LazyLock::new(|| Arc::new(build()));
    Arc::clone(&SCHEMA)
}

/// Pinhole columns, in the order of [`atsplat_camera::NormalizedIntrinsics`].
pub(super) const INTRINSICS: [&str; 4] = ["fx", "fy", "cx", "cy"];

/// Lens columns.
pub(super) const LENS: [&str; 6] = ["k1", "k2", "k3", "k4", "p1", "p2"];

/// Pose columns in the order of `CameraFromWorld::to_rows`, `[R | t]` row by row. The table's order
/// differs: rotation first, then translation.
pub(super) const POSE: [&str; 12] = ["r00", "r01", "r02", "t0", "r10", "r11", "r12", "t1", "r20", "r21", "r22", "t2"];

const ROTATION: [&str; 9] = ["r00", "r01", "r02", "r10", "r11", "r12", "r20", "r21", "r22"];
const TRANSLATION: [&str; 3] = ["t0", "t1", "t2"];

/// Camera centre columns.
pub(super) const CENTRE: [&str; 3] = ["centre_x", "centre_y", "centre_z"];

/// What files of [`crate::export`] have: a table has [`crate::Frame::timestamp_micros`] of any source.
const TIMESTAMP: &str =
    "microseconds since the start of the video; null for captures, whose images may be numbered, but not by time";

fn build() -> Schema {
    let mut fields = vec![
        field("scene", DataType::Utf8, false, "scene key"),
        field("url", DataType::Utf8, true, "where the capture came from"),
        field("frame", DataType::UInt64, false, "position in the scene, from 0"),
        field("name", DataType::Utf8, false, "the source's name of the frame"),
        field("timestamp_micros", DataType::Int64, true, TIMESTAMP),
    ];
    fields.extend(floats(&INTRINSICS, false, "pinhole intrinsics over image width (x) or height (y)"));
    fields.push(field("distortion", DataType::Utf8, false, "none, opencv or fisheye"));
    fields.extend(floats(&LENS, true, "lens coefficient of OpenCV's model"));
    fields.extend(floats(&ROTATION, false, "world-to-camera rotation, row and column"));
    fields.extend(floats(&TRANSLATION, false, "world-to-camera translation, scene units"));
    fields.extend(floats(&CENTRE, false, "camera centre in the world, scene units"));
    fields.extend([
        field("stated_width", DataType::UInt32, true, "image width in pixels that the metadata states"),
        field("stated_height", DataType::UInt32, true, "image height in pixels that the metadata states"),
        field("image", DataType::Utf8, false, "absent, missing, file, encoded, generated, or unposed: no usable pose"),
        field("image_path", DataType::Utf8, true, "image file, found or missing"),
        field("image_bytes", DataType::UInt64, true, "length of an image encoded in a chunk"),
    ]);
    Schema::new_with_metadata(fields, metadata())
}

/// The schema's metadata, for formats with key-value metadata.
pub(crate) fn metadata() -> [(String, String); 3] {
    [("table", "cameras"), ("version", SCHEMA_VERSION), ("convention", CONVENTION)]
        .map(|(key, value)| (format!("atsplat.{key}"), value.to_owned()))
}

fn field(name: &str, data_type: DataType, nullable: bool, description: &str) -> Field {
    Field::new(name, data_type, nullable).with_metadata([("description", description)])
}

fn floats(names: &[&str], nullable: bool, description: &str) -> impl Iterator<Item = Field> {
    names.iter().map(move |name| field(name, DataType::Float64, nullable, description))
}
