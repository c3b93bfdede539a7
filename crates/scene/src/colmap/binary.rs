//! `cameras.bin`, `images.bin`, `points3D.bin`: little endian, counts before lists.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use atsplat_camera::ImageSize;
use atsplat_files::quoted;
use glam::DVec3;

use super::{
    ColmapCamera, ColmapCameraModel, ColmapImage, ColmapPoint, by_id, length_of, malformed, pose_or_reason,
    require_new_id,
};
use crate::SceneError;

/// `u32 id, i32 model, u64 width, u64 height, f64 parameters[]` each.
pub(super) fn cameras(bytes: &[u8], path: &Path) -> Result<BTreeMap<u32, ColmapCamera>, SceneError> {
    let mut reader = Reader::new(bytes, path);
    let count = reader.count("cameras", 24)?;
    let mut camera = |_| {
        let location = reader.location("camera");
        let id = u32::from_le_bytes(reader.array("camera_id")?);
        let number = i32::from_le_bytes(reader.array("model_id")?);
        let model = ColmapCameraModel::from_number(number).ok_or_else(|| {
            let reason = "COLMAP has no model with this number";
            SceneError::unsupported_model(path, &location, number.to_string(), reason)
        })?;
        let size = ImageSize { width: reader.length("width")?, height: reader.length("height")? };
        let parameters = (0..model.parameter_count()).map(|_| reader.number("params")).collect::<Result<_, _>>()?;
        Ok((id, ColmapCamera { model, size, parameters }, location))
    };
    let cameras: Vec<_> = (0..count).map(&mut camera).collect::<Result<_, SceneError>>()?;
    reader.finish()?;
    by_id(cameras.into_iter().map(Ok), path)
}

/// `u32 id, f64 qw qx qy qz tx ty tz, u32 camera, name NUL, u64 n, n × (f64 x, f64 y, u64 point)` each.
pub(super) fn images(bytes: &[u8], path: &Path) -> Result<Vec<ColmapImage>, SceneError> {
    let mut reader = Reader::new(bytes, path);
    let count = reader.count("images", 73)?;
    let mut images = Vec::with_capacity(count);
    let mut ids = BTreeSet::new();
    for _ in 0..count {
        let location = reader.location("image");
        let id = u32::from_le_bytes(reader.array("image_id")?);
        require_new_id(&mut ids, id, &location, path)?;
        let quaternion = [reader.number("qw")?, reader.number("qx")?, reader.number("qy")?, reader.number("qz")?];
        let translation = [reader.number("tx")?, reader.number("ty")?, reader.number("tz")?];
        let camera_id = u32::from_le_bytes(reader.array("camera_id")?);
        let name = reader.name()?;
        let keypoints = reader.count("points2D", 24)?;
        // `count` has checked that this many bytes are left.
        reader.take(keypoints.saturating_mul(24), "points2D")?;
        let camera_from_world = pose_or_reason(quaternion, translation, path, [location.clone(), location]);
        let quaternion_length = length_of(quaternion);
        images.push(ColmapImage { id, name, camera_id, camera_from_world, quaternion_length });
    }
    reader.finish()?;
    Ok(images)
}

/// `u64 id, f64 x y z, u8 r g b, f64 error, u64 n, n × (u32 image, u32 keypoint)` each.
pub(super) fn points(bytes: &[u8], path: &Path) -> Result<Vec<ColmapPoint>, SceneError> {
    let mut reader = Reader::new(bytes, path);
    let count = reader.count("points3D", 51)?;
    let mut points = Vec::with_capacity(count);
    for _ in 0..count {
        let id = u64::from_le_bytes(reader.array("point3D_id")?);
        let location = reader.location("xyz");
        let position = DVec3::new(reader.number("x")?, reader.number("y")?, reader.number("z")?);
        if !position.is_finite() {
            return Err(malformed(path, location, "finite coordinates", position.to_string()));
        }
        let color = reader.array("rgb")?;
        let error = reader.number("error")?;
        let observations = reader.count("track", 8)?;
        // `count` has checked that this many bytes are left.
        reader.take(observations.saturating_mul(8), "track")?;
        points.push(ColmapPoint { id, position, color, error });
    }
    reader.finish()?;
    Ok(points)
}

/// Reads fields from the front of a file and tracks the byte offset for messages.
struct Reader<'a> {
    bytes: &'a [u8],
    rest: &'a [u8],
    path: &'a Path,
}

impl<'a> Reader<'a> {
    const fn new(bytes: &'a [u8], path: &'a Path) -> Self {
        Self { bytes, rest: bytes, path }
    }

    fn location(&self, field: &str) -> String {
        format!("byte {}, {field}", self.bytes.len() - self.rest.len())
    }

    fn wrong(&self, field: &str, expected: impl Into<String>, found: impl Into<String>) -> SceneError {
        malformed(self.path, self.location(field), expected, found)
    }

    fn take(&mut self, length: usize, field: &str) -> Result<&'a [u8], SceneError> {
        let Some((taken, rest)) = self.rest.split_at_checked(length) else {
            return Err(self.wrong(field, format!("{length} bytes"), format!("{} until the end", self.rest.len())));
        };
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, field: &str) -> Result<[u8; N], SceneError> {
        let Some((taken, rest)) = self.rest.split_first_chunk() else {
            return Err(self.wrong(field, format!("{N} bytes"), format!("{} until the end", self.rest.len())));
        };
        self.rest = rest;
        Ok(*taken)
    }

    fn number(&mut self, field: &str) -> Result<f64, SceneError> {
        self.array(field).map(f64::from_le_bytes)
    }

    /// A count of items of at least `smallest` bytes each. A count that exceeds the rest of the file is an error before
    /// anything is allocated.
    fn count(&mut self, items: &str, smallest: usize) -> Result<usize, SceneError> {
        let count = u64::from_le_bytes(self.array(items)?);
        let room = self.rest.len() / smallest;
        match usize::try_from(count) {
            Ok(count) if count <= room => Ok(count),
            _ => Err(self.wrong(items, format!("at most {room}, which the file has room for"), count.to_string())),
        }
    }

    fn length(&mut self, field: &str) -> Result<u32, SceneError> {
        let length = u64::from_le_bytes(self.array(field)?);
        match u32::try_from(length) {
            Ok(length) if length > 0 => Ok(length),
            _ => Err(self.wrong(field, "a length from 1 to 2³² − 1", length.to_string())),
        }
    }

    fn name(&mut self) -> Result<String, SceneError> {
        let end = self.rest.iter().position(|byte| *byte == 0);
        let end = end.ok_or_else(|| self.wrong("name", "a string that ends with a zero byte", "no zero byte"))?;
        let name = self.take(end, "name")?;
        self.take(1, "name")?;
        let text = std::str::from_utf8(name).ok().filter(|text| !text.is_empty());
        text.map(str::to_owned).ok_or_else(|| self.wrong("name", "a UTF-8 name", quoted(name)))
    }

    fn finish(&self) -> Result<(), SceneError> {
        match self.rest.len() {
            0 => Ok(()),
            extra => Err(self.wrong("end", "nothing after the last item", format!("{extra} bytes"))),
        }
    }
}
