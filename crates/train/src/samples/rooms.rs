use atsplat_numeric::SplitMix64;
use std::collections::{HashMap, VecDeque};
use std::num::{NonZeroU32, NonZeroUsize};
use std::sync::{Arc, Mutex, PoisonError};

use atsplat_camera::{Camera, PoseNormalisation};
use atsplat_model::ImageSize;
use atsplat_pixels::Rounding;
use atsplat_protocol::samplers::SceneViews;
use atsplat_rooms::{EffectChoice, EffectKind, Request, SceneKind, SceneSeed, Simulation, Split};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    Draw, NormalisedCameras, PatchDistances, PosedPictures, Sample, Source, ViewChoice, distances, first_sample,
    normalised, pixel_size,
};
use crate::TrainError;

/// Simulated scenes, rendered when first needed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RoomsConfig {
    /// Kind of scene.
    pub scenes_of: SceneKind,
    /// Training or test scenes, which are always different.
    #[serde(default = "train")]
    pub split: Split,
    /// Number of different scenes.
    pub scenes: NonZeroU32,
    /// Index of the first scene.
    #[serde(default)]
    pub first: u32,
    /// Height and width of pictures, in pixels.
    pub size: ImageSize,
    /// Rays per pixel.
    #[serde(default = "four")]
    pub samples: u32,
    /// Every `stride`-th frame of a clip is offered; all offered frames are rendered when the scene is first needed.
    #[serde(default = "one")]
    pub stride: NonZeroUsize,
    /// Which frames become a sample; gaps count offered frames.
    pub views: ViewChoice,
    /// Memory for rendered frames, in MiB; scenes that do not fit are rendered again.
    #[serde(default = "gibibyte")]
    pub cache_mib: usize,
}

const fn train() -> Split {
    Split::Train
}

const fn four() -> u32 {
    4
}

const fn gibibyte() -> usize {
    1024
}

const fn one() -> NonZeroUsize {
    NonZeroUsize::MIN
}

/// Samples from simulated scenes, without lens distortion: the network and the papers' renderers assume pinhole cameras.
#[derive(Debug)]
pub struct RoomsSource {
    config: RoomsConfig,
    normalisation: PoseNormalisation,
    /// Side in pixels of the patches whose distances samples have.
    patch: Option<usize>,
    cache: Mutex<Cache>,
}

/// The offered frames of a scene.
#[derive(Debug)]
struct Clip {
    cameras: Vec<Camera>,
    /// 8-bit samples, as in a file.
    pictures: Vec<Vec<u8>>,
    /// Distances of each frame's patches, in metres; empty if samples have none.
    distances: Vec<Vec<f32>>,
}

/// Rendered clips; evicted ones are rendered again, identically.
#[derive(Debug, Default)]
struct Cache {
    clips: HashMap<u32, Arc<Clip>>,
    /// Oldest first.
    order: VecDeque<u32>,
    bytes: usize,
}

impl Clip {
    fn bytes(&self) -> usize {
        let distances = self.distances.iter().map(|distances| size_of_val(distances.as_slice()));
        self.pictures.iter().map(Vec::len).chain(distances).sum()
    }
}

impl RoomsSource {
    /// A source whose cameras are normalised by `normalisation`.
    pub fn new(config: RoomsConfig, normalisation: PoseNormalisation) -> Self {
        Self { config, normalisation, patch: None, cache: Mutex::default() }
    }

    /// Samples have the exact distances of context patches of so many pixels a side.
    #[must_use]
    pub fn with_distances(self, patch: NonZeroUsize) -> Self {
        Self { patch: Some(patch.get()), ..self }
    }

    /// The clip of a scene, from the cache or rendered; cameras are in the clip's world.
    fn clip(&self, number: u32) -> Result<Arc<Clip>, TrainError> {
        if let Some(cached) = self.with_cache(|cache| cache.clips.get(&number).cloned()) {
            return Ok(cached);
        }
        let clip = Arc::new(self.render_clip(number)?);
        self.with_cache(|cache| {
            if cache.clips.insert(number, Arc::clone(&clip)).is_none() {
                cache.order.push_back(number);
                cache.bytes += clip.bytes();
            }
            while cache.bytes > self.config.cache_mib << 20
                && let Some(oldest) = cache.order.pop_front()
            {
                #[expect(clippy::expect_used, reason = "both are filled together, above")]
                let clip = cache.clips.remove(&oldest).expect("the order lists clips that are kept");
                cache.bytes -= clip.bytes();
            }
        });
        Ok(clip)
    }

