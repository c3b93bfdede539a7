//! The input photos: dataset, context and target views, and preprocessing of images and poses.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context as _, bail};
use atsplat_camera::{Distortion, ImageSize as CameraSize, PrincipalPointRule};
use atsplat_eval::network_views;
use atsplat_model::network::Views;
use atsplat_model::{ImageSize, ModelConfig};
use atsplat_pixels::{DecodeLimits, ImageU8};
use atsplat_protocol::trial::{DecodeAhead, Prefetch, TargetPictures, Trial, TrialRecipe, Trials};
use atsplat_protocol::{EvaluationIndex, Filters, IndexEntry, MeanCameraScale, NearFar, PoseNormalisation, Preset};
use atsplat_scene::preprocess::{Preprocessing, RescaleAndCrop};
use atsplat_scene::{Scene, SceneError, SceneSource, Warnings};
use indexmap::IndexMap;
use rayon::prelude::*;

use super::report::{InputRecord, ViewRecord};
use super::{model_size, rendered};
use crate::dataset_args::{PictureArgs, key_of};
use crate::parse;
use crate::selection::Selection;

pub(super) const NO_DISTORTION: Distortion = Distortion::None;

/// iLRM's planes in the normalised world, which the presets infer for ATSplat too.
const NEAR_FAR: NearFar = NearFar { near: 0.01, far: 500.0 };

#[derive(Debug, clap::Args)]
pub(super) struct InputArgs {
    /// Posed photos: RE10K trajectories with frames, `.torch` chunks, a `transforms.json`, a COLMAP model, a folder of
    /// them, or the `render.json` that `atsplat render` wrote next to its images.
    data: PathBuf,

    /// Photos to reconstruct from, counted from 0 in the dataset's order: `9,126`, `0..50:10`, `..` for all.
    #[arg(long, value_name = "SEL", required = true)]
    views: Selection,

    /// Further views to render, counted in the same way; without --plots only the size of their photos is read.
    #[arg(long, value_name = "SEL")]
    targets: Option<Selection>,

    /// Which scene of DATA, if it holds several.
    #[arg(long, value_name = "KEY")]
    key: Option<String>,

    #[command(flatten)]
    pictures: PictureArgs,

    /// Crop, resize and normalise as in this protocol: a name of `atsplat protocol list`, or a path that ends in .toml.
    /// By default photos are scaled and cropped to the model's size with the principal point corrected for the crop, and
    /// poses are normalised to the mean camera with Long-LRM's scale.
    #[arg(long, value_name = "PRESET", value_parser = parse::preset, conflicts_with = "size")]
    protocol: Option<String>,

    /// Size of the images given to the network; by default the model's resolution.
    #[arg(long, value_name = "WxH", value_parser = parse::size)]
    size: Option<CameraSize>,

    /// Ignore lens distortion in DATA, as the papers do.
    #[arg(long)]
    no_distortion: bool,
}

/// The photos of one scene, prepared.
pub(super) struct Input {
    pub(super) trial: Trial,
    /// Ground truth of the targets, which the network must not see.
    pub(super) truths: TargetPictures,
    names: IndexMap<usize, String>,
}

impl InputArgs {
    pub(super) const fn has_targets(&self) -> bool {
        self.targets.is_some()
    }

    /// Finds the scene and prepares cameras; no picture is decoded.
    pub(super) fn read(&self, config: &ModelConfig, warnings: &mut Warnings) -> anyhow::Result<Input> {
        let mut scene = self.scene(warnings)?;
        if self.no_distortion {
            scene.frames.iter_mut().for_each(|frame| frame.camera.distortion = NO_DISTORTION);
        }
        let count = scene.frames.len();
        let context = self.views.of("--views", count)?;
        let target = self.targets.as_ref().map(|targets| targets.of("--targets", count)).transpose()?;
        let entry = IndexEntry { context, target: target.unwrap_or_default(), overlap: None };
        let frames = entry.context.iter().chain(&entry.target);
        let name = |&frame: &usize| Some((frame, scene.frames.get(frame)?.name.clone()));
        let names = frames.filter_map(name).collect();
        let index = EvaluationIndex { scenes: IndexMap::from([(scene.key.clone(), vec![entry])]) };
        let source = Arc::new(OneScene { keys: vec![scene.key.clone()], scene });
        let no_prefetch = Prefetch { trials: 0, decode: DecodeAhead::Nothing, max_bytes: 0 };
        let mut trials = Trials::new(source, &index, self.recipe(config)?, no_prefetch);
        let trial = trials.next();
        warnings.merge(trials.warnings().clone());
        let (trial, truths) = trial.context("no context view")?.map_err(|skipped| anyhow::anyhow!("{skipped}"))?;
        Ok(Input { trial, truths, names })
    }

