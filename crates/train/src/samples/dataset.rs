use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use atsplat_camera::{Camera, PoseNormalisation};
use atsplat_files::Sha256Digest;
use atsplat_model::{ImageSize, ModelConfig};
use atsplat_numeric::SplitMix64;
use atsplat_pixels::ImageU8;
use atsplat_protocol::samplers::SceneViews;
use atsplat_protocol::trial::{Prefetch, SkipReason, TrialRecipe, Trials};
use atsplat_protocol::{EvaluationIndex, Preset, ProtocolError};
use atsplat_scene::{Dataset, OneScene, Scene, SceneError, SceneSource, Warning, WarningKind, Warnings};
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

use super::exclude::scene_name;
use super::{ExcludedScenes, PosedImages, ReplacedDraws, Sample, SampleId, Source, ViewChoice, first_sample};
use crate::TrainError;
use crate::config::{WHAT, size_problem};
use crate::error::Purpose;

/// A dataset on disk with a protocol's preprocessing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct DatasetConfig {
    /// A file or folder of any format that `scene` reads.
    pub path: PathBuf,
    /// Name or path of the protocol whose preprocessing and filters apply.
    pub preset: String,
    /// How frames are chosen for a sample.
    pub views: ViewChoice,
    /// Scenes that are never drawn: those of the indices that the network will be evaluated on. Keys are compared without the
    /// prefix `dl3dv_`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub exclude: Vec<ExcludedScenes>,
}

impl DatasetConfig {
    /// Rejects a folder from which the reader would take test scenes: one with both `train` and `test`, or with `test` alone.
    /// A path that ends in `test` is accepted.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] for such a folder; [`TrainError::Scene`] if one of its splits is a dataset that cannot be
    /// opened, because its scenes are unknown then.
    pub(crate) fn require_one_split(&self, field: String) -> Result<(), TrainError> {
        let [train, test] = ["train", "test"].map(|split| self.path.join(split));
        let holds_scenes = |folder: &Path| Ok::<_, SceneError>(folder.is_dir() && dataset_in(folder)?.is_some());
        if !holds_scenes(&test)? {
            return Ok(());
        }
        if holds_scenes(&train)? {
            let expected = format!("{}, without the test scenes in {}", train.display(), test.display());
            return Err(TrainError::malformed(WHAT, field, expected, self.path.display()));
        }
        let Some(dataset) = dataset_in(&self.path)? else { return Ok(()) };
        for key in dataset.keys() {
            if dataset.files(key)?.iter().any(|file| file.is_file() && file.starts_with(&test)) {
                let expected = format!("a folder of training scenes, or {} to train on those", test.display());
                let found = format!("{}, whose scene {key} is in test", self.path.display());
                return Err(TrainError::malformed(WHAT, field, expected, found));
            }
        }
        Ok(())
    }
}

