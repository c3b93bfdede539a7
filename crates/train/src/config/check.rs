//! Checks that a configuration can train, before anything is simulated or read.

use std::num::NonZeroUsize;

use atsplat_camera::{Camera, CameraFromWorld, ImageSize as PixelSize, NormalizedIntrinsics};
use atsplat_model::config::BlockExpansion;
use atsplat_model::{ImageSize, ModelConfig, ModelError};
use atsplat_numeric::SplitMix64;
use atsplat_protocol::samplers::SceneViews;
use atsplat_protocol::{NoEntry, Preset};
use atsplat_rooms::Request;
use atsplat_scene::preprocess::Step;
use glam::{DMat3, DVec3};

use super::windows::views_field;
use super::{DataConfig, SourceConfig, TrainConfig, WHAT};
use crate::evaluation::require_memory;
use crate::samples::{DatasetConfig, RoomsConfig, ViewChoice};
use crate::{Parameters, TrainError};

/// A choice of frames is impossible if this many draws give none.
const DRAWS: u64 = 64;
/// Largest factor by which a copy of a capture's images is smaller.
const MAX_FACTOR: u32 = 64;
/// Largest number of rays per pixel for simulated scenes.
const MAX_RAYS: u32 = 256;

impl TrainConfig {
    /// Every source with the path of its field: those of the training, then that of the evaluation.
    pub(crate) fn sources(&self) -> impl Iterator<Item = (String, &SourceConfig)> {
        let data = self.data.iter().enumerate().map(|(at, data)| (format!("data[{at}].source"), &data.source));
        data.chain(self.evaluation.iter().map(|evaluation| ("evaluation.source".to_owned(), &evaluation.source)))
    }

    /// Checks that do not need the network or its files.
    pub(super) fn check_sources(&self) -> Result<(), TrainError> {
        if self.data.is_empty() {
            return invalid("data".to_owned(), "at least one source", "none");
        }
        for (at, DataConfig { share, source }) in self.data.iter().enumerate() {
            if !(*share > 0.0 && share.is_finite()) {
                return invalid(format!("data[{at}].share"), "a positive number", share);
            }
            let warm_up = source.views().gaps.warm_up_steps;
            if warm_up > 0 && self.distinct.is_some() {
                let views = views_field(&format!("data[{at}].source"), source);
                let field = format!("{views}.gaps.warm-up-steps");
                return invalid(field, "0 with `distinct`, because samples do not repeat while gaps grow", warm_up);
            }
        }
        for (field, source) in self.sources() {
            match source {
                SourceConfig::Rooms(rooms) => check_rooms(&format!("{field}.rooms"), rooms)?,
                SourceConfig::Dataset(_) if self.losses.distance_weight > 0.0 && field.starts_with("data") => {
                    return invalid(
                        field,
                        "simulated scenes, as losses.distance-weight needs exact distances",
                        "a dataset",
                    );
                }
                SourceConfig::Dataset(dataset) => check_dataset(&format!("{field}.dataset"), dataset)?,
            }
        }
        Ok(())
    }

    /// Checks of new runs only: those that earlier versions started go on as they began.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] with the field; errors of the network's configuration.
    pub(crate) fn check_new_run(&self) -> Result<(), TrainError> {
        self.check_windows()?;
        self.check_scores(&self.model.config()?)
    }

    /// Side in pixels of the patches whose exact distances the loss needs, if it needs any.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] if the network has no anchors; errors of the network's configuration.
    pub(super) fn distance_patch(&self) -> Result<Option<NonZeroUsize>, TrainError> {
        if self.losses.distance_weight <= 0.0 {
            return Ok(None);
        }
        let model = self.model.config()?;
        if !model.anchors.design.has_anchors() {
            let expected = "0 for a network without anchors";
            return invalid("losses.distance-weight".to_owned(), expected, self.losses.distance_weight);
        }
        Ok(NonZeroUsize::new(model.coarse.patch_size * model.coarse.image_downscale))
    }

