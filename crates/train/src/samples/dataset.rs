use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use atsplat_camera::{Camera, PoseNormalisation};
use atsplat_files::Sha256Digest;
use atsplat_model::{ImageSize, ModelConfig};
use atsplat_numeric::{SplitMix64, counted};
use atsplat_pixels::ImageU8;
use atsplat_protocol::samplers::SceneViews;
use atsplat_protocol::trial::{Prefetch, SkipReason, TrialRecipe, Trials};
use atsplat_protocol::{EvaluationIndex, Preset, ProtocolError};
use atsplat_scene::{Dataset, ImageOptions, OneScene, Scene, SceneError, SceneSource, WarningKind, Warnings};
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

use super::data_warnings::DatasetWarnings;
use super::exclude::scene_name;
use super::{
    DataWarnings, ExcludedScenes, PosedImages, ReplacedDraws, Sample, SampleId, Source, UnstablePoses, ViewChoice,
    first_sample,
};
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
    /// Which copy of a capture's images: 1 for `images`, 2, 4 or 8 for `images_2` and so on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub images: Option<u32>,
    /// Folder of the frames, if they are not next to the poses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frames: Option<PathBuf>,
    /// Whether DL3DV's undistorted `gaussian_splat/` is read in scenes that have it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub prefer_undistorted: bool,
    /// How frames are chosen for a sample.
    pub views: ViewChoice,
    /// Scenes that are never drawn: those of the indices that the network will be evaluated on. Keys are compared without the
    /// prefix `dl3dv_`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub exclude: Vec<ExcludedScenes>,
}

impl DatasetConfig {
    /// The folder with its protocol and views.
    pub(crate) fn description(&self) -> String {
        let Self { path, preset, images, prefer_undistorted, views, .. } = self;
        let images = images.map_or_else(String::new, |factor| format!(", images {factor}"));
        let undistorted = if *prefer_undistorted { ", undistorted" } else { "" };
        format!("{} under {preset} ({views}{images}{undistorted})", path.display())
    }

    /// Rejects a folder from which the reader would take test scenes: one with both `train` and `test`, or with `test` alone.
    /// A path that ends in `test` is accepted.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] for such a folder; [`TrainError::Scene`] if one of its splits is a dataset that cannot be
    /// opened, because its scenes are unknown then.
    pub(crate) fn require_one_split(&self, field: String) -> Result<(), TrainError> {
        let [train, test] = ["train", "test"].map(|split| self.path.join(split));
        let holds_scenes = |folder: &Path| Ok::<_, SceneError>(folder.is_dir() && self.dataset_in(folder)?.is_some());
        if !holds_scenes(&test)? {
            return Ok(());
        }
        if holds_scenes(&train)? {
            let expected = format!("{}, without the test scenes in {}", train.display(), test.display());
            return Err(TrainError::malformed(WHAT, field, expected, self.path.display()));
        }
        let Some(dataset) = self.dataset_in(&self.path)? else { return Ok(()) };
        for key in dataset.keys() {
            if dataset.files(key)?.iter().any(|file| file.is_file() && file.starts_with(&test)) {
                let expected = format!("a folder of training scenes, or {} to train on those", test.display());
                let found = format!("{}, whose scene {key} is in test", self.path.display());
                return Err(TrainError::malformed(WHAT, field, expected, found));
            }
        }
        Ok(())
    }

