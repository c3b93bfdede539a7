//! The training and held-out views, and the Gaussians to start from.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use atsplat_camera::{Distortion, ImageSize};
use atsplat_eval::fitting::{PointsOf, Start, StartError, StartGaussians, common_size, fit_recipe};
use atsplat_eval::reconstruct::{
    NetworkSource, PhotoSelection, Photos, ReconstructError, WeightsRecord, rendered_scene,
};
use atsplat_fit::{FitConfig, FitError, TrainingView};
use atsplat_model::network::Device;
use atsplat_model::weights::ModelWeights;
use atsplat_scene::nerfstudio::AppliedTransform;
use atsplat_scene::{FrameSelection, Scene, SceneSource as _, Warnings};

use super::OptimisationArgs;
use crate::dataset_args::ImageArgs;
use crate::embedded;
use crate::parse;
use crate::print::warn;
use crate::reconstruct::input::{is_size_error, scene};

#[derive(Debug, clap::Args)]
pub(super) struct InputArgs {
    /// Posed photos: RE10K trajectories with frames, `.torch` chunks, a `transforms.json`, a COLMAP model, a folder of
    /// them, or the `render.json` that `atsplat render` wrote next to its images.
    pub(super) data: PathBuf,

    /// Photos to optimise for, counted from 0 in the dataset's order: `9,126`, `0..50:10`, `..` for all; without those that
    /// are held out.
    #[arg(long, value_name = "SEL", required = true)]
    views: FrameSelection,

    /// Photos to compare renders with, which the optimisation does not see: `..:8` for every eighth.
    #[arg(long, value_name = "SEL")]
    held_out: Option<FrameSelection>,

    /// At the end, compare with the held-out photos at these multiples of their size too: `0.25,4` zooms out and in. No photo is
    /// enlarged.
    #[arg(long, value_name = "LIST", requires = "held_out", value_delimiter = ',', value_parser = parse::positive)]
    scales: Vec<f64>,

    /// Which scene of DATA, if it holds several.
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
}

#[derive(Debug, clap::Args)]
pub(super) struct StartArgs {
    /// Gaussians to start from: random:N (points seen by the cameras), points (COLMAP's, of the model in DATA), a folder with
    /// a points3D file, or a file of Gaussians (.ply, .spz, .splat).
    #[arg(long, value_name = "START", default_value = "random:10000", conflicts_with = "refine")]
    start: String,

    /// Nearest and farthest depth of random points, in scene units; by default around the point that the cameras look at.
    #[arg(long, value_name = "NEAR,FAR", conflicts_with = "refine", value_parser = depths)]
    depths: Option<[f64; 2]>,

    /// Read opacities of the file to start from as opacities, not logits, as written by the exporters of pixelSplat and
    /// NoPoSplat.
    #[arg(long, conflicts_with = "refine")]
    opacities_as_stored: bool,

    /// Start from what this network makes of the photos: a weights file, or micro-rooms or micro-yards, which are embedded in
    /// the binary. The strategy is then by default `fixed`.
    #[arg(long, value_name = "WEIGHTS")]
    pub(super) refine: Option<PathBuf>,
}

fn depths(text: &str) -> Result<[f64; 2], String> {
    let numbers = text.split_once(',').map(|(near, far)| (parse::positive(near), parse::positive(far)));
    match numbers {
        Some((Ok(near), Ok(far))) if near <= far => Ok([near, far]),
        _ => Err(format!("expected two positive lengths, the nearer first, such as 0.5,20, found {text:?}")),
    }
}

/// The photos with their images.
pub(super) struct Input {
    /// The scene that they are of.
    pub(super) scene: Scene,
    pub(super) photos: Photos,
    pub(super) training: Vec<TrainingView>,
    pub(super) held_out: Vec<TrainingView>,
    /// The held-out views at multiples of their size.
    pub(super) scaled: Vec<(f64, Vec<TrainingView>)>,
}

impl InputArgs {
    /// Reads the photos; for a network they are prepared as for its reconstructions.
    pub(super) fn read(&self, network: Option<&NetworkSource>, warnings: &mut Warnings) -> anyhow::Result<Input> {
        let mut scene: Scene = scene(&self.data, &self.images, self.key.as_deref(), warnings)?;
        if self.no_distortion {
            scene.frames.iter_mut().for_each(|frame| frame.camera.distortion = Distortion::None);
        }
        let count = scene.frames.len();
        let targets = self.held_out.as_ref().map(|held_out| held_out.of(count)).transpose().context("--held-out")?;
        let targets = targets.unwrap_or_default();
        let mut context = self.views.of(count).context("--views")?;
        context.retain(|frame| !targets.contains(frame));
        if context.is_empty() {
            bail!("--views: all of them are held out");
        }
        let selection = PhotoSelection { context, targets };
        let prepared = |size, warnings: &mut Warnings| {
            let recipe = fit_recipe(size, network.map(|source| &source.config));
            Photos::new(scene.clone(), selection.clone(), recipe, warnings)
        };
        let photos = prepared(self.size, warnings).map_err(|error| self.with_size_context(network, error))?;
        let (training, held_out) = (photos.training_views()?, photos.held_out_views()?);
        let mut scaled = Vec::new();
        for &scale in &self.scales {
            let common = common_size(&held_out);
            let common = common.context("--scales: held-out photos have several sizes; give them one by --size")?;
            let at_scale = || format!("--scales {scale}");
            let size = common.scaled(scale).with_context(at_scale)?;
            // Everything but the size was checked, and warned of, above.
            let photos = prepared(Some(size), &mut Warnings::new()).with_context(at_scale)?;
            scaled.push((scale, photos.held_out_views()?));
        }
        Ok(Input { scene, photos, training, held_out, scaled })
    }

