//! COLMAP's sparse models, text and binary: cameras, posed images, points.

mod binary;
mod both_encodings;
mod camera;
mod displacement;
mod open;
mod order;
mod source;
mod text;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use atsplat_camera::CameraFromWorld;
use glam::{DMat3, DQuat, DVec3};

use crate::SceneError;
use crate::files::read_file;

pub use camera::{ColmapCamera, ColmapCameraModel};
pub use displacement::{Displacement, displacement};
pub use source::{ColmapOptions, ColmapScenes, MODEL_FOLDERS, points_folder};

pub(crate) use open::{READER, folder_of_part};
pub(crate) use source::{model_below, model_folders_in_words, model_in, part_of_model};

const FORMAT: &str = "COLMAP model";

/// The names of a model's files, without extension.
const PARTS: [&str; 3] = ["cameras", "images", "points3D"];

/// The encoding of a COLMAP model's files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// `.txt`.
    Text,
    /// `.bin`, little endian.
    Binary,
}

impl Encoding {
    fn file(self, folder: &Path, name: &str) -> PathBuf {
        let extension = match self {
            Self::Text => "txt",
            Self::Binary => "bin",
        };
        folder.join(format!("{name}.{extension}"))
    }

    /// Whether a folder has cameras and images in this encoding.
    fn is_whole(self, folder: &Path) -> bool {
        ["cameras", "images"].iter().all(|name| self.file(folder, name).is_file())
    }
}

/// One registered image.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapImage {
    /// COLMAP's id of the image, which tracks refer to.
    pub id: u32,
    /// Path relative to the folder of images.
    pub name: String,
    /// Id of the camera that took it.
    pub camera_id: u32,
    /// World-to-camera transform with OpenCV axes; the quaternion is normalised as COLMAP does. Of an image without a usable pose,
    /// what was expected and found, and where.
    pub camera_from_world: Result<CameraFromWorld, String>,
    /// Length of the quaternion in the file, which COLMAP writes as 1.
    pub quaternion_length: f64,
}

/// One triangulated point.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapPoint {
    /// COLMAP's id of the point.
    pub id: u64,
    /// Position in the world, in the model's units.
    pub position: DVec3,
    /// Mean colour of its observations, sRGB.
    pub color: [u8; 3],
    /// Mean reprojection error in pixels; −1 if COLMAP has not computed it.
    pub error: f64,
}

/// Parses `cameras.txt` or `cameras.bin`; `path` is for messages only.
///
/// # Errors
/// [`SceneError::Malformed`] with line or byte, also for a repeated id and for another number of cameras than the header
/// states; [`SceneError::UnsupportedCameraModel`] for a model unknown to COLMAP.
pub fn parse_cameras(bytes: &[u8], encoding: Encoding, path: &Path) -> Result<BTreeMap<u32, ColmapCamera>, SceneError> {
    match encoding {
        Encoding::Text => text::cameras(bytes, path),
        Encoding::Binary => binary::cameras(bytes, path),
    }
}

/// Parses `images.txt` or `images.bin`, in the file's order; `path` is for messages only. Keypoints are
/// skipped.
///
/// # Errors
/// [`SceneError::Malformed`] with line or byte, also for a repeated id and for another number of images than the header
/// states.
pub fn parse_images(bytes: &[u8], encoding: Encoding, path: &Path) -> Result<Vec<ColmapImage>, SceneError> {
    match encoding {
        Encoding::Text => text::images(bytes, path),
        Encoding::Binary => binary::images(bytes, path),
    }
}

/// Parses `points3D.txt` or `points3D.bin`, in the file's order; `path` is for messages only.
///
/// # Errors
/// [`SceneError::Malformed`] with line or byte, also for coordinates that are not finite and for another number of points
/// than the header states.
pub fn parse_points(bytes: &[u8], encoding: Encoding, path: &Path) -> Result<Vec<ColmapPoint>, SceneError> {
    match encoding {
        Encoding::Text => text::points(bytes, path),
        Encoding::Binary => binary::points(bytes, path),
    }
}