    /// Checks the configuration against its network: patches divide the images of every source of known image size, those of the training
    /// have the scale of the network's resolution, the evaluation's samples fit into memory, samples of a micro-batch expand as many tokens,
    /// only a frozen backbone has a file, and the network has the parts that are to be initialised.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] with the field; [`TrainError::InField`] for a preset that cannot be read.
    pub(crate) fn check_model(&self, model: &ModelConfig) -> Result<(), TrainError> {
        self.distance_patch()?;
        if let Some(backbone) = self.model.backbone.as_ref().filter(|_| !model.backbone.is_frozen()) {
            let expected = "none, as the network has no frozen backbone";
            return invalid("model.backbone".to_owned(), expected, backbone.display());
        }
        Parameters::check_fresh(model, &self.model.fresh)?;
        let shorter = |size: ImageSize| size.height.min(size.width);
        // Those of the training come first.
        for (at, (field, source)) in self.sources().enumerate() {
            let (field, Some(size)) = sized(&field, source)? else { continue };
            check_size(&field, size, model)?;
            if let Some(evaluation) = self.evaluation.as_ref().filter(|_| at == self.data.len()) {
                let ViewChoice { context: [_, most], targets, .. } = source.views();
                require_memory(evaluation.samples.get(), most.get().saturating_add(targets.get()), size)?;
            }
            // Inference resizes images to the scale of the model's resolution, so those of the training must have that scale too.
            if at < self.data.len() && shorter(size) != shorter(model.resolution) {
                let expected = format!("the shorter side of the model's resolution, {}", model.resolution);
                return invalid(field, &expected, size);
            }
        }
        let expansions = model.decoder.blocks.iter().filter_map(|block| block.expansion.as_ref());
        let by_threshold = expansions.filter(|expansion| matches!(expansion, BlockExpansion::Threshold(_))).count();
        if self.micro_batch.get() > 1 && by_threshold > 0 {
            let expected =
                "1 for a network that expands by thresholds, which select a different number of tokens in each sample";
            return invalid("micro-batch".to_owned(), expected, self.micro_batch);
        }
        Ok(())
    }
}

/// The field that decides the size of a source's images, and that size, if it is known before one is read.
pub(super) fn sized(field: &str, source: &SourceConfig) -> Result<(String, Option<ImageSize>), TrainError> {
    Ok(match source {
        SourceConfig::Rooms(rooms) => (format!("{field}.rooms.size"), Some(rooms.size)),
        SourceConfig::Dataset(dataset) => {
            let field = format!("{field}.dataset.preset");
            let preset = Preset::resolve(&dataset.preset);
            let preset = preset.map_err(|error| TrainError::from(error).in_field(field.as_str()))?;
            (field, size_of(&preset))
        }
    })
}

/// Size of a protocol's preprocessed images, if the protocol states the source size or brings any image to one size.
fn size_of(preset: &Preset) -> Option<ImageSize> {
    let preprocessing = &preset.preprocessing;
    let size = match (preprocessing.expected_size, preprocessing.steps.last()) {
        (Some(source), _) => preprocessing.plan(source).ok()?.output(),
        (None, Some(Step::RescaleAndCrop(last))) => PixelSize { width: last.width, height: last.height },
        (None, Some(Step::CentreCrop(last))) => PixelSize { width: last.width, height: last.height },
        (None, Some(Step::Resize(last))) => PixelSize { width: last.width, height: last.height },
        (None, _) => return None,
    };
    Some(size.into())
}

/// Why a network does not train on images of this size: its patches do not divide them, or they have another scale than its
/// resolution, to which inference resizes images.
pub(crate) fn size_problem(size: ImageSize, model: &ModelConfig) -> Option<String> {
    let shorter = |size: ImageSize| size.height.min(size.width);
    let expected = match model.coarse_grid(size).and_then(|_| model.fine_grid(size)) {
        Ok(_) if shorter(size) == shorter(model.resolution) => return None,
        Ok(_) => format!("the shorter side of the model's resolution, {}", model.resolution),
        Err(ModelError::Indivisible { branch, step, .. }) => {
            format!("a height and width divisible by {step}, the side of the {branch} branch's patches")
        }
        Err(other) => return Some(other.to_string()),
    };
    Some(format!("size of the images: expected {expected}, found {size}"))
}

