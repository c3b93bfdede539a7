//! The input photos: dataset, context and target views, and preprocessing of images and poses.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, ensure};
use atsplat_camera::{Distortion, ImageSize as CameraSize};
use atsplat_eval::reconstruct::{InputRecord, PhotoSelection, Photos, ReconstructError, photo_recipe, rendered_scene};
use atsplat_eval::sources::AlreadyCropped;
use atsplat_model::{ImageSize, ModelConfig};
use atsplat_protocol::Preset;
use atsplat_protocol::trial::{SkipReason, Skipped, TrialRecipe};
use atsplat_scene::{
    Frame, FrameImage, FrameSelection, OneScene, Scene, SceneSource, WarningKind, Warnings, scene_key,
};

use crate::alpha::Alpha;
use crate::dataset_args::{ImageArgs, photos_help};
use crate::parse;

#[derive(Debug, clap::Args)]
pub(super) struct InputArgs {
    #[arg(help = photos_help())]
    data: PathBuf,

    /// Photos to reconstruct from, counted from 0 in the dataset's order: `9,126`, `0..50:10`, `..` for all.
    #[arg(long, value_name = "SEL", required = true)]
    views: FrameSelection,

    /// Further views to render, counted in the same way; without --plots only the size of their photos is read.
    #[arg(long, value_name = "SEL")]
    targets: Option<FrameSelection>,

    /// Which scene of DATA, if it contains several.
    #[arg(long, value_name = "KEY")]
    key: Option<String>,

    #[command(flatten)]
    images: ImageArgs,

    /// Crop, resize and normalise as in this protocol: a name of `atsplat protocol list`, or a path that ends in .toml.
    /// By default photos are scaled and cropped to the model's size with the principal point corrected for the crop, and
    /// poses are normalised to the mean camera with Long-LRM's scale.
    #[arg(long, value_name = "PRESET", value_parser = parse::preset, conflicts_with = "size")]
    protocol: Option<String>,

    /// Accept images of any size, even if the protocol requires one; those of the size that it crops to are taken as already
    /// cropped, and their cameras are cropped accordingly.
    #[arg(long, requires = "protocol", conflicts_with = "size")]
    any_size: bool,

    /// Size of the images given to the network; by default the model's resolution.
    #[arg(long, value_name = "WxH")]
    size: Option<CameraSize>,

    /// Ignore lens distortion in DATA, as the papers do.
    #[arg(long)]
    no_distortion: bool,

    /// Alpha channels of photos: drop them, so that transparent pixels keep their stored colour, or composite the photos over
    /// --background.
    #[arg(long, value_name = "HOW", default_value = "drop", value_parser = parse::named(Alpha::NAMES))]
    alpha: Alpha,
}

impl InputArgs {
    pub(super) const fn has_targets(&self) -> bool {
        self.targets.is_some()
    }

    /// The dataset.
    pub(super) fn data(&self) -> &Path {
        &self.data
    }

    /// Whether photos are composited over a colour.
    pub(super) fn composites(&self) -> bool {
        self.alpha == Alpha::Composite
    }

    /// Finds the scene and prepares cameras; no image is decoded. `background` is what photos are composited over, if they are; `check`
    /// is given the frames, and which of them were chosen.
    pub(super) fn read(
        &self,
        config: &ModelConfig,
        background: [u8; 3],
        check: &dyn Fn(&[Frame], &PhotoSelection) -> anyhow::Result<()>,
        warnings: &mut Warnings,
    ) -> anyhow::Result<Photos> {
        let preset = self.protocol.as_deref().map(Preset::resolve).transpose()?;
        let expected_size = preset.as_ref().and_then(|preset| preset.preprocessing.expected_size);
        let expected_size = expected_size.filter(|_| !self.any_size);
        let mut scene = scene(&self.data, &self.images, self.key.as_deref(), expected_size, warnings)?;
        if self.no_distortion {
            scene.frames.iter_mut().for_each(|frame| frame.camera.distortion = Distortion::None);
        }
        let context = selected(&self.views, &scene).context("--views")?;
        let targets = self.targets.as_ref().map(|targets| selected(targets, &scene));
        let targets = targets.transpose().context("--targets")?;
        let selection = PhotoSelection { context, targets: targets.unwrap_or_default() };
        check(&scene.frames, &selection)?;
        let shown = self.alpha.shown(scene, background);
        let (scene, recipe) = self.prepared(shown, preset, config, warnings)?;
        match Photos::new(scene, selection, recipe, warnings) {
            Err(error) if self.protocol.is_none() && is_size_error(&error) => {
                let ImageSize { width, height } = self.size(config);
                Err(error).context(format!("photos scaled to {width}×{height} (--size, or the model's resolution)"))
            }
            photos => Ok(photos?),
        }
    }