    fn render_clip(&self, number: u32) -> Result<Clip, TrainError> {
        let mut request = Request::new(self.config.scenes_of, SceneSeed { split: self.config.split, number });
        request.size = pixel_size(self.config.size);
        request.samples = self.config.samples;
        let mut simulation = Simulation::new(request.clone())?;
        let called: Vec<EffectKind> = simulation.called_effects().iter().map(|called| called.effect).collect();
        if called.contains(&EffectKind::LensDistortion) {
            let others = called.into_iter().filter(|kind| *kind != EffectKind::LensDistortion).collect();
            request.effects = EffectChoice::Only(others);
            simulation = Simulation::new(request)?;
        }
        let frames = || (0..simulation.shots().len()).step_by(self.config.stride.get());
        let cameras = frames().map(|frame| simulation.camera(frame)).collect::<Result<Vec<_>, _>>()?;
        let picture = |frame| Ok::<_, TrainError>(simulation.picture(frame)?.to_u8(Rounding::Nearest)?.into_samples());
        let pictures = frames().collect::<Vec<_>>().into_par_iter().map(picture).collect::<Result<_, _>>()?;
        let distances = |(frame, camera): (usize, &Camera)| {
            let patch = self.patch?;
            let geometry = simulation.geometry(frame);
            Some(geometry.map(|geometry| distances::of_view(camera, geometry.size, &geometry.depth, patch)))
        };
        let distances = frames().zip(&cameras).filter_map(distances).collect::<Result<_, _>>()?;
        Ok(Clip { cameras, pictures, distances })
    }

    /// A sample of one scene by one draw of frames, or why there is none.
    fn try_sample(&self, step: u64, random: &mut SplitMix64) -> Result<Result<Sample, String>, TrainError> {
        let last = self.config.scenes.get() as usize - 1;
        #[expect(clippy::expect_used, reason = "the range is not empty, and its end is a u32")]
        let offset = random.within(0..=last).and_then(|offset| u32::try_from(offset).ok()).expect("a scene index");
        let number = self.config.first.saturating_add(offset);
        let key = SceneSeed { split: self.config.split, number }.key(self.config.scenes_of);
        let clip = self.clip(number)?;
        let entry = match self.config.views.draw(&SceneViews { key: &key, cameras: &clip.cameras }, step, random) {
            Ok(entry) => entry,
            Err(error) => return Ok(Err(format!("{key}: {error}"))),
        };
        let of = |frames: &[usize]| frames.iter().map(|frame| clip.cameras[*frame]).collect::<Vec<Camera>>();
        let cameras = normalised(&of(&entry.context), &of(&entry.target), &self.normalisation);
        let sample = cameras.map(|NormalisedCameras { context, targets, scale }| Sample {
            name: format!("{key}, frames {:?} to {:?}", entry.context, entry.target),
            context: self.posed(&clip, &entry.context, context),
            targets: self.posed(&clip, &entry.target, targets),
            distances: self.patch.map(|patch| {
                let frames = entry.context.iter().flat_map(|frame| &clip.distances[*frame]);
                let columns = self.config.size.width / patch;
                PatchDistances { columns, distances: frames.copied().collect() }.scaled(scale)
            }),
        });
        Ok(sample.map_err(|error| format!("{key}: {error}")))
    }

    fn with_cache<T>(&self, work: impl FnOnce(&mut Cache) -> T) -> T {
        work(&mut self.cache.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn posed(&self, clip: &Clip, frames: &[usize], cameras: Vec<Camera>) -> PosedPictures {
        let bytes = frames.iter().flat_map(|frame| &clip.pictures[*frame]);
        PosedPictures {
            size: self.config.size,
            pictures: bytes.map(|byte| f32::from(*byte) / 255.0).collect(),
            cameras,
        }
    }
}

impl Source for RoomsSource {
    fn name(&self) -> String {
        let RoomsConfig { scenes_of, split, scenes, first, size, .. } = &self.config;
        let last = first.saturating_add(scenes.get() - 1);
        format!("{scenes_of} {split} {first} to {last} at {size}")
    }

    fn sample(&self, draw: Draw) -> Result<Sample, TrainError> {
        first_sample(self, &self.name(), draw, |random| self.try_sample(draw.step, random))
    }
}

#[cfg(test)]
mod tests {
    use atsplat_camera::MeanCameraScale;

    use super::*;

    #[test]
    fn rendered_clips_are_kept_until_the_memory_is_full() {
        let source = |mebibytes: usize| {
            let views = "{ context = [2, 2], targets = 1, gaps = { min = 1, max = 1 } }";
            let text = format!(
                "scenes-of = 'rooms'\nscenes = 9\nsize = [8, 8]\nsamples = 1\nstride = 40\ncache-mib = {mebibytes}\nviews = {views}"
            );
            let config: RoomsConfig = toml::from_str(&text).unwrap();
            RoomsSource::new(config, PoseNormalisation::mean_camera(MeanCameraScale::LongLrm))
        };
        let kept =
            |source: &RoomsSource| source.with_cache(|cache| (cache.clips.len(), cache.order.len(), cache.bytes));
        let (ample, none) = (source(1), source(0));
        let frames: usize = [0, 1].iter().map(|number| ample.clip(*number).unwrap().cameras.len()).sum();
        ample.clip(1).unwrap();
        assert_eq!(kept(&ample), (2, 2, frames * 8 * 8 * 3), "one byte a channel");
        for number in [0, 1] {
            none.clip(number).unwrap();
            assert_eq!(kept(&none), (0, 0, 0), "without memory nothing is kept");
        }
    }
}
