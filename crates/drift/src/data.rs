//! Which images differ from the baseline's.

use std::collections::{BTreeMap, BTreeSet};

use atsplat_results::{Results, TrialKey};
use serde::{Deserialize, Serialize};

use super::probe::StageVerdict;
use super::{Baseline, BaselineTarget};

/// An image as used in trials, decoded and preprocessed.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageDigest {
    /// Name of the preset.
    pub preset: String,
    /// Key of the scene.
    pub scene: String,
    /// Position of the frame in the scene.
    pub frame: u64,
    /// SHA-256 of its samples.
    pub sha256: String,
}

/// Comparison of the images of results and baseline.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct DataComparison {
    /// Images with a digest in both.
    pub compared: u64,
    /// Those that differ, ordered by preset, scene and frame.
    pub changed: Vec<ChangedImage>,
    /// Images of common scenes with a digest in only one of them.
    pub unknown: u64,
    /// Images of common scenes that the preset now crops or resizes differently, so that their digests say nothing about the data.
    #[serde(rename = "preprocessed-otherwise")]
    pub preprocessed_differently: u64,
}

/// An image that differs from the baseline's.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ChangedImage {
    /// Name of the preset.
    pub preset: String,
    /// Key of the scene.
    pub scene: String,
    /// Position of the frame in the scene.
    pub frame: u64,
    /// Its roles: both if a target is also a context frame.
    pub roles: BTreeSet<ImageRole>,
}

/// Role of an image in a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ImageRole {
    /// Input of a method.
    Context,
    /// Ground truth of a render.
    Target,
}

impl ImageRole {
    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Context => "context",
            Self::Target => "target",
        }
    }
}

impl DataComparison {
    /// The verdict; comparing nothing is not [`StageVerdict::Same`].
    pub fn verdict(&self) -> StageVerdict {
        match (self.changed.is_empty(), self.compared) {
            (false, _) => StageVerdict::Changed,
            (true, 0) => StageVerdict::Empty,
            (true, _) => StageVerdict::Same,
        }
    }
}

/// Compares the images of common scenes, except for those of presets in `others`, which preprocess images differently now.
#[expect(clippy::expect_used, reason = "digests and roles come from the same rows")]
pub(super) fn compare_images(results: &Results, baseline: &Baseline, others: &BTreeSet<&str>) -> DataComparison {
    let then = by_id(&baseline.images);
    let listed = images_of(results);
    let now = by_id(&listed);
    let roles = roles_of(results);
    let scenes = |keys: &mut dyn Iterator<Item = &TrialKey>| -> BTreeSet<(String, String)> {
        keys.map(|key| (key.preset.clone(), key.scene.clone())).collect()
    };
    let known = scenes(&mut baseline.trials.iter().map(|trial| &trial.key));
    let present = scenes(&mut results.trials.iter().map(|trial| &trial.key));
    let shared = |(preset, scene, _): &&ImageId| {
        let scene = (preset.clone(), scene.clone());
        known.contains(&scene) && present.contains(&scene)
    };
    let ids: BTreeSet<&ImageId> = then.keys().chain(now.keys()).collect();
    let mut found = DataComparison::default();
    for id in ids.into_iter().filter(shared) {
        match (then.get(id), now.get(id)) {
            _ if others.contains(id.0.as_str()) => found.preprocessed_differently += 1,
            (Some(then), Some(now)) => {
                found.compared += 1;
                if then != now {
                    let (preset, scene, frame) = id.clone();
                    let roles = roles.get(id).cloned().expect("every image of the results has a role");
                    found.changed.push(ChangedImage { preset, scene, frame, roles });
                }
            }
            _ => found.unknown += 1,
        }
    }
    found
}

/// All images of a run, ordered and without duplicates.
pub(super) fn images_of(results: &Results) -> Vec<ImageDigest> {
    let context = results.trials.iter().flat_map(|trial| {
        let digest = |(frame, sha256): (&u64, &String)| digest(&trial.key, *frame, sha256);
        trial.context.iter().zip(&trial.context_hashes).map(digest)
    });
    let targets = results.targets.iter().filter_map(|row| Some(digest(&row.key, row.frame, row.truth_hash.as_ref()?)));
    unique(context.chain(targets))
}

/// The images known to a baseline whose format does not list them: those of its targets.
pub(super) fn images_of_targets(targets: &[BaselineTarget]) -> Vec<ImageDigest> {
    unique(targets.iter().filter_map(|row| Some(digest(&row.key, row.frame, row.truth_hash.as_ref()?))))
}

type ImageId = (String, String, u64);

fn digest(key: &TrialKey, frame: u64, sha256: &str) -> ImageDigest {
    ImageDigest { preset: key.preset.clone(), scene: key.scene.clone(), frame, sha256: sha256.to_owned() }
}

fn unique(images: impl Iterator<Item = ImageDigest>) -> Vec<ImageDigest> {
    images.collect::<BTreeSet<_>>().into_iter().collect()
}

/// Digests by preset, scene and frame. Several digests mean that methods saw different images, which counts as a change.
fn by_id(images: &[ImageDigest]) -> BTreeMap<ImageId, BTreeSet<&str>> {
    let mut ids: BTreeMap<ImageId, BTreeSet<&str>> = BTreeMap::new();
    for ImageDigest { preset, scene, frame, sha256 } in images {
        ids.entry((preset.clone(), scene.clone(), *frame)).or_default().insert(sha256);
    }
    ids
}

fn roles_of(results: &Results) -> BTreeMap<ImageId, BTreeSet<ImageRole>> {
    let mut roles: BTreeMap<ImageId, BTreeSet<ImageRole>> = BTreeMap::new();
    let mut add = |key: &TrialKey, frame: u64, role| {
        roles.entry((key.preset.clone(), key.scene.clone(), frame)).or_default().insert(role);
    };
    for trial in &results.trials {
        trial.context.iter().for_each(|frame| add(&trial.key, *frame, ImageRole::Context));
    }
    results.targets.iter().for_each(|row| add(&row.key, row.frame, ImageRole::Target));
    roles
}