    /// The size that photos get without a protocol.
    fn size(&self, config: &ModelConfig) -> ImageSize {
        self.size.map_or(config.resolution, Into::into)
    }

    /// The scene with the recipe of the protocol, or with one that suits any photos.
    fn prepared(
        &self,
        mut scene: Scene,
        preset: Option<Preset>,
        config: &ModelConfig,
        warnings: &mut Warnings,
    ) -> anyhow::Result<(Scene, TrialRecipe)> {
        let Some(mut preset) = preset else {
            return Ok((scene, photo_recipe(self.size(config))));
        };
        if self.any_size {
            let source: Arc<dyn SceneSource> = Arc::new(OneScene::new(scene.clone()));
            if let Some((cropped, adapted)) = AlreadyCropped::of(&source, &preset) {
                (scene, preset) = (cropped.load(&scene.key, warnings)?, adapted);
            } else {
                preset.preprocessing.expected_size = None;
            }
        }
        Ok((scene, TrialRecipe::of(&preset, "ATSplat")))
    }

    pub(super) fn record(&self, photos: &Photos, background: [u8; 3]) -> InputRecord {
        let any_size = if self.any_size { ", images of any size" } else { "" };
        let protocol = self.protocol.as_ref().map(|name| format!("{name}{any_size}"));
        let composited_over = self.composites().then_some(background);
        InputRecord { composited_over, ..InputRecord::new(photos, self.data.clone(), protocol) }
    }
}

/// Whether photos cannot be scaled and cropped to the requested size.
pub(crate) fn is_size_error(error: &ReconstructError) -> bool {
    matches!(error, ReconstructError::Skipped(Skipped { reason: SkipReason::Preprocessing, .. }))
}

/// The scene of a dataset, or the output of `atsplat render`, with a warning for each photo that is missing. If there are only copies of
/// other sizes of the listed photos, that of `expected_size` is used.
pub(crate) fn scene(
    data: &Path,
    images: &ImageArgs,
    key: Option<&str>,
    expected_size: Option<CameraSize>,
    warnings: &mut Warnings,
) -> anyhow::Result<Scene> {
    if let Some(scene) = rendered_scene(data)? {
        images.check(None)?;
        let (rendered, data) = (&scene.key, data.display());
        if let Some(key) = key {
            ensure!(key == rendered, "--key {key}: the output of `atsplat render` is one scene, {rendered} ({data})");
        }
        for (at, frame) in scene.frames.iter().enumerate() {
            if let FrameImage::Missing(path) = &frame.image {
                let detail = format!("frame {at}: no {}", path.display());
                warnings.push(WarningKind::MissingImage, rendered.as_str(), detail);
            }
        }
        return Ok(scene);
    }
    let dataset = images.open_for(data, expected_size, warnings)?;
    Ok(dataset.load(scene_key(&dataset, key)?, warnings)?)
}

/// The selected frames of a scene. Ranges leave out those without a photo or a usable pose, of which [`scene`] warns.
pub(crate) fn selected(selection: &FrameSelection, scene: &Scene) -> anyhow::Result<Vec<usize>> {
    let is_usable = |frame: &Frame| !frame.image.is_missing() && frame.has_pose();
    let picked = selection.of_available(scene.frames.len(), |at| scene.frames.get(at).is_some_and(is_usable))?;
    ensure!(!picked.is_empty(), "none of these frames has a photo and a usable pose");
    Ok(picked)
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics};

    use super::*;

    /// Of frames that are named one by one, the error names the one that cannot be used.
    #[test]
    fn ranges_leave_out_frames_without_a_photo_or_a_usable_pose() {
        let photo = |at: usize| FrameImage::File(format!("{at}.png").into());
        let camera = Camera::pinhole(CameraFromWorld::IDENTITY, NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).unwrap());
        let images =
            [photo(0), FrameImage::Missing("1.png".into()), photo(2), photo(3).unposed("no rotation"), photo(4)];
        let frame = |image| Frame { name: String::new(), timestamp_micros: None, camera, stated_size: None, image };
        let scene = Scene { key: "s".to_owned(), url: None, frames: images.map(frame).to_vec() };
        let picked = |selection: &str| selected(&selection.parse().unwrap(), &scene);
        assert_eq!(picked("..").unwrap(), [0, 2, 4]);
        assert_eq!(picked("3,0..3").unwrap(), [3, 0, 2]);
        let error = picked("3..4").unwrap_err().to_string();
        assert_eq!(error, "none of these frames has a photo and a usable pose");
    }
}