fn check_size(field: &str, size: ImageSize, model: &ModelConfig) -> Result<(), TrainError> {
    match model.coarse_grid(size).and_then(|_| model.fine_grid(size)) {
        Err(ModelError::Indivisible { branch, step, found }) => {
            let expected = format!("a height and width divisible by {step}, the side of the {branch} branch's patches");
            invalid(field.to_owned(), &expected, found)
        }
        Err(other) => Err(other.into()),
        Ok(_) => Ok(()),
    }
}

fn check_dataset(field: &str, dataset: &DatasetConfig) -> Result<(), TrainError> {
    if let Some(factor) = dataset.images.filter(|factor| !(1..=MAX_FACTOR).contains(factor)) {
        let expected = format!("1 for `images`, or the factor of a smaller copy, at most {MAX_FACTOR}");
        return invalid(format!("{field}.images"), &expected, factor);
    }
    check_views(&format!("{field}.views"), &dataset.views)
}

fn check_rooms(field: &str, rooms: &RoomsConfig) -> Result<(), TrainError> {
    if !(1..=MAX_RAYS).contains(&rooms.samples) {
        return invalid(format!("{field}.samples"), &format!("1 to {MAX_RAYS} rays a pixel"), rooms.samples);
    }
    if rooms.first.checked_add(rooms.scenes.get() - 1).is_none() {
        let found = format!("{} scenes from {} on", rooms.scenes, rooms.first);
        return invalid(format!("{field}.first"), &format!("scenes up to number {}", u32::MAX), found);
    }
    let views = format!("{field}.views");
    check_views(&views, &rooms.views)?;
    let seed = atsplat_rooms::SceneSeed { split: rooms.split, number: rooms.first };
    let offered = Request::new(rooms.scenes_of, seed).frames.div_ceil(rooms.stride.get());
    for (step, context) in rooms.views.extremes() {
        if let Err(error) = try_draws(&rooms.views, context, offered, step) {
            let expected =
                format!("windows that fit into the {offered} frames of a clip at a stride of {}", rooms.stride);
            return invalid(views, &expected, format!("{error}, for {context} context views at step {step}"));
        }
    }
    Ok(())
}

/// Runs the sampler with this many context views on a camera that moves along a line; the error of the last draw if no draw
/// gives a sample.
fn try_draws(views: &ViewChoice, context: NonZeroUsize, frames: usize, step: u64) -> Result<(), NoEntry> {
    #[expect(clippy::expect_used, reason = "a camera without rotation, of unit focal length")]
    let camera = |at: usize| {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-(at as f64), 0.0, 0.0)).expect("a pose");
        Camera::pinhole(pose, NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).expect("intrinsics"))
    };
    let cameras: Vec<Camera> = (0..frames).map(camera).collect();
    let scene = SceneViews { key: "a line", cameras: &cameras };
    let mut random = SplitMix64::new(0);
    let mut draw = || views.draw_with(context, &scene, step, &mut random).map(drop);
    (1..DRAWS).fold(draw(), |outcome, _| outcome.or_else(|_error| draw()))
}

fn check_views(field: &str, views: &ViewChoice) -> Result<(), TrainError> {
    let [fewest, most] = views.context;
    if fewest.get() < 2 || fewest > most {
        let found = format!("{fewest} and {most}");
        return invalid(format!("{field}.context"), "fewest and most context views, at least 2", found);
    }
    let gaps = views.gaps;
    let bounds = [
        ("min and max", "gaps", gaps.min, gaps.max, true),
        ("initial-min and initial-max", "gaps", gaps.initial_min, gaps.initial_max, gaps.warm_up_steps > 0),
    ];
    for (names, group, min, max, counts) in bounds {
        if counts && (min > max || max == 0) {
            let expected = format!("{names} in order, the larger at least 1");
            return invalid(format!("{field}.{group}"), &expected, format!("{min} and {max}"));
        }
    }
    if gaps.warm_up_steps == 0 && (gaps.initial_min > 0 || gaps.initial_max > 0) {
        let expected = "a positive number if initial-min or initial-max is set";
        return invalid(format!("{field}.gaps.warm-up-steps"), expected, gaps.warm_up_steps);
    }
    match gaps.falling() {
        Some((names, initial, last)) => {
            let expected = format!("{names} in order, because windows grow during the warm-up");
            invalid(format!("{field}.gaps"), &expected, format!("{initial} and {last}"))
        }
        None => Ok(()),
    }
}

