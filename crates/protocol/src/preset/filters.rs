use atsplat_camera::{ImageSize, WorldFromCamera};
use atsplat_numeric::Tolerance;
use atsplat_scene::{Frame, Scene};
use serde::{Deserialize, Serialize};

use crate::IndexEntry;

/// Which scenes the published loaders silently drop. The exact image size that they require is
/// [`atsplat_scene::preprocess::Preprocessing::expected_size`]. pixelSplat's loader also drops scenes with grey images and images with
/// alpha, whose shape is another; here they are decoded as RGB (with a warning of the dropped alpha). The published datasets have none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Filters {
    /// A scene is dropped if the field of view of *any* of its frames, by `get_fov`, exceeds this in x or y (pixelSplat
    /// `src/dataset/dataset_re10k.py`; 100 everywhere).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_fov_degrees: Option<f64>,
    /// An entry is dropped if the determinant of a context or target rotation is NaN or not `allclose` to 1
    /// (depthsplat `src/dataset/dataset_dl3dv.py:211-279`).
    #[serde(default)]
    pub determinant: bool,
    /// An entry is dropped if a coordinate of a context or target camera centre is *above* this; large
    /// negative coordinates pass (same place, `> 1e3`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_translation: Option<f64>,
    /// An entry is dropped if its first and last context centres are closer than this, in scene units
    /// (`baseline_epsilon` in pixelSplat, `baseline_min` in NoPoSplat).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_baseline: Option<f64>,
    /// An entry is dropped if these centres are farther apart than this (NoPoSplat's `baseline_max`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_baseline: Option<f64>,
}

/// Why the published loaders drop a scene or an entry of an index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum DropReason {
    /// The dataset does not contain the scene.
    SceneMissing,
    /// The scene's files cannot be read.
    Unreadable,
    /// The entry names a frame that the scene does not have.
    FrameOutOfRange,
    /// A frame's field of view exceeds the limit.
    FieldOfView,
    /// The file of an image that the entry needs is missing.
    ImageMissing,
    /// An image does not have the size that the protocol requires.
    ImageSize,
    /// A rotation's determinant is not 1.
    Determinant,
    /// A camera centre has a coordinate above the limit.
    Translation,
    /// The context baseline is outside the limits.
    Baseline,
}

/// A [`DropReason`] with what was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Dropped {
    /// Why it was dropped.
    pub reason: DropReason,
    /// Frame, limit and value.
    pub detail: String,
}

impl DropReason {
    /// All reasons, in their order.
    #[cfg(test)]
    pub(crate) const ALL: [Self; 9] = [
        Self::SceneMissing,
        Self::Unreadable,
        Self::FrameOutOfRange,
        Self::FieldOfView,
        Self::ImageMissing,
        Self::ImageSize,
        Self::Determinant,
        Self::Translation,
        Self::Baseline,
    ];

    /// The reason's stable name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SceneMissing => "scene-missing",
            Self::Unreadable => "unreadable",
            Self::FrameOutOfRange => "frame-out-of-range",
            Self::FieldOfView => "field-of-view",
            Self::ImageMissing => "image-missing",
            Self::ImageSize => "image-size",
            Self::Determinant => "determinant",
            Self::Translation => "translation",
            Self::Baseline => "baseline",
        }
    }
}

impl Filters {
    /// Why the published loaders would drop `entry` of `scene`, with their checks in their order; `None` if they would
    /// use it.
    ///
    /// `image_size` returns the size of a frame's image, from its file or its metadata; a frame of unknown size
    /// passes. For a scene without any images (a bare trajectory), only the cameras are checked.
    pub fn drop_reason(
        &self,
        scene: &Scene,
        entry: &IndexEntry,
        expected_size: Option<ImageSize>,
        image_size: &dyn Fn(&Frame) -> Option<ImageSize>,
    ) -> Option<Dropped> {
        let used = match used_frames(scene, entry) {
            Ok(used) => used,
            Err(dropped) => return Some(dropped),
        };
        self.fov_problem(scene)
            .or_else(|| image_problem(&used, expected_size, image_size))
            .or_else(|| self.pose_problem(&used))
            .or_else(|| self.baseline_problem(&used[..entry.context.len()]))
    }