    /// The transform that nerfstudio applied to the cameras of a scene, but not to COLMAP's points.
    fn applied_transform(&self, scene: &str) -> anyhow::Result<Option<AppliedTransform>> {
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

impl StartArgs {
    /// Rejects an invalid --start, --depths without random points, and --opacities-as-stored without a file of Gaussians.
    pub(super) fn check(&self) -> Result<(), clap::Error> {
        let start = self.start.parse::<Start>();
        let start = start.map_err(|error| parse::usage_error(format!("--start: {error}; N is at least 1")))?;
        let is_file = matches!(&start, Start::At(path) if !path.is_dir());
        if self.depths.is_some() && !matches!(start, Start::Random(_)) {
            return Err(parse::usage_error(format!("--depths is for random points, found --start {}", self.start)));
        }
        if self.opacities_as_stored && !is_file {
            let found = format!("--opacities-as-stored is for a file of Gaussians, found --start {}", self.start);
            return Err(parse::usage_error(found));
        }
        Ok(())
    }

    /// What is read unless a network makes the start: a file or a folder, if there is one of this name.
    pub(super) fn path(&self) -> Option<&Path> {
        self.refine.is_none().then(|| Path::new(&self.start))
    }

    /// For the record, with the weights of a refinement: another file may have had their path before.
    fn name(&self, weights: Option<&WeightsRecord>) -> String {
        if let Some(path) = &self.refine {
            let hash = match weights {
                Some(WeightsRecord::File { sha256, .. }) => format!(", sha256 {sha256}"),
                Some(WeightsRecord::Untrained { .. }) | None => String::new(),
            };
            return format!("network {}{hash}", path.display());
        }
        let depths = self.depths.map_or_else(String::new, |[near, far]| format!(", depths {near},{far}"));
        let stored = if self.opacities_as_stored { ", opacities as stored" } else { "" };
        [self.start.as_str(), &depths, stored].concat()
    }

    /// The network of a refinement.
    pub(super) fn network(&self) -> anyhow::Result<Option<NetworkSource>> {
        let Some(path) = &self.refine else { return Ok(None) };
        let expected = || "a weights file of this toolkit, micro-rooms or micro-yards".to_owned();
        let file = embedded::find(path, expected)?;
        let config = ModelWeights::config_of(&file.stored).map_err(|error| error.in_file(path))?;
        Ok(Some(NetworkSource::from_file(config.clone(), path.clone(), file, config)))
    }

    /// The Gaussians to start from, in the frame of the views, for a configuration that comes from some options; and their name for
    /// the record. Warns of what is wrong with their file.
    pub(super) fn gaussians(
        &self,
        input: &Input,
        args: &InputArgs,
        network: Option<(&NetworkSource, Device)>,
        (config, options): (&FitConfig, &OptimisationArgs),
    ) -> anyhow::Result<(StartGaussians, String)> {
        if let Some((source, device)) = network {
            let (network, weights) = source.load(&device)?;
            let made = network.reconstruct(&input.photos.views()?, config.seed).context("--refine")?;
            return Ok((made.gaussians.into(), self.name(Some(&weights))));
        }
        let start = self.start.parse::<Start>().context("--start")?;
        let applied = if start.reads_points() { args.applied_transform(&input.scene.key) } else { Ok(None) };
        let applied = applied.with_context(|| format!("--start {}", self.start))?;
        let of = PointsOf { data: &args.data, scene: &input.scene, applied };
        let made = start.gaussians(&input.training, of, self.depths, self.opacities_as_stored, config);
        let made = made.map_err(|error| match error {
            StartError::Fit(error @ FitError::Setting { name: "depths", .. }) => {
                anyhow::Error::from(error).context(format!("--start {} needs --depths NEAR,FAR", self.start))
            }
            StartError::Fit(error) => options.with_option(error),
            unread => anyhow::Error::from(unread).context(format!("--start {}", self.start)),
        })?;
        for warning in &made.warnings {
            warn(&format!("--start {}: {warning}", self.start));
        }
        Ok((made, self.name(None)))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn a_start_is_recorded_with_all_that_decides_it() {
        let start = |depths: Option<[f64; 2]>, opacities_as_stored: bool, refine: Option<&str>| {
            let (start, refine) = ("start".to_owned(), refine.map(PathBuf::from));
            StartArgs { start, depths, opacities_as_stored, refine }
        };
        assert_eq!(start(None, false, None).name(None), "start");
        assert_eq!(start(Some([0.5, 20.0]), false, None).name(None), "start, depths 0.5,20");
        assert_eq!(start(None, true, None).name(None), "start, opacities as stored");
        let refined = start(None, false, Some("weights"));
        for sha256 in ["ab", "cd"] {
            let (file, hash, provenance) = (PathBuf::from("weights"), sha256.to_owned(), BTreeMap::new());
            let weights = WeightsRecord::File { file, sha256: hash, provenance };
            assert_eq!(refined.name(Some(&weights)), format!("network weights, sha256 {sha256}"));
        }
    }
}
