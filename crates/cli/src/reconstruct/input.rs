//! The input photos: dataset, context and target views, and preprocessing of images and poses.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use atsplat_camera::{Distortion, ImageSize as CameraSize};
use atsplat_eval::reconstruct::{InputRecord, PhotoSelection, Photos, photo_recipe, rendered_scene};
use atsplat_model::ModelConfig;
use atsplat_protocol::Preset;
use atsplat_protocol::trial::TrialRecipe;
use atsplat_scene::{FrameSelection, Scene, SceneSource as _, Warnings, scene_key};

use crate::dataset_args::PictureArgs;
use crate::parse;

#[derive(Debug, clap::Args)]
pub(super) struct InputArgs {
    /// Posed photos: RE10K trajectories with frames, `.torch` chunks, a `transforms.json`, a COLMAP model, a folder of
    /// them, or the `render.json` that `atsplat render` wrote next to its images.
    data: PathBuf,

    /// Photos to reconstruct from, counted from 0 in the dataset's order: `9,126`, `0..50:10`, `..` for all.
    #[arg(long, value_name = "SEL", required = true)]
    views: FrameSelection,

    /// Further views to render, counted in the same way; without --plots only the size of their photos is read.
    #[arg(long, value_name = "SEL")]
    targets: Option<FrameSelection>,

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
    #[arg(long, value_name = "WxH")]
    size: Option<CameraSize>,

    /// Ignore lens distortion in DATA, as the papers do.
    #[arg(long)]
    no_distortion: bool,
}

impl InputArgs {
    pub(super) const fn has_targets(&self) -> bool {
        self.targets.is_some()
    }

    /// Finds the scene and prepares cameras; no image is decoded.
    pub(super) fn read(&self, config: &ModelConfig, warnings: &mut Warnings) -> anyhow::Result<Photos> {
        let mut scene = scene(&self.data, &self.pictures, self.key.as_deref(), warnings)?;
        if self.no_distortion {
            scene.frames.iter_mut().for_each(|frame| frame.camera.distortion = Distortion::None);
        }
        let count = scene.frames.len();
        let context = self.views.of(count).context("--views")?;
        let targets = self.targets.as_ref().map(|targets| targets.of(count)).transpose().context("--targets")?;
        let selection = PhotoSelection { context, targets: targets.unwrap_or_default() };
        Ok(Photos::new(scene, selection, self.recipe(config)?, warnings)?)
    }

    /// The recipe of the protocol, or one that suits any photos.
    fn recipe(&self, config: &ModelConfig) -> anyhow::Result<TrialRecipe> {
        Ok(match &self.protocol {
            Some(name) => TrialRecipe::of(&Preset::resolve(name)?, "ATSplat"),
            None => photo_recipe(self.size.map_or(config.resolution, Into::into)),
        })
    }

    pub(super) fn record(&self, photos: &Photos) -> InputRecord {
        InputRecord::new(photos, self.data.clone(), self.protocol.clone())
    }
}

/// The scene of a dataset, or the output of `atsplat render`.
pub(crate) fn scene(
    data: &Path,
    pictures: &PictureArgs,
    key: Option<&str>,
    warnings: &mut Warnings,
) -> anyhow::Result<Scene> {
    if let Some(scene) = rendered_scene(data)? {
        return Ok(scene);
    }
    let dataset = pictures.open(data, warnings)?;
    Ok(dataset.load(scene_key(&dataset, key)?, warnings)?)
}
