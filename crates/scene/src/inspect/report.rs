use atsplat_camera::ImageSize;
use serde::Serialize;

use crate::{Format, Warning, WarningKind};

/// Statistics of a dataset; [`std::fmt::Display`] formats them as a table, serde as JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Inspection {
    /// The dataset's format.
    pub format: Format,
    /// Scenes listed, read, unreadable and left out.
    pub scenes: SceneCounts,
    /// Frames of all scenes.
    pub frames: u64,
    /// Frames per scene.
    pub frames_per_scene: Summary,
    /// Where the frames' images are.
    pub images: ImageCounts,
    /// Sizes according to image headers, most frequent first.
    pub sizes: Vec<SizeCount>,
    /// Sizes according to the metadata, most frequent first.
    pub stated_sizes: Vec<SizeCount>,
    /// Frames by lens model.
    pub lenses: LensCounts,
    /// Intrinsics of all frames.
    pub intrinsics: Intrinsics,
    /// Camera motion.
    pub baselines: Baselines,
    /// Problems by kind.
    pub problems: Vec<Problem>,
    /// How many of the [`WarningKind::DuplicateTimestamp`] are about numbers of images, which cameras of a rig share, in chunks of
    /// captures.
    #[serde(skip)]
    pub repeated_numbers: u64,
    /// How many of the scenes with a [`WarningKind::RepeatedPose`] have all cameras in one place, of at least three.
    #[serde(skip)]
    pub scenes_in_one_place: u64,
    /// One entry per scene, if requested.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub per_scene: Vec<SceneSummary>,
}

impl Inspection {
    /// Whether every scene is listed and was read, all frames have a usable pose and plausible intrinsics, no scene has all cameras in
    /// one place, no row of a trajectory seems to be lost or repeated, and no image was found missing, empty, cut short, unreadable or
    /// unfit for its camera.
    pub fn is_complete(&self) -> bool {
        let SceneCounts { unreadable, left_out, .. } = self.scenes;
        let ImageCounts { missing, empty, unposed, headers_unreadable, cut_short, unfit, .. } = self.images;
        let all_scenes = unreadable == 0 && left_out == 0 && self.scenes_in_one_place == 0;
        let all_images =
            [missing, empty, unposed, headers_unreadable, cut_short, unfit].iter().all(|count| *count == 0);
        all_scenes && all_images && !self.problems.iter().any(|problem| self.has_lost_rows(problem))
    }

    /// Whether such a problem means that rows are lost or not what they should be, although every listed scene was read.
    fn has_lost_rows(&self, problem: &Problem) -> bool {
        match problem.kind {
            WarningKind::ImplausibleIntrinsics => true,
            WarningKind::UnlistedImage => !self.format.is_of_captures(),
            WarningKind::DuplicateTimestamp => !self.format.is_of_captures() && problem.count > self.repeated_numbers,
            _ => false,
        }
    }
}

/// Numbers of scenes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SceneCounts {
    /// Keys in the dataset.
    pub listed: u64,
    /// Scenes read.
    pub read: u64,
    /// Scenes that could not be read.
    pub unreadable: u64,
    /// Scenes that are not listed ([`left_out`](super::left_out)).
    pub left_out: u64,
}

/// Numbers of frames, by where their image is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ImageCounts {
    /// In a separate file that is not empty.
    pub files: u64,
    /// Encoded in a chunk, or generated on demand.
    pub encoded: u64,
    /// Listed, but the file is missing.
    pub missing: u64,
    /// Listed, but the file is empty.
    pub empty: u64,
    /// Not looked at, because the frame has no usable pose.
    pub unposed: u64,
    /// Without an image: the source has only the trajectory.
    pub absent: u64,
    /// Headers read for the image's size.
    pub headers_read: u64,
    /// Headers that could not be read.
    pub headers_unreadable: u64,
    /// Images whose header was read, but whose end is missing.
    pub cut_short: u64,
    /// Images whose size does not fit their camera, so that a run skips them ([`ImageMismatch::is_fatal`](crate::ImageMismatch::is_fatal)).
    pub unfit: u64,
}

/// Number of images of one size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SizeCount {
    /// Width and height in pixels.
    #[serde(flatten)]
    pub size: ImageSize,
    /// Frames of this size.
    pub frames: u64,
}

/// Numbers of frames, by lens model.
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

/// Minimum, median and maximum of a set of numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Summary {
    /// Finite numbers; the statistics are over these.
    pub count: u64,
    /// NaN and infinite numbers.
    pub non_finite: u64,
    /// Minimum.
    pub min: Option<f64>,
    /// Median; the mean of the two middle numbers if `count` is even.
    pub median: Option<f64>,
    /// Maximum.
    pub max: Option<f64>,
}

/// Intrinsics over all frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Intrinsics {
    /// Horizontal focal length over image width.
    pub fx: Summary,
    /// Vertical focal length over image height.
    pub fy: Summary,
    /// Principal point over image width.
    pub cx: Summary,
    /// Principal point over image height.
    pub cy: Summary,
    /// Horizontal field of view in degrees, as pixelSplat's `get_fov` defines it.
    pub fov_x_degrees: Summary,
    /// Vertical field of view in degrees.
    pub fov_y_degrees: Summary,
}

/// Camera motion; lengths in scene units, which differ between scenes unless the dataset is metric.
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
    /// Largest distance of a camera from its scene's mean centre, over scenes: 3DGS's `cameras_extent`
    /// without its factor 1.1 (3DGS `scene/dataset_readers.py`, `getNerfppNorm`).
    pub extent: Summary,
    /// Sum of a scene's steps, over scenes.
    pub path_length: Summary,
}

/// All problems of one kind.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Problem {
    /// The kind.
    pub kind: WarningKind,
    /// Number of problems.
    pub count: u64,
    /// The first few, in the order of scenes.
    pub examples: Vec<Warning>,
}

/// Statistics of one scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SceneSummary {
    /// Scene key.
    pub key: String,
    /// Number of frames.
    pub frames: u64,
    /// Number of frames with an image, in a file or a chunk.
    pub images: u64,
    /// Median distance between consecutive frames' centres, in scene units; `None` below two frames.
    pub step: Option<f64>,
    /// Median angle between consecutive frames in degrees; `None` below two frames.
    pub rotation_degrees: Option<f64>,
    /// Largest distance of a camera from the mean centre, in scene units; `None` without frames.
    pub extent: Option<f64>,
    /// Sum of the distances between consecutive frames, in scene units.
    pub path_length: f64,
}
