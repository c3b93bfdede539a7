//! Samplers: the algorithms by which sampling rules choose the context and target frames of a scene.

mod bounded;
mod evenly_spaced;
mod every_nth;
mod farthest_point;
mod overlap_pairs;

pub use bounded::{Bounded, ExtraContext, GapSchedule};
pub use evenly_spaced::EvenlySpaced;
pub use every_nth::EveryNth;
pub use farthest_point::{FarthestPoint, TargetRule, farthest_points};
pub use overlap_pairs::{OverlapPairs, PairTargets};

use atsplat_camera::{Camera, no_fields};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::IndexEntry;
use crate::preset::{DropReason, Dropped};

/// What a sampler sees of a scene: cameras in frame order, no images.
#[derive(Clone, Copy, Debug)]
pub struct SceneViews<'a> {
    /// The scene's key, from which its random stream derives.
    pub key: &'a str,
    /// One camera per frame, with the dataset's intrinsics unless a sampler documents otherwise.
    pub cameras: &'a [Camera],
}

impl SceneViews<'_> {
    /// Camera centres in the world, in frame order.
    pub fn centres(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.cameras.iter().map(|camera| camera.camera_from_world.inverse().centre())
    }
}

/// How a sampling rule chooses context and target frames; in TOML and JSON, `sampler = "farthest-point"` and its settings.
///
/// The result depends only on the scene's key, its cameras and the settings: it is the same on every platform, for every
/// order of scenes and any number of threads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "sampler", rename_all = "kebab-case")]
pub enum Sampler {
    /// Farthest-point context inside a window (DepthSplat's DL3DV indices).
    FarthestPoint(FarthestPoint),
    /// Farthest-point context over the scene, targets evenly spaced over the rest (`MVSplat360`).
    EvenlySpaced(EvenlySpaced),
    /// Every n-th frame is a target, context evenly spaced over the rest (Long-LRM).
    EveryNth(EveryNth),
    /// Two context frames of sufficient overlap (pixelSplat's RE10K index, latentSplat's extrapolation).
    OverlapPairs(OverlapPairs),
    /// A random window of bounded width (the papers' training sampler, at the end of its schedule).
    Bounded(Bounded),
    /// Every frame is context and target (pixelSplat's `view_sampler_all.py`).
    #[serde(deserialize_with = "no_fields")]
    AllFrames,
}

impl Sampler {
    /// The name used in files.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::FarthestPoint(_) => "farthest-point",
            Self::EvenlySpaced(_) => "evenly-spaced",
            Self::EveryNth(_) => "every-nth",
            Self::OverlapPairs(_) => "overlap-pairs",
            Self::Bounded(_) => "bounded",
            Self::AllFrames => "all-frames",
        }
    }

    /// Samples a scene; at least one entry.
    ///
    /// # Errors
    /// [`NoEntry`] if the settings cannot be met in this scene, which becomes `null` in an index.
    pub fn sample(&self, scene: &SceneViews<'_>) -> Result<Vec<IndexEntry>, NoEntry> {
        match self {
            Self::FarthestPoint(sampler) => sampler.sample(scene),
            Self::EvenlySpaced(sampler) => sampler.sample(scene),
            Self::EveryNth(sampler) => sampler.sample(scene),
            Self::OverlapPairs(sampler) => sampler.sample(scene),
            Self::Bounded(sampler) => sampler.sample(scene),
            Self::AllFrames => all_frames(scene),
        }
    }
}

/// Every frame is both context and target: to look at a scene, not to score a method.
fn all_frames(scene: &SceneViews<'_>) -> Result<Vec<IndexEntry>, NoEntry> {
    let frames: Vec<usize> = (0..scene.cameras.len()).collect();
    if frames.is_empty() {
        return Err(NoEntry::TooFewFrames { needed: 1, found: 0 });
    }
    Ok(vec![entry(frames.clone(), frames)])
}

/// Why a scene has no entry.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum NoEntry {
    /// The scene, or the window inside it, is too short.
    #[error("needs {needed} frames, has {found}")]
    TooFewFrames { needed: usize, found: usize },
    /// The largest allowed gap is too small, however long the scene is.
    #[error("needs gaps of at least {needed} frames, has at most {most}")]
    GapsTooSmall {
        /// Least gap for the smallest one that is allowed, the distance of targets to context frames, and the context frames.
        needed: usize,
        most: usize,
    },
    /// Fewer frames may be targets than required.
    #[error("needs {needed} target frames, has {found} candidates")]
    TooFewTargets { needed: usize, found: usize },
    /// No two frames are far enough apart and overlap enough.
    #[error("no pair of frames at the required distance has the required overlap")]
    NoPair,
    /// The overlap of the chosen context frames is out of bounds.
    #[error("overlap {overlap} is outside [{minimum}, {maximum}]")]
    OverlapOutside {
        /// The measured overlap, with five decimals.
        overlap: String,
        minimum: String,
        maximum: String,
    },
    /// The geometry of the cameras cannot be computed: numbers exceed the range of f64.
    #[error("camera geometry: {0}")]
    Geometry(String),
    /// The overlap of the views is not defined: there are fewer than two, or one has no features or no depth.
    #[error("{0}")]
    OverlapUndefined(String),
    /// The dataset does not contain the scene.
    #[error("{0}")]
    SceneMissing(String),
    /// The scene, or an image or depth map of it, cannot be read.
    #[error("{0}")]
    Unreadable(String),
}