fn invalid<T>(field: String, expected: &str, found: impl ToString) -> Result<T, TrainError> {
    Err(TrainError::malformed(WHAT, field, expected, found))
}

#[cfg(test)]
mod tests {
    use atsplat_scene::preprocess::{CentreCrop, Resize};

    use super::*;

    /// By the shorter side, as inference resizes; of any image, as the preset scales and crops it to that size.
    #[test]
    fn images_of_a_dataset_have_the_scale_of_the_models_resolution() {
        let check = |model: &str, preset: &str| {
            let text = format!(
                "title = 'a dataset'\nseed = 1\nsteps = 8\nbatch = 3\nmodel = {{ base = '{model}' }}\n[[data]]\n\
                 [data.source.dataset]\npath = 'absent'\npreset = '{preset}'\n\
                 views = {{ context = [2, 2], targets = 1, gaps = {{ min = 1, max = 2 }} }}"
            );
            let config = TrainConfig::from_toml(&text).unwrap();
            config.check_model(&config.model.config().unwrap()).map_err(|error| error.to_string())
        };
        for (model, preset) in [("nano", "re10k-2v-256"), ("micro", "rooms-2v-128"), ("micro", "yards-2v-128x224")] {
            check(model, preset).unwrap();
        }
        let error = check("nano", "rooms-2v-128").unwrap_err();
        let expected = "the shorter side of the model's resolution, 256x256, found 128x128";
        assert!(error.contains("data[0].source.dataset.preset") && error.contains(expected), "{error}");
        // Whatever the last step is, if it brings any image to one size.
        let folder = tempfile::tempdir().unwrap();
        let mut custom = Preset::named("rooms-2v-128").unwrap();
        custom.name = "custom".to_owned();
        for (name, last) in
            [("crop", Step::from(CentreCrop::new(512, 512))), ("resize", Step::from(Resize::new(512, 512)))]
        {
            (custom.preprocessing.expected_size, custom.preprocessing.steps) = (None, vec![last]);
            let path = folder.path().join(format!("{name}.toml"));
            std::fs::write(&path, custom.to_toml().unwrap()).unwrap();
            let error = check("nano", &path.to_string_lossy()).unwrap_err();
            assert!(error.contains("256x256, found 512x512"), "{name}: {error}");
        }
        let error = check("micro", "photos-3v-256").unwrap_err();
        assert!(error.contains("128x128, found 256x256"), "{error}");
    }