    /// The dataset that a folder contains, if any.
    fn dataset_in(&self, folder: &Path) -> Result<Option<Dataset>, SceneError> {
        let options = self.image_options().open_options();
        match atsplat_scene::open_with(folder, &options, &mut Warnings::new()) {
            Ok(dataset) => Ok(Some(dataset)),
            Err(SceneError::Unrecognized { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    fn image_options(&self) -> ImageOptions {
        let (images, frames) = (self.images, self.frames.clone());
        ImageOptions { images, frames, prefer_undistorted: self.prefer_undistorted }
    }

    /// Opens the dataset for `preset`, which [`Self::preset`] names; the error's field is one of this table.
    fn open(&self, preset: &Preset, warnings: &mut Warnings) -> Result<Dataset, TrainError> {
        let options = self.image_options();
        let mut for_preset = options.open_options();
        for_preset.nerfstudio.expected_size = preset.preprocessing.expected_size;
        let dataset = atsplat_scene::open_with(&self.path, &for_preset, warnings);
        let dataset = dataset.map_err(|error| TrainError::from(error).in_field("path"))?;
        options.check(Some(dataset.format)).map_err(|unread| {
            let found = format!("a dataset in the format {}", dataset.format);
            let source = TrainError::malformed("dataset", self.path.display().to_string(), unread.expected, found);
            TrainError::InField { field: unread.option.to_owned(), source: Box::new(source) }
        })?;
        Ok(dataset)
    }

    /// What the data are opened with: sources with the same read the same.
    fn identity(&self, preset: &Preset) -> String {
        let resolved = |path: &PathBuf| path.canonicalize().unwrap_or_else(|_| path.clone());
        let (path, frames) = (resolved(&self.path), self.frames.as_ref().map(resolved));
        let expected_size = preset.preprocessing.expected_size;
        format!("{:?}", (path, frames, self.images, self.prefer_undistorted, expected_size))
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
    /// What its data were opened with.
    identity: String,
    counted: Mutex<Counted>,
}

/// What was wrong with the data so far, what was drawn in vain, and whose poses have no stable normalisation.
struct Counted {
    warnings: DatasetWarnings,
    replaced: ReplacedDraws,
    unstable: UnstablePoses,
}

impl DatasetSource {
    /// Opens the dataset; no scene is read yet. Poses are normalised by `normalisation`, not by the preset's rule. What is wrong with the
    /// data is added to `warnings`, and [`Source::warnings`] counts it too.
    ///
    /// # Errors
    /// [`TrainError::InField`] if the dataset, its preset or an index of excluded scenes cannot be read, or its format does not read an
    /// option; [`TrainError::Malformed`] for a dataset without scenes and for another index.
    pub fn open(
        config: DatasetConfig,
        normalisation: PoseNormalisation,
        warnings: &mut Warnings,
    ) -> Result<Self, TrainError> {
        let preset = Preset::resolve(&config.preset).map_err(|error| TrainError::from(error).in_field("preset"))?;
        let mut opening = Warnings::new();
        let dataset: Box<dyn SceneSource> = Box::new(config.open(&preset, &mut opening)?);
        warnings.merge(opening.clone());
        let (mut excluded, mut notices) = (BTreeSet::new(), Vec::new());
        for (at, scenes) in config.exclude.iter().enumerate() {
            let names = scenes.names().map_err(|error| error.in_field(format!("exclude[{at}].index")))?;
            let count = dataset.keys().iter().filter(|key| names.contains(scene_name(key))).count();
            let (path, all, index) = (config.path.display(), dataset.keys().len(), scenes.index.display());
            notices.push(format!("{path}: {count} of {all} scenes excluded by {index}"));
            excluded.extend(names);
        }
        let keys = dataset.keys().iter().filter(|key| !excluded.contains(scene_name(key)));
        let keys: Vec<String> = keys.cloned().collect();
        if keys.is_empty() {
            let place = config.path.display().to_string();
            let found = format!("{}, all excluded", counted(dataset.keys().len() as u64, "scene"));
            return Err(TrainError::malformed(
                Purpose::Training.data(),
                place,
                "at least one scene to draw from",
                found,
            ));
        }
        let recipe = TrialRecipe { pose_normalisation: normalisation, ..TrialRecipe::of(&preset, "ATSplat") };
        let (replaced, unstable) = (ReplacedDraws::default(), UnstablePoses::default());
        let counted = Counted { warnings: DatasetWarnings::new(opening), replaced, unstable };
        let (identity, counted) = (config.identity(&preset), Mutex::new(counted));
        Ok(Self { config, dataset, keys, recipe, network: None, notices, identity, counted })
    }

    /// The same source, which rejects draws whose images have a size that this network does not train on.
    pub(crate) fn for_network(self, network: ModelConfig) -> Self {
        Self { network: Some(network), ..self }
    }

    /// Draws a sample, so that data without any are an error before the first step. It is not counted, nor what is drawn in vain: the run
    /// may not draw them.
    ///
    /// # Errors
    /// As [`Source::sample`], if none of the first few draws gives a sample.
    pub(crate) fn require_sample(&self, seed: u64) -> Result<(), TrainError> {
        // In sparse data, each may fail by chance.
        const TRIED: u64 = 5;
        let sample = |number| self.sample(SampleId { seed, number, step: 0 }).map(drop);
        let found = (1..TRIED).fold(sample(0), |outcome, number| outcome.or_else(|_error| sample(number)));
        self.counted().replaced = ReplacedDraws::default();
        self.counted().unstable = UnstablePoses::default();
        found
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
        self.counted().warnings.add_scene(key, warnings);
        scene
    }

    /// Counts the warnings of a trial that no earlier trial had.
    fn count_trial(&self, warnings: &Warnings) {
        self.counted().warnings.add_trial(warnings);
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
        let index = EvaluationIndex { scenes: IndexMap::from([(key.to_owned(), vec![entry])]) };
        let one = Arc::new(OneScene::new(scene));
        let mut trials = Trials::new(one, &index, self.recipe.clone(), Prefetch::NONE);
        let trial = trials.next();
        self.count_trial(trials.warnings());
        let (trial, truths) = match trial {
            Some(Ok(trial)) => trial,
            Some(Err(skipped)) => {
                // Of an unusable pose, the scene was loaded with a warning.
                if skipped.reason == SkipReason::ImageUnreadable {
                    self.count_unreadable(key, &skipped.detail);
                }
                return Err(format!("{name}: {}: {}", skipped.reason.name(), skipped.detail));
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
        if let Some(why) = self.network.as_ref().and_then(|network| size_problem(context.size, network)) {
            return Err(format!("{name}: {why}"));
        }
        self.counted().unstable.add(key, &name, &trial.normalisation().fallbacks);
        Ok(Sample { name, context, targets, distances: None })
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
        self.config.description()
    }

    fn data_warnings(&self) -> DataWarnings {
        DataWarnings::of(self.identity.clone(), self.counted().warnings.clone())
    }

    fn replaced(&self) -> ReplacedDraws {
        self.counted().replaced.clone()
    }

    fn replaced_count(&self) -> u64 {
        self.counted().replaced.count
    }

    fn unstable_poses(&self) -> UnstablePoses {
        self.counted().unstable.clone()
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