    fn scene(&self, warnings: &mut Warnings) -> anyhow::Result<Scene> {
        if let Some(scene) = rendered::open(&self.data)? {
            return Ok(scene);
        }
        let dataset = self.pictures.open(&self.data, warnings)?;
        Ok(dataset.load(key_of(&dataset, self.key.as_deref())?, warnings)?)
    }

    /// The recipe of the protocol, or one that suits any photos.
    fn recipe(&self, config: &ModelConfig) -> anyhow::Result<TrialRecipe> {
        if let Some(name) = &self.protocol {
            return Ok(TrialRecipe::of(&Preset::resolve(name)?, "ATSplat"));
        }
        let (width, height) = match self.size {
            Some(size) => (size.width, size.height),
            None => (u32::try_from(config.resolution.width)?, u32::try_from(config.resolution.height)?),
        };
        Ok(TrialRecipe {
            preprocessing: Preprocessing {
                principal_point: PrincipalPointRule::Corrected,
                ..Preprocessing::of([RescaleAndCrop::new(height, width).into()])
            },
            pose_normalisation: PoseNormalisation::mean_camera(MeanCameraScale::LongLrm),
            near_far: NEAR_FAR,
            filters: Filters::default(),
            decode_limits: DecodeLimits::default(),
            allow_absent_pictures: false,
        })
    }
}

impl Input {
    /// The common size of the context images.
    pub(super) fn size(&self) -> anyhow::Result<ImageSize> {
        let sizes = self.trial.context().iter().map(|view| (view.frame, view.size));
        let (first, size) = sizes.clone().next().context("no context view")?;
        if let Some((frame, other)) = sizes.clone().find(|(_, other)| *other != size) {
            bail!("expected context images of one size, found {size} in frame {first} and {other} in frame {frame}");
        }
        Ok(model_size(size))
    }

    /// Context images and cameras as network input.
    pub(super) fn views(&self) -> anyhow::Result<Views> {
        let decoded: Result<Vec<Arc<ImageU8>>, _> =
            self.trial.context().par_iter().map(atsplat_protocol::trial::ContextView::picture).collect();
        let cameras = self.trial.context().iter().map(|view| view.camera).collect();
        Ok(network_views(decoded?.iter().map(AsRef::as_ref), cameras)?)
    }

    /// The dataset's name of a frame.
    #[expect(clippy::expect_used, reason = "the trial has the frames whose names were kept")]
    pub(super) fn name(&self, frame: usize) -> String {
        self.names.get(&frame).cloned().expect("a name for every frame of the one entry")
    }

    pub(super) fn record(&self, args: &InputArgs) -> InputRecord {
        let trial = &self.trial;
        let view = |frame: usize| ViewRecord { frame, name: self.name(frame) };
        InputRecord {
            data: args.data.clone(),
            scene: trial.scene().to_owned(),
            views: trial.context().iter().map(|context| view(context.frame)).collect(),
            targets: trial.targets().iter().map(|target| view(target.frame)).collect(),
            trial: trial.hash(),
            protocol: args.protocol.clone(),
            preprocessing: trial.preprocessing().to_string(),
            normalisation: trial.normalisation().into(),
            near_far: trial.near_far(),
        }
    }
}

/// A dataset of one scene that is already loaded.
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