/// The dataset that a folder contains, if any.
fn dataset_in(folder: &Path) -> Result<Option<Dataset>, SceneError> {
    match atsplat_scene::open(folder, &mut Warnings::new()) {
        Ok(dataset) => Ok(Some(dataset)),
        Err(SceneError::Unrecognized { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Samples from the scenes of a dataset, prepared by the same code as an evaluation's trials.
pub struct DatasetSource {
    config: DatasetConfig,
    dataset: Box<dyn SceneSource>,
    /// Of the scenes that may be drawn.
    keys: Vec<String>,
    recipe: TrialRecipe,
    /// The network that trains on the samples, if they must have a size that it trains on.
    network: Option<ModelConfig>,
    notices: Vec<String>,
    counted: Mutex<Counted>,
}

/// Warnings of scenes and their trials, each counted once although scenes are loaded again and again.
#[derive(Default)]
struct Counted {
    warnings: Warnings,
    /// Keys of scenes whose loading was counted.
    scenes: BTreeSet<String>,
    /// Warnings of trials that were counted: kind, scene, detail.
    of_trials: BTreeSet<(WarningKind, String, String)>,
    replaced: ReplacedDraws,
}

impl DatasetSource {
    /// Opens the dataset; no scene is read yet. Poses are normalised by `normalisation`, not by the preset's rule.
    ///
    /// # Errors
    /// [`TrainError::Scene`], [`TrainError::Protocol`], [`TrainError::Malformed`] for a dataset without scenes.
    pub fn open(
        config: DatasetConfig,
        normalisation: PoseNormalisation,
        warnings: &mut Warnings,
    ) -> Result<Self, TrainError> {
        let dataset: Box<dyn SceneSource> = Box::new(atsplat_scene::open(&config.path, warnings)?);
        let (mut excluded, mut notices) = (BTreeSet::new(), Vec::new());
        for scenes in &config.exclude {
            let names = scenes.names()?;
            let count = dataset.keys().iter().filter(|key| names.contains(scene_name(key))).count();
            let (path, all, index) = (config.path.display(), dataset.keys().len(), scenes.index.display());
            notices.push(format!("{path}: {count} of {all} scenes excluded by {index}"));
            excluded.extend(names);
        }
        let keys = dataset.keys().iter().filter(|key| !excluded.contains(scene_name(key)));
        let keys: Vec<String> = keys.cloned().collect();
        if keys.is_empty() {
            let place = config.path.display().to_string();
            let found = format!("{} scenes, all of them excluded", dataset.keys().len());
            return Err(TrainError::malformed(
                Purpose::Training.data(),
                place,
                "at least one scene to draw from",
                found,
            ));
        }
        let recipe = TrialRecipe {
            pose_normalisation: normalisation,
            ..TrialRecipe::of(&Preset::resolve(&config.preset)?, "ATSplat")
        };
        Ok(Self { config, dataset, keys, recipe, network: None, notices, counted: Mutex::default() })
    }

    /// The same source, which rejects draws whose images have a size that this network does not train on.
    pub(crate) fn for_network(self, network: ModelConfig) -> Self {
        Self { network: Some(network), ..self }
    }

    /// Keys of the scenes that may be drawn, in the dataset's order.
    pub fn keys(&self) -> &[String] {
        &self.keys
    }

    /// Whether a scene of the same name may be drawn from both, with or without the prefix of DL3DV's training set.
    pub(crate) fn shares_a_scene_with(&self, other: &Self) -> bool {
        let names: BTreeSet<&str> = self.keys.iter().map(|key| scene_name(key)).collect();
        other.keys.iter().any(|key| names.contains(scene_name(key)))
    }

    fn counted(&self) -> MutexGuard<'_, Counted> {
        self.counted.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Loads a scene and counts its warnings, or its failure, the first time.
    fn load(&self, key: &str) -> Result<Scene, String> {
        let mut warnings = Warnings::new();
        let scene = self.dataset.load(key, &mut warnings).map_err(|error| {
            warnings.push(WarningKind::UnreadableScene, key, error.to_string());
            error.to_string()
        });
        let mut counted = self.counted();
        if counted.scenes.insert(key.to_owned()) {
            counted.warnings.merge(warnings);
        }
        scene
    }

    /// Counts the warnings of a trial that no earlier trial had.
    fn count_trial(&self, warnings: &Warnings) {
        let mut counted = self.counted();
        for Warning { kind, scene, detail } in warnings.kept() {
            if counted.of_trials.insert((*kind, scene.clone(), detail.clone())) {
                counted.warnings.push(*kind, scene, detail);
            }
        }
    }

    /// Counts an image whose header or content cannot be read, unless an earlier sample had it.
    fn count_unreadable(&self, key: &str, reason: &str) {
        let mut warnings = Warnings::new();
        warnings.push(WarningKind::UnreadableImage, key, reason);
        self.count_trial(&warnings);
    }

    /// A sample of one scene by one draw of frames, or why there is none.
    fn try_sample(&self, key: &str, step: u64, random: &mut SplitMix64) -> Result<Sample, String> {
        let scene = self.load(key).map_err(|error| format!("{key}: {error}"))?;
        let cameras: Vec<Camera> = scene.frames.iter().map(|frame| frame.camera).collect();
        let entry = self.config.views.draw(&SceneViews { key, cameras: &cameras }, step, random);
        let entry = entry.map_err(|error| format!("{key}: {error}"))?;
        let name = format!("{key}, frames {:?} to {:?}", entry.context, entry.target);
        // Their scene was loaded with a warning, and their images may be fine.
        let unposed = scene.frames.iter().enumerate().filter(|(_, frame)| !frame.has_pose());
        let unposed: Vec<String> = unposed.map(|(at, _)| format!("frame {at} ")).collect();
        let index = EvaluationIndex { scenes: IndexMap::from([(key.to_owned(), vec![entry])]) };
        let one = Arc::new(OneScene::new(scene));
        let mut trials = Trials::new(one, &index, self.recipe.clone(), Prefetch::NONE);
        let trial = trials.next();
        self.count_trial(trials.warnings());
        let (trial, truths) = match trial {
            Some(Ok(trial)) => trial,
            Some(Err(skipped)) => {
                let has_pose = !unposed.iter().any(|frame| skipped.detail.starts_with(frame.as_str()));
                if skipped.reason == SkipReason::ImageUnreadable && has_pose {
                    self.count_unreadable(key, &skipped.detail);
                }
                return Err(format!("{name}: {}", skipped.detail));
            }
            None => return Err(format!("{name}: no trial")),
        };
        let context = trial.context().iter().map(|view| Ok((view.camera, view.image()?)));
        let targets = trial.targets().iter().zip(0..).filter_map(|(target, position)| {
            let image = truths.get(position)?;
            Some(image.map(|image| (target.camera, image)))
        });
        let unreadable = |error: ProtocolError| {
            let reason = error.to_string();
            self.count_unreadable(key, &reason);
            format!("{name}: {reason}")
        };
        let context = posed(&context.collect::<Result<Vec<_>, _>>().map_err(unreadable)?);
        let targets = posed(&targets.collect::<Result<Vec<_>, _>>().map_err(unreadable)?);
        let (Some(context), Some(targets)) = (context, targets) else {
            return Err(format!("{name}: expected images of one size"));
        };
        match self.network.as_ref().and_then(|network| size_problem(context.size, network)) {
            Some(why) => Err(format!("{name}: {why}")),
            None => Ok(Sample { name, context, targets, distances: None }),
        }
    }
}

/// `None` if images differ in size or there are none.
fn posed(views: &[(Camera, Arc<ImageU8>)]) -> Option<PosedImages> {
    let size_of = |image: &ImageU8| ImageSize::new(image.height() as usize, image.width() as usize);
    let size = views.first().map(|(_, image)| size_of(image))?;
    if views.iter().any(|(_, image)| size_of(image) != size) {
        return None;
    }
    let bytes = views.iter().flat_map(|(_, image)| image.samples());
    let images = bytes.map(|byte| f32::from(*byte) / 255.0).collect();
    Some(PosedImages { size, images, cameras: views.iter().map(|(camera, _)| *camera).collect() })
}

impl Source for DatasetSource {
    fn name(&self) -> String {
        let DatasetConfig { path, preset, views, .. } = &self.config;
        format!("{} under {preset} ({views})", path.display())
    }

    fn warnings(&self) -> Warnings {
        self.counted().warnings.clone()
    }

    fn replaced(&self) -> ReplacedDraws {
        self.counted().replaced.clone()
    }

    fn scene_lists(&self) -> Vec<(String, Sha256Digest)> {
        vec![("dataset.scenes-sha256".to_owned(), Sha256Digest::of(self.keys.join("\n").as_bytes()))]
    }

    fn notices(&self) -> Vec<String> {
        self.notices.clone()
    }

    fn sample(&self, id: SampleId) -> Result<Sample, TrainError> {
        let keys = &self.keys;
        // Paths of data and preset change no draw.
        first_sample(self, "dataset", id, |random| {
            #[expect(clippy::expect_used, reason = "a dataset without scenes to draw is rejected when it is opened")]
            let key = random.within(0..=keys.len() - 1).and_then(|at| keys.get(at)).expect("a scene");
            let outcome = self.try_sample(key, id.step, random);
            if let Err(reason) = &outcome {
                self.counted().replaced.add(key, reason);
            }
            Ok(outcome)
        })
    }
}

impl std::fmt::Debug for DatasetSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DatasetSource").field("config", &self.config).finish_non_exhaustive()
    }
}
