//! The training and held-out views.

use std::path::PathBuf;

use anyhow::{Context as _, bail};
use atsplat_camera::{Distortion, ImageSize};
use atsplat_eval::fitting::{common_size, fit_recipe};
use atsplat_eval::reconstruct::{NetworkSource, PhotoSelection, Photos, ReconstructError, rendered_scene};
use atsplat_fit::{Background, TrainingView, TrainingViews};
use atsplat_scene::nerfstudio::AppliedTransform;
use atsplat_scene::{FrameSelection, Scene, SceneSource as _, Warnings};

use crate::alpha::Alpha;
use crate::dataset_args::{ImageArgs, photos_help};
use crate::parse;
use crate::reconstruct::input::{is_size_error, scene, selected};

#[derive(Debug, clap::Args)]
pub(super) struct InputArgs {
    #[arg(help = photos_help())]
    pub(super) data: PathBuf,

    /// Photos to optimise for, counted from 0 in the dataset's order: `9,126`, `0..50:10`, `..` for all. Held-out photos are
    /// excluded.
    #[arg(long, value_name = "SEL", required = true)]
    views: FrameSelection,

    /// Photos to compare renders with, which the optimisation does not see: `..:8` for every eighth.
    #[arg(long, value_name = "SEL")]
    held_out: Option<FrameSelection>,

    /// At the end, compare with the held-out photos at these multiples of their size too: `0.25,4` zooms out and in. No photo is
    /// enlarged.
    #[arg(long, value_name = "LIST", requires = "held_out", value_delimiter = ',', value_parser = parse::positive)]
    scales: Vec<f64>,

    /// Which scene of DATA, if it contains several.
    #[arg(long, value_name = "KEY")]
    key: Option<String>,

    #[command(flatten)]
    images: ImageArgs,

    /// Scale photos to cover this size, and crop them to it; by default they keep their size, and with --refine they have
    /// the model's resolution.
    #[arg(long, value_name = "WxH")]
    size: Option<ImageSize>,

    /// Ignore lens distortion in DATA.
    #[arg(long)]
    no_distortion: bool,

    /// Alpha channels of photos: drop them, so that transparent pixels keep their stored colour, or composite the photos over
    /// --background, black or white.
    #[arg(long, value_name = "HOW", default_value = "drop", value_parser = parse::named(Alpha::NAMES))]
    pub(super) alpha: Alpha,
}

/// The photos with their images.
pub(super) struct Input {
    /// The scene that they are of.
    pub(super) scene: Scene,
    pub(super) photos: Photos,
    pub(super) training: TrainingViews,
    pub(super) held_out: Vec<TrainingView>,
    /// The held-out views at multiples of their size.
    pub(super) scaled: Vec<(f64, Vec<TrainingView>)>,
}

impl InputArgs {
    /// Reads the photos; for a network they are prepared as for its reconstructions.
    pub(super) fn read(
        &self,
        network: Option<&NetworkSource>,
        background: Background,
        warnings: &mut Warnings,
    ) -> anyhow::Result<Input> {
        let mut scene: Scene = scene(&self.data, &self.images, self.key.as_deref(), None, warnings)?;
        if self.no_distortion {
            scene.frames.iter_mut().for_each(|frame| frame.camera.distortion = Distortion::None);
        }
        let targets = self.held_out.as_ref().map(|held_out| selected(held_out, &scene));
        let targets = targets.transpose().context("--held-out")?.unwrap_or_default();
        let mut context = selected(&self.views, &scene).context("--views")?;
        context.retain(|frame| !targets.contains(frame));
        if context.is_empty() {
            bail!("--views: all of these photos are held out");
        }
        let selection = PhotoSelection { context, targets };
        // Compositing requires black or white.
        let background = if background == Background::White { [255; 3] } else { [0; 3] };
        let shown = self.alpha.shown(scene.clone(), background);
        let prepared = |size, warnings: &mut Warnings| {
            let recipe = fit_recipe(size, network.map(|source| &source.config));
            Photos::new(shown.clone(), selection.clone(), recipe, warnings)
        };
        let photos = prepared(self.size, warnings).map_err(|error| self.with_size_context(network, error))?;
        let (training, held_out) = (photos.training_views()?, photos.held_out_views()?);
        let mut scaled = Vec::new();
        for &scale in &self.scales {
            let common = common_size(&held_out);
            let common = common.context("--scales: the held-out photos have several sizes; set one with --size")?;
            let at_scale = || format!("--scales {scale}");
            let size = common.scaled(scale).with_context(at_scale)?;
            // Everything but the size was checked, and warned of, above.
            let photos = prepared(Some(size), &mut Warnings::new()).with_context(at_scale)?;
            scaled.push((scale, photos.held_out_views()?));
        }
        let others = other_images(&training, &held_out, &scaled);
        let training = TrainingViews::from(training).with_other_images(others);
        Ok(Input { scene, photos, training, held_out, scaled })
    }

    /// The transform that nerfstudio applied to the cameras of a scene, but not to COLMAP's points.
    pub(super) fn applied_transform(&self, scene: &str) -> anyhow::Result<Option<AppliedTransform>> {
        if rendered_scene(&self.data)?.is_some() {
            return Ok(None);
        }
        // The dataset was opened, and warned of, before.
        Ok(self.images.open(&self.data, &mut Warnings::new())?.applied_transform(scene)?)
    }

    /// Adds which option set the size.
    fn with_size_context(&self, network: Option<&NetworkSource>, error: ReconstructError) -> anyhow::Error {
        let is_size_error = is_size_error(&error);
        let error = anyhow::Error::from(error);
        match (self.size, network) {
            (Some(ImageSize { width, height }), _) if is_size_error => {
                error.context(format!("--size {width}x{height}"))
            }
            (None, Some(source)) if is_size_error => {
                let size = &source.config.resolution;
                error.context(format!("--refine without --size scales photos to {}x{}", size.width, size.height))
            }
            _ => error,
        }
    }
}

/// Bytes of the images that stay in memory next to those that are trained on: the held-out ones at all of their sizes, and what the
/// photos were decoded to, a quarter of it, for the views of one size.
fn other_images(training: &[TrainingView], held_out: &[TrainingView], scaled: &[(f64, Vec<TrainingView>)]) -> u64 {
    let bytes = |views: &[TrainingView]| views.iter().map(TrainingView::bytes).fold(0, u64::saturating_add);
    let decoded = bytes(training).saturating_add(bytes(held_out)) / 4;
    let scaled = scaled.iter().map(|(_, views)| bytes(views)).fold(0, u64::saturating_add);
    [bytes(held_out), scaled].into_iter().fold(decoded, u64::saturating_add)
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics};
    use atsplat_splat::View;
    use glam::{DMat3, DVec3};

    use super::*;

    /// Twelve bytes per pixel, and three in the decoded photos, which have one size.
    #[test]
    fn held_out_and_decoded_images_are_counted() {
        let view = |width: u32, height: u32| {
            let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::ZERO).unwrap();
            let intrinsics = NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap();
            let view = View { camera: Camera::pinhole(pose, intrinsics), size: ImageSize { width, height } };
            TrainingView { name: String::new(), rgb: Vec::new(), view }
        };
        let training = [view(4, 5), view(4, 5)];
        assert_eq!(other_images(&training, &[], &[]), 3 * 40);
        let scaled = [(2.0, vec![view(6, 14)]), (0.5, vec![view(2, 3)])];
        assert_eq!(other_images(&training, &[view(3, 7)], &scaled), 3 * (40 + 21) + 12 * (21 + 84 + 6));
    }
}