/// Reads the points of the model in `folder`, which can initialise Gaussians.
///
/// # Errors
/// [`SceneError::Io`] if there is neither `points3D.bin` nor `points3D.txt`, and those of [`parse_points`].
pub fn read_points(folder: &Path) -> Result<Vec<ColmapPoint>, SceneError> {
    let (file, encoding) = model_file(folder, "points3D");
    parse_points(&read_file("reading COLMAP points", &file)?, encoding, &file)
}

/// The encoding of the model in a folder: binary if it is there in both, which COLMAP prefers too. Cameras in one encoding
/// and images in the other do not form a model: they may stem from two reconstructions.
fn encoding_of(folder: &Path) -> Option<Encoding> {
    [Encoding::Binary, Encoding::Text].into_iter().find(|encoding| encoding.is_whole(folder))
}

/// One of the model's files. Points may be in the other encoding, if they are in that alone.
fn model_file(folder: &Path, name: &str) -> (PathBuf, Encoding) {
    let [main, other] = match encoding_of(folder) {
        Some(Encoding::Text) => [Encoding::Text, Encoding::Binary],
        Some(Encoding::Binary) | None => [Encoding::Binary, Encoding::Text],
    };
    let is_only_in_other = other.file(folder, name).is_file() && !main.file(folder, name).is_file();
    let encoding = if is_only_in_other { other } else { main };
    (encoding.file(folder, name), encoding)
}

/// A pose from COLMAP's quaternion (w, x, y, z) and translation; `None` if the quaternion is zero or not finite.
fn pose_from(
    quaternion: [f64; 4],
    translation: [f64; 3],
) -> Option<Result<CameraFromWorld, atsplat_camera::CameraError>> {
    let [w, x, y, z] = quaternion;
    // Scaled first, so that squaring neither underflows nor overflows.
    let largest =
        quaternion.iter().fold(0.0f64, |largest, entry| if entry.abs() > largest { entry.abs() } else { largest });
    if !quaternion.iter().all(|entry| entry.is_finite()) || largest == 0.0 {
        return None;
    }
    let scaled = DQuat::from_xyzw(x / largest, y / largest, z / largest, w / largest);
    Some(CameraFromWorld::new(DMat3::from_quat(scaled.normalize()), DVec3::from_array(translation)))
}

/// [`pose_from`], or why it is unusable, with the places of its parts.
fn pose_or_reason(
    quaternion: [f64; 4],
    translation: [f64; 3],
    path: &Path,
    [of_quaternion, of_translation]: [String; 2],
) -> Result<CameraFromWorld, String> {
    let pose = pose_from(quaternion, translation).ok_or_else(|| {
        malformed(path, of_quaternion, "a quaternion of finite length above 0", format!("{quaternion:?}"))
    });
    let pose = pose.and_then(|pose| pose.map_err(SceneError::camera(path, of_translation)));
    pose.map_err(|error| error.to_string())
}

/// Length of a quaternion, without overflow on the way.
fn length_of([w, x, y, z]: [f64; 4]) -> f64 {
    w.hypot(x).hypot(y).hypot(z)
}

/// An error for an image's id that is among the earlier ones.
fn require_new_id(ids: &mut BTreeSet<u32>, id: u32, location: &str, path: &Path) -> Result<(), SceneError> {
    if ids.insert(id) {
        return Ok(());
    }
    Err(malformed(path, location, "a unique image id", format!("{id} a second time")))
}

/// Collects cameras by id; a repeated id is an error.
fn by_id(
    cameras: impl Iterator<Item = Result<(u32, ColmapCamera, String), SceneError>>,
    path: &Path,
) -> Result<BTreeMap<u32, ColmapCamera>, SceneError> {
    let mut table = BTreeMap::new();
    for camera in cameras {
        let (id, camera, location) = camera?;
        if table.insert(id, camera).is_some() {
            return Err(malformed(path, location, "a unique camera id", format!("{id} a second time")));
        }
    }
    Ok(table)
}

fn malformed(
    path: &Path,
    location: impl Into<String>,
    expected: impl Into<String>,
    found: impl Into<String>,
) -> SceneError {
    SceneError::malformed(FORMAT, path, location, expected, found)
}

#[cfg(test)]
mod tests;