    fn fov_problem(&self, scene: &Scene) -> Option<Dropped> {
        let limit = self.max_fov_degrees?;
        let (number, degrees) = first_wider_than(scene, limit)?;
        let detail = format!("frame {number} has a field of view of {degrees:.1}°, limit {limit}°");
        Some(Dropped { reason: DropReason::FieldOfView, detail })
    }

    fn pose_problem(&self, used: &[UsedFrame<'_>]) -> Option<Dropped> {
        used.iter().find_map(|UsedFrame { number, pose, .. }| {
            let (centre, determinant) = (pose.centre(), pose.determinant());
            if let Some(limit) = self.max_translation
                && centre.to_array().iter().any(|coordinate| *coordinate > limit)
            {
                let detail = format!("frame {number} at {centre}, limit {limit}");
                return Some(Dropped { reason: DropReason::Translation, detail });
            }
            let is_rotation = !self.determinant || Tolerance::NUMPY_ALLCLOSE.accepts(determinant, 1.0);
            let detail = || format!("frame {number} has determinant {determinant}");
            (!is_rotation).then(|| Dropped { reason: DropReason::Determinant, detail: detail() })
        })
    }

    fn baseline_problem(&self, context: &[UsedFrame<'_>]) -> Option<Dropped> {
        let baseline = context.first()?.pose.centre().distance(context.last()?.pose.centre());
        let too_short = self.min_baseline.is_some_and(|least| baseline < least);
        let too_long = self.max_baseline.is_some_and(|most| baseline > most);
        let detail = || format!("the context baseline is {baseline:e}");
        (too_short || too_long).then(|| Dropped { reason: DropReason::Baseline, detail: detail() })
    }
}

/// A context or target frame of an entry.
struct UsedFrame<'a> {
    number: usize,
    frame: &'a Frame,
    pose: WorldFromCamera,
}

/// The frames of an entry, context before targets.
fn used_frames<'a>(scene: &'a Scene, entry: &IndexEntry) -> Result<Vec<UsedFrame<'a>>, Dropped> {
    let find = |number: &usize| {
        let pose = |frame: &Frame| frame.camera.camera_from_world.inverse();
        let found = scene.frames.get(*number);
        found.map(|frame| UsedFrame { number: *number, frame, pose: pose(frame) }).ok_or_else(|| {
            let detail = format!("frame {number} of {}", scene.frames.len());
            Dropped { reason: DropReason::FrameOutOfRange, detail }
        })
    };
    entry.context.iter().chain(&entry.target).map(find).collect()
}

