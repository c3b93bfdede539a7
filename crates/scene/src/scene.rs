use std::path::PathBuf;

use atsplat_camera::{Camera, ImageSize};

use crate::SharedBytes;

/// Where a frame's picture is. Nothing is read or decoded until it is asked for.
#[derive(Clone, Debug)]
pub enum Picture {
    /// The trajectory came without pictures.
    Absent,
    /// A file that is listed but not there.
    Missing(PathBuf),
    /// A file.
    File(PathBuf),
    /// Encoded bytes inside a chunk, shared and not copied.
    Encoded(SharedBytes),
}

/// One posed picture of a scene.
///
/// A frame's position in [`Scene::frames`] is what every evaluation index counts in
/// (pixelSplat `src/dataset/dataset_re10k.py`): the order of lines in a trajectory or of `frames[]` in a
/// `transforms.json`, with missing pictures keeping their place.
#[derive(Clone, Debug)]
pub struct Frame {
    /// What the source calls the frame: a timestamp or a file stem.
    pub name: String,
    /// Microseconds since the start of the video, where the source has them.
    pub timestamp_micros: Option<i64>,
    /// Pose, intrinsics and lens.
    pub camera: Camera,
    /// Picture size that the metadata states; the file's own size wins where they differ.
    pub stated_size: Option<ImageSize>,
    /// Where the picture is.
    pub picture: Picture,
}

/// A posed capture: what a dataset holds under one key.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The dataset's name for the scene, as evaluation indices use it.
    pub key: String,
    /// Where the video or capture came from, if the source says so.
    pub url: Option<String>,
    /// Frames in the source's order.
    pub frames: Vec<Frame>,
}