    /// Of several sources, the one that is wrong is named, and so is the file when the configuration is read from one. Images of an
    /// evaluation may have another scale, but patches must divide them.
    #[test]
    fn the_source_with_images_of_another_scale_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.toml");
        let read = |first: &str, second: &str, evaluation: &str, share: &str| {
            let rooms = |size: &str| {
                format!(
                    "source.rooms = {{ scenes-of = 'rooms', scenes = 1, size = [{size}], \
                     views = {{ context = [2, 2], targets = 1, gaps = {{ min = 1, max = 2 }} }} }}"
                )
            };
            let (first, second, evaluation) = (rooms(first), rooms(second), rooms(evaluation));
            let text = format!(
                "title = 'two sources'\nseed = 1\nsteps = 8\nbatch = 1\nmodel = {{ base = 'micro' }}\n\
                 [[data]]\n{first}\n[[data]]\nshare = {share}\n{second}\n\
                 [evaluation]\nevery = 1\nsamples = 1\n{evaluation}"
            );
            std::fs::write(&path, text).unwrap();
            TrainConfig::read(&path).map(drop).map_err(|error| error.to_string())
        };
        read("128, 128", "224, 128", "64, 64", "2.0").unwrap();
        for (second, evaluation, share, field, expected) in [
            ("64, 64", "64, 64", "2.0", "data[1].source.rooms.size", "resolution, 128x128, found 64x64"),
            ("128, 128", "60, 64", "2.0", "evaluation.source.rooms.size", "found 60x64"),
            ("128, 128", "64, 64", "-2.0", "data[1].share", "a positive number, found -2"),
        ] {
            let error = read("128, 128", second, evaluation, share).unwrap_err();
            let field = format!("run.toml, field {field}: ");
            assert!(error.contains(&field) && error.contains(expected), "{error}");
        }
    }

    /// 8 GiB are enough for 58254 samples of 3 views of 64×64 in three channels of f32, and a quarter of that at 128×128.
    #[test]
    fn an_evaluation_fits_into_memory() {
        let check = |source: &str, samples: u64| {
            let views = "{ context = [2, 2], targets = 1, gaps = { min = 1, max = 2 } }";
            let text = format!(
                "title = 'an evaluation'\nseed = 1\nsteps = 8\nbatch = 1\nmodel = {{ base = 'micro' }}\n[[data]]\n\
                 source.rooms = {{ scenes-of = 'rooms', scenes = 1, size = [128, 128], views = {views} }}\n\
                 [evaluation]\nevery = 1\nsamples = {samples}\n[evaluation.source.{source}\nviews = {views}"
            );
            let config = TrainConfig::from_toml(&text).unwrap();
            config.check_model(&config.model.config().unwrap()).map_err(|error| error.to_string())
        };
        let rooms = "rooms]\nscenes-of = 'rooms'\nscenes = 1\nsize = [64, 64]";
        let dataset = "dataset]\npath = 'absent'\npreset = 'rooms-2v-128'";
        for (source, most) in [(rooms, 58_254), (dataset, 14_563)] {
            check(source, most).unwrap();
            for samples in [most + 1, 1_000_000_000_000, u64::from(u32::MAX) << 30] {
                let error = check(source, samples).unwrap_err();
                let expected = format!("evaluation.samples: expected at most {most}: ");
                assert!(error.contains(&expected) && error.ends_with(&format!("found {samples}")), "{error}");
            }
        }
    }

    #[test]
    fn samples_that_repeat_have_gaps_that_stay() {
        let read = |distinct: &str, source: &str| {
            let text = format!(
                "title = 'repeated'\nseed = 1\nsteps = 8\nbatch = 1\n{distinct}\nmodel = {{ base = 'nano' }}\n[[data]]\n\
                 [data.source.{source}\nviews = {{ context = [2, 2], targets = 1, \
                 gaps = {{ min = 2, max = 2, initial-min = 1, initial-max = 1, warm-up-steps = 4 }} }}"
            );
            TrainConfig::from_toml(&text).map(drop).map_err(|error| error.to_string())
        };
        for (kind, source) in [
            ("rooms", "rooms]\nscenes-of = 'rooms'\nscenes = 1\nsize = [256, 256]"),
            ("dataset", "dataset]\npath = 'absent'\npreset = 're10k-2v-256'"),
        ] {
            read("", source).unwrap();
            let error = read("distinct = 2", source).unwrap_err();
            let field = format!("data[0].source.{kind}.views.gaps.warm-up-steps");
            assert!(
                error.contains(&field) && error.contains("0 with `distinct`") && error.contains("found 4"),
                "{error}"
            );
        }
    }

    #[test]
    fn the_samples_of_a_micro_batch_must_expand_as_many_tokens() {
        let two = NonZeroUsize::new(2).unwrap();
        let config = TrainConfig { micro_batch: two, ..TrainConfig::shortest() };
        let by_ratio = config.model.config().unwrap();
        let by_threshold = by_ratio.with_thresholds(&[0.1; 3]).unwrap();
        config.check_model(&by_ratio).unwrap();
        let error = config.check_model(&by_threshold).unwrap_err().to_string();
        assert!(error.contains("micro-batch") && error.contains("found 2"), "{error}");
        TrainConfig { micro_batch: NonZeroUsize::MIN, ..config }.check_model(&by_threshold).unwrap();
    }
}