impl NoEntry {
    /// The reason's stable name.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::TooFewFrames { .. } => "too-few-frames",
            Self::GapsTooSmall { .. } => "gaps-too-small",
            Self::TooFewTargets { .. } => "too-few-targets",
            Self::NoPair => "no-pair",
            Self::OverlapOutside { .. } => "overlap-outside",
            Self::Geometry(_) => "geometry",
            Self::OverlapUndefined(_) => "overlap-undefined",
            Self::SceneMissing(_) => "scene-missing",
            Self::Unreadable(_) => "unreadable",
        }
    }
}

impl From<Dropped> for NoEntry {
    /// For a scene that cannot be loaded.
    fn from(Dropped { reason, detail }: Dropped) -> Self {
        if reason == DropReason::SceneMissing { Self::SceneMissing(detail) } else { Self::Unreadable(detail) }
    }
}

fn entry(context: Vec<usize>, target: Vec<usize>) -> IndexEntry {
    IndexEntry { context, target, overlap: None }
}

#[cfg(test)]
pub(crate) mod test_scene {
    use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
    use glam::{DMat3, DVec3};

    /// A wide camera at each centre, all looking along +z.
    pub(crate) fn along(centres: impl IntoIterator<Item = DVec3>) -> Vec<Camera> {
        centres.into_iter().map(|centre| looking(DMat3::IDENTITY, centre)).collect()
    }

    /// A camera with a field of view of 53° × 53°, and the given orientation and centre.
    pub(crate) fn looking(world_from_camera: DMat3, centre: DVec3) -> Camera {
        let pose = WorldFromCamera::new(world_from_camera, centre).unwrap();
        Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap())
    }
}

#[cfg(test)]
mod tests {
    use super::test_scene::along;
    use super::*;

    #[test]
    fn reads_samplers_from_toml_and_rejects_unknown_fields() {
        let text = "sampler = \"farthest-point\"\nwindow = 50\ncontext-views = 6\ntargets = { rule = \"window\" }\n";
        let sampler: Sampler = toml::from_str(text).unwrap();
        assert_eq!(sampler.name(), "farthest-point");
        assert_eq!(toml::from_str::<Sampler>(&toml::to_string(&sampler).unwrap()).unwrap(), sampler);
        assert!(toml::from_str::<Sampler>(&format!("{text}windw = 3\n")).is_err(), "a misspelt field");
        assert!(toml::from_str::<Sampler>(&text.replace("50", "0")).is_err(), "an empty window");
    }

    #[test]
    fn settings_of_another_rule_are_errors() {
        let farthest = "sampler = 'farthest-point'\nwindow = 50\ncontext-views = 6\n";
        for (valid, rest) in [
            ("sampler = 'all-frames'\n".to_owned(), "seed = 3\n"),
            (format!("{farthest}targets.rule = 'window'\n"), "targets.count = 8\n"),
            (format!("{farthest}targets.rule = 'between-context'\n"), "targets.seed = 1\n"),
            (format!("{farthest}targets.rule = 'spread'\ntargets.count = 8\n"), "targets.seed = 1\n"),
        ] {
            let sampler: Sampler = toml::from_str(&valid).unwrap_or_else(|error| panic!("{valid}: {error}"));
            assert_eq!(toml::from_str::<Sampler>(&toml::to_string(&sampler).unwrap()).unwrap(), sampler);
            let error = toml::from_str::<Sampler>(&format!("{valid}{rest}")).unwrap_err().to_string();
            assert!(error.contains("unknown field `"), "{rest}: {error}");
        }
    }

    #[test]
    fn no_sampler_panics_on_short_scenes() {
        let samplers = [
            "sampler = 'farthest-point'\nwindow = 50\ncontext-views = 6\ntargets = { rule = 'sampled', count = 8, seed = 1, allow-context = false }",
            "sampler = 'farthest-point'\nwindow = 50\ncontext-views = 6\ntargets = { rule = 'spread', count = 8 }",
            "sampler = 'evenly-spaced'\ncontext-views = 5\ntarget-views = 56",
            "sampler = 'every-nth'\nevery = 3\ncontext-views = 2",
            "sampler = 'overlap-pairs'\nseed = 1\ntargets = { side = 'inside', count = 3 }",
            "sampler = 'overlap-pairs'\nseed = 1\nmin-distance = 1\ntargets = { side = 'outside', count = 3, reach = 45 }",
            "sampler = 'bounded'\nseed = 1\ncontext-views = 6\ntarget-views = 4\ngaps = { min = 45, max = 135 }",
            "sampler = 'all-frames'",
        ];
        for text in samplers {
            let sampler: Sampler = toml::from_str(text).unwrap_or_else(|error| panic!("{text}: {error}"));
            for length in 0..8u32 {
                let cameras = along((0..length).map(|n| DVec3::new(f64::from(n), 0.0, 0.0)));
                let outcome = sampler.sample(&SceneViews { key: "short", cameras: &cameras });
                assert!(!matches!(&outcome, Ok(entries) if entries.is_empty()), "{text}: {outcome:?}");
            }
        }
    }
}