fn image_problem(
    used: &[UsedFrame<'_>],
    expected_size: Option<ImageSize>,
    image_size: &dyn Fn(&Frame) -> Option<ImageSize>,
) -> Option<Dropped> {
    used.iter().find_map(|UsedFrame { number, frame, .. }| {
        if frame.image.is_missing() {
            let detail = format!("frame {number} ({})", frame.image.place());
            return Some(Dropped { reason: DropReason::ImageMissing, detail });
        }
        let (expected, found) = expected_size.zip(image_size(frame))?;
        let detail = || format!("frame {number} is {found}, expected {expected}");
        (expected != found).then(|| Dropped { reason: DropReason::ImageSize, detail: detail() })
    })
}

/// The first frame with a field of view above `limit` degrees, and that field of view.
fn first_wider_than(scene: &Scene, limit: f64) -> Option<(usize, f64)> {
    scene.frames.iter().enumerate().find_map(|(at, frame)| {
        let fov = frame.camera.intrinsics.field_of_view();
        let beyond = [fov.x, fov.y].map(f64::to_degrees).into_iter().find(|degrees| *degrees > limit)?;
        Some((at, beyond))
    })
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics};
    use atsplat_scene::FrameImage;
    use glam::{DMat3, DVec3};

    use super::*;

    const SIZE: ImageSize = ImageSize { width: 640, height: 360 };

    /// A frame whose centre is at `(x, 0, 0)`.
    fn frame(x: f64) -> Frame {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-x, 0.0, 0.0)).unwrap();
        Frame {
            name: "frame".to_owned(),
            timestamp_micros: None,
            camera: Camera::pinhole(pose, NormalizedIntrinsics::new(0.5, 0.9, 0.5, 0.5).unwrap()),
            stated_size: Some(SIZE),
            image: FrameImage::Absent,
        }
    }

    fn scene() -> Scene {
        Scene { key: "s".to_owned(), url: None, frames: [0.0, 0.5, 1.0].map(frame).to_vec() }
    }

    fn reason(scene: &Scene, target: usize) -> Option<DropReason> {
        let filters = Filters {
            max_fov_degrees: Some(100.0),
            determinant: true,
            max_translation: Some(1e3),
            min_baseline: Some(1e-3),
            max_baseline: Some(1e10),
        };
        let entry = IndexEntry { context: vec![0, 2], target: vec![target], overlap: None };
        filters.drop_reason(scene, &entry, Some(SIZE), &|frame| frame.stated_size).map(|dropped| dropped.reason)
    }

    #[test]
    fn an_ordinary_scene_is_kept() {
        assert_eq!(reason(&scene(), 1), None);
    }

    #[test]
    fn each_published_check_drops_its_scene() {
        assert_eq!(reason(&scene(), 3), Some(DropReason::FrameOutOfRange));
        let mut wide = scene();
        wide.frames[1].camera.intrinsics = NormalizedIntrinsics::new(0.3, 0.9, 0.5, 0.5).unwrap();
        assert_eq!(reason(&wide, 0), Some(DropReason::FieldOfView), "a frame that the entry does not use counts");
        let widest = wide.frames[1].camera.intrinsics.field_of_view().x.to_degrees();
        assert_eq!(first_wider_than(&wide, widest), None, "a field of view at the limit is within it");
        assert_eq!(first_wider_than(&wide, widest.next_down()), Some((1, widest)));
        let mut absent = scene();
        for image in [FrameImage::Missing("1.png".into()), FrameImage::Ambiguous(vec!["1.png".into(), "1.jpg".into()])]
        {
            absent.frames[1].image = image;
            assert_eq!(reason(&absent, 1), Some(DropReason::ImageMissing));
        }
        assert_eq!(reason(&absent, 0), None, "the entry does not use the missing image");
        let mut small = scene();
        small.frames[2].stated_size = Some(ImageSize { width: 320, height: 180 });
        assert_eq!(reason(&small, 1), Some(DropReason::ImageSize));
        let mut skewed = scene();
        skewed.frames[1].camera.camera_from_world =
            CameraFromWorld::new(DMat3::from_diagonal(DVec3::new(1.0, 1.0, 1.000_02)), DVec3::ZERO).unwrap();
        assert_eq!(reason(&skewed, 1), Some(DropReason::Determinant));
        let mut far = scene();
        far.frames[1] = frame(1000.5);
        assert_eq!(reason(&far, 1), Some(DropReason::Translation));
        far.frames[1] = frame(-1e6);
        assert_eq!(reason(&far, 1), None, "the published check is signed");
        let mut still = scene();
        still.frames[2] = frame(0.0005);
        assert_eq!(reason(&still, 1), Some(DropReason::Baseline));
        still.frames[2] = frame(-2e10);
        assert_eq!(reason(&still, 1), Some(DropReason::Baseline), "longer than 1e10");
    }

    #[test]
    fn reasons_have_the_names_of_files() {
        for reason in [DropReason::SceneMissing, DropReason::FieldOfView, DropReason::Baseline] {
            assert_eq!(serde_json::to_value(reason).unwrap(), reason.name());
        }
    }

    #[test]
    fn without_filters_only_unusable_entries_are_dropped() {
        let mut scene = scene();
        scene.frames[1] = frame(1e9);
        let entry = IndexEntry { context: vec![0, 0], target: vec![1], overlap: None };
        assert_eq!(Filters::default().drop_reason(&scene, &entry, None, &|_| None), None);
        let beyond = IndexEntry { context: vec![9], target: vec![], overlap: None };
        let dropped = Filters::default().drop_reason(&scene, &beyond, None, &|_| None).unwrap();
        assert_eq!((dropped.reason, dropped.detail.as_str()), (DropReason::FrameOutOfRange, "frame 9 of 3"));
    }
}
