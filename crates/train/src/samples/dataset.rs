use atsplat_numeric::SplitMix64;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

use atsplat_camera::{Camera, PoseNormalisation};
use atsplat_model::ImageSize;
use atsplat_pixels::ImageU8;
use atsplat_protocol::samplers::SceneViews;
use atsplat_protocol::trial::{DecodeAhead, Prefetch, TrialRecipe, Trials};
use atsplat_protocol::{EvaluationIndex, Preset};
use atsplat_scene::{Scene, SceneError, SceneSource, Warnings};
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

use super::{Draw, ExcludedScenes, Posed, Sample, Source, ViewChoice};
use crate::TrainError;

/// A dataset on disk under a protocol's preprocessing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct DatasetConfig {
    /// A file or folder of any format that `scene` reads.
    pub path: PathBuf,
    /// Name or path of the protocol whose preprocessing and filters apply.
    pub preset: String,
    /// Which frames become a sample.
    pub views: ViewChoice,
    /// Scenes that are never drawn: those of the indices that the network will be evaluated on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub exclude: Vec<ExcludedScenes>,
}

/// Scenes of a dataset, through the same code that makes an evaluation's trials.
pub struct DatasetSource {
    config: DatasetConfig,
    dataset: Box<dyn SceneSource>,
    /// Of the scenes that may be drawn.
    keys: Vec<String>,
    recipe: TrialRecipe,
}

impl DatasetSource {
    /// Opens the dataset; no scene is read yet. Cameras go through `normalisation`, not through the preset's.
    ///
    /// # Errors
    /// [`TrainError::Scene`], [`TrainError::Protocol`], [`TrainError::Malformed`] for a dataset without scenes.
    pub fn open(
        config: DatasetConfig,
        normalisation: PoseNormalisation,
        warnings: &mut Warnings,
    ) -> Result<Self, TrainError> {
        let dataset: Box<dyn SceneSource> = Box::new(atsplat_scene::open(&config.path, warnings)?);
        let mut excluded = BTreeSet::new();
        for scenes in &config.exclude {
            scenes.add_to(&mut excluded)?;
        }
        let keys: Vec<String> = dataset.keys().iter().filter(|key| !excluded.contains(*key)).cloned().collect();
        if keys.is_empty() {
            let place = config.path.display().to_string();
            let found = format!("{} scenes, all of them excluded", dataset.keys().len());
            return Err(TrainError::malformed("training data", place, "at least one scene to train on", found));
        }
        let recipe = TrialRecipe {
            pose_normalisation: normalisation,
            ..TrialRecipe::of(&Preset::resolve(&config.preset)?, "ATSplat")
        };
        Ok(Self { config, dataset, keys, recipe })
    }

    /// Keys of the scenes that may be drawn, in the dataset's order.
    pub fn keys(&self) -> &[String] {
        &self.keys
    }

    /// The trial of one scene and one draw of frames, or why there is none.
    fn try_sample(&self, key: &str, step: u64, random: &mut SplitMix64) -> Result<Sample, String> {
        let scene = self.dataset.load(key, &mut Warnings::new()).map_err(|error| error.to_string())?;
        let cameras: Vec<Camera> = scene.frames.iter().map(|frame| frame.camera).collect();
        let entry = self.config.views.draw(&SceneViews { key, cameras: &cameras }, step, random);
        let entry = entry.map_err(|error| format!("{key}: {error}"))?;
        let name = format!("{key}, frames {:?} to {:?}", entry.context, entry.target);
        let index = EvaluationIndex { scenes: IndexMap::from([(key.to_owned(), vec![entry])]) };
        let one = Arc::new(OneScene { keys: vec![key.to_owned()], scene });
        let prefetch = Prefetch { trials: 0, decode: DecodeAhead::Nothing, max_bytes: 0 };
        let trial = Trials::new(one, &index, self.recipe.clone(), prefetch).next();
        let (trial, truths) = match trial {
            Some(Ok(trial)) => trial,
            Some(Err(skipped)) => return Err(format!("{name}: {}", skipped.detail)),
            None => return Err(format!("{name}: no trial")),
        };
        let context = trial.context().iter().map(|view| Ok((view.camera, view.picture()?)));
        let targets = trial.targets().iter().zip(0..).filter_map(|(target, position)| {
            let picture = truths.get(position)?;
            Some(picture.map(|picture| (target.camera, picture)))
        });
        let said = |error: &atsplat_protocol::ProtocolError| format!("{name}: {error}");
        let context = posed(&context.collect::<Result<Vec<_>, _>>().map_err(|error| said(&error))?);
        let targets = posed(&targets.collect::<Result<Vec<_>, _>>().map_err(|error| said(&error))?);
        match (context, targets) {
            (Some(context), Some(targets)) => Ok(Sample { name, context, targets }),
            _ => Err(format!("{name}: expected pictures of one size")),
        }
    }
}

/// `None` where pictures differ in size or there are none.
fn posed(views: &[(Camera, Arc<ImageU8>)]) -> Option<Posed> {
    let size_of = |picture: &ImageU8| ImageSize::new(picture.height() as usize, picture.width() as usize);
    let size = views.first().map(|(_, picture)| size_of(picture))?;
    if views.iter().any(|(_, picture)| size_of(picture) != size) {
        return None;
    }
    let bytes = views.iter().flat_map(|(_, picture)| picture.samples());
    let pictures = bytes.map(|byte| f32::from(*byte) / 255.0).collect();
    Some(Posed { size, pictures, cameras: views.iter().map(|(camera, _)| *camera).collect() })
}

impl Source for DatasetSource {
    fn name(&self) -> String {
        format!("{} under {}", self.config.path.display(), self.config.preset)
    }

    fn sample(&self, draw: Draw) -> Result<Sample, TrainError> {
        const ATTEMPTS: u32 = 20;
        let mut reason = String::new();
        for attempt in 0..ATTEMPTS {
            let mut random = SplitMix64::for_scene(draw.seed, &format!("{} {} {attempt}", self.name(), draw.number));
            let Some(key) = random.within(0..=self.keys.len() - 1).and_then(|at| self.keys.get(at)) else { continue };
            match self.try_sample(key, draw.step, &mut random) {
                Ok(sample) => return Ok(sample),
                Err(why) => reason = why,
            }
        }
        Err(TrainError::NoSample { source_name: self.name(), attempts: ATTEMPTS, reason })
    }
}

impl std::fmt::Debug for DatasetSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DatasetSource").field("config", &self.config).finish_non_exhaustive()
    }
}

/// A dataset of the scene that was loaded already.
struct OneScene {
    keys: Vec<String>,
    scene: Scene,
}

impl SceneSource for OneScene {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn load(&self, _key: &str, _warnings: &mut Warnings) -> Result<Scene, SceneError> {
        Ok(self.scene.clone())
    }
}
