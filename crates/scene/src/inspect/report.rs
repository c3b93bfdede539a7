use atsplat_camera::ImageSize;
use serde::Serialize;

use crate::{Warning, WarningKind};

/// What a dataset holds. [`std::fmt::Display`] prints it as a table, serde as JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Inspection {
    /// Name of the dataset's format.
    pub format: String,
    /// Scenes listed, read and not readable.
    pub scenes: SceneCounts,
    /// Frames in all scenes.
    pub frames: u64,
    /// Frames a scene.
    pub frames_per_scene: Summary,
    /// Where the frames' pictures are.
    pub pictures: PictureCounts,
    /// Sizes that picture headers say, most frequent first.
    pub sizes: Vec<SizeCount>,
    /// Sizes that the metadata states, most frequent first.
    pub stated_sizes: Vec<SizeCount>,
    /// Frames by lens model.
    pub lenses: LensCounts,
    /// Pinhole numbers of all frames.
    pub intrinsics: Intrinsics,
    /// How far and how fast cameras move.
    pub baselines: Baselines,
    /// What is wrong, by reason.
    pub problems: Vec<Problem>,
    /// One entry a scene, where asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub per_scene: Vec<SceneSummary>,
}

impl Inspection {
    /// Whether every scene that the dataset lists could be read.
    pub const fn is_complete(&self) -> bool {
        self.scenes.unreadable == 0
    }
}

/// How many scenes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SceneCounts {
    /// Keys that the dataset lists.
    pub listed: u64,
    /// Scenes read.
    pub read: u64,
    /// Scenes that could not be read.
    pub unreadable: u64,
}

/// How many frames, by where their picture is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct PictureCounts {
    /// In a file of their own.
    pub files: u64,
    /// Encoded in a chunk, or made when asked for.
    pub encoded: u64,
    /// Listed, but the file is not there.
    pub missing: u64,
    /// Nowhere: the trajectory came alone.
    pub absent: u64,
    /// Headers that were read for the picture's size.
    pub headers_read: u64,
    /// Headers that could not be read.
    pub headers_unreadable: u64,
}

/// How many pictures are of one size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SizeCount {
    /// Width and height in pixels.
    #[serde(flatten)]
    pub size: ImageSize,
    /// Frames of this size.
    pub frames: u64,
}

/// How many frames, by lens model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct LensCounts {
    /// Without distortion.
    pub pinhole: u64,
    /// OpenCV's radial and tangential model.
    pub opencv: u64,
    /// OpenCV's fisheye model.
    pub fisheye: u64,
}

/// Least, middle and greatest of a set of numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Summary {
    /// Finite numbers among them, which the others are taken over.
    pub count: u64,
    /// NaN and infinite ones.
    pub non_finite: u64,
    /// Least.
    pub min: Option<f64>,
    /// Middle; the mean of the two middle ones where their number is even.
    pub median: Option<f64>,
    /// Greatest.
    pub max: Option<f64>,
}

/// Pinhole numbers over all frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Intrinsics {
    /// Horizontal focal length over picture width.
    pub fx: Summary,
    /// Vertical focal length over picture height.
    pub fy: Summary,
    /// Principal point over picture width.
    pub cx: Summary,
    /// Principal point over picture height.
    pub cy: Summary,
    /// Horizontal opening angle in degrees, as pixelSplat's `get_fov` defines it.
    pub fov_x_degrees: Summary,
    /// Vertical opening angle in degrees.
    pub fov_y_degrees: Summary,
}

/// How far cameras move; lengths in scene units, which differ from scene to scene unless the dataset is
/// metric.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Baselines {
    /// Distance between consecutive frames' centres, over all such pairs.
    pub step: Summary,
    /// Angle between consecutive frames in degrees, over all such pairs.
    pub rotation_degrees: Summary,
    /// Median step of a scene, over scenes.
    pub scene_step: Summary,
    /// Median rotation per frame of a scene in degrees, over scenes.
    pub scene_rotation_degrees: Summary,
    /// Greatest distance of a camera from its scene's mean centre, over scenes: 3DGS's `cameras_extent`
    /// without its factor 1.1 (3DGS `scene/dataset_readers.py`, `getNerfppNorm`).
    pub extent: Summary,
    /// Sum of a scene's steps, over scenes.
    pub path_length: Summary,
}

/// What is wrong, for one reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Problem {
    /// The reason.
    pub kind: WarningKind,
    /// How often.
    pub count: u64,
    /// The first few, in the order of scenes.
    pub examples: Vec<Warning>,
}

/// One scene in short.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SceneSummary {
    /// Scene key.
    pub key: String,
    /// Frames.
    pub frames: u64,
    /// Frames whose picture is there, in a file or a chunk.
    pub pictures: u64,
    /// Median distance between consecutive frames' centres, in scene units; `None` below two frames.
    pub step: Option<f64>,
    /// Median angle between consecutive frames in degrees; `None` below two frames.
    pub rotation_degrees: Option<f64>,
    /// Greatest distance of a camera from the mean centre, in scene units; `None` without frames.
    pub extent: Option<f64>,
    /// Sum of the steps, in scene units.
    pub path_length: f64,
}
