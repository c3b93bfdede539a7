use std::collections::{HashMap, VecDeque};
use std::num::{NonZeroU32, NonZeroUsize};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use atsplat_camera::{Camera, PoseNormalisation};
use atsplat_model::ImageSize;
use atsplat_numeric::SplitMix64;
use atsplat_pixels::Rounding;
use atsplat_protocol::samplers::SceneViews;
use atsplat_rooms::{EffectChoice, EffectKind, GENERATION, Request, SceneKind, SceneSeed, Simulation, Split};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{
    NormalisedCameras, PatchDistances, PosedImages, ReplacedDraws, Sample, SampleId, Source, UnstablePoses, ViewChoice,
    distances, first_sample, normalised, pixel_size,
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
    /// Height and width of images, in pixels.
    pub size: ImageSize,
    /// Rays per pixel.
    #[serde(default = "four")]
    pub samples: u32,
    /// Every `stride`-th frame of a clip is offered; a frame is rendered when a sample first needs it.
    #[serde(default = "one")]
    pub stride: NonZeroUsize,
    /// Which frames become a sample; gaps count offered frames.
    pub views: ViewChoice,
    /// Memory for frames, in MiB, rendered or not; scenes that do not fit are rendered again.
    #[serde(default = "gibibyte")]
    pub cache_mib: usize,
}

impl RoomsConfig {
    /// Index of the last scene.
    pub(crate) const fn last(&self) -> u32 {
        self.first.saturating_add(self.scenes.get() - 1)
    }

    /// The scenes and the size of their images. The text is the key of the stream of draws: another one gives other samples.
    fn scenes_and_size(&self) -> String {
        format!("{} {} {} to {} at {}", self.scenes_of, self.split, self.first, self.last(), self.size)
    }

    /// The scenes with their views, and the generation of the simulator that rendered them if it is known: two generations render other
    /// images of one scene.
    pub(crate) fn description(&self, generation: Option<&str>) -> String {
        let generation = generation.map_or_else(String::new, |generation| format!(", generation {generation}"));
        format!("{} ({}, stride {}{generation})", self.scenes_and_size(), self.views, self.stride)
    }
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
    replaced: Mutex<ReplacedDraws>,
    unstable: Mutex<UnstablePoses>,
}

/// The offered frames of a scene.
#[derive(Debug)]
struct Clip {
    simulation: Simulation,
    /// Numbers of the offered frames in the simulation.
    frames: Vec<usize>,
    cameras: Vec<Camera>,
    /// 8-bit samples, as in a file.
    images: Vec<OnceLock<Vec<u8>>>,
    /// Distances of each frame's patches, in metres.
    distances: Vec<OnceLock<Vec<f32>>>,
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
    fn new(simulation: Simulation, stride: usize) -> Result<Self, TrainError> {
        let frames: Vec<usize> = (0..simulation.shots().len()).step_by(stride).collect();
        let cameras = frames.iter().map(|frame| simulation.camera(*frame)).collect::<Result<_, _>>()?;
        let (images, distances) = frames.iter().map(|_| (OnceLock::new(), OnceLock::new())).unzip();
        Ok(Self { simulation, frames, cameras, images, distances })
    }

    /// Samples of an offered frame.
    fn image(&self, position: usize) -> Result<&[u8], TrainError> {
        let render = || Ok(self.simulation.image(self.frames[position])?.to_u8(Rounding::Nearest)?.into_samples());
        kept(&self.images[position], render).map(Vec::as_slice)
    }

    /// Distances of an offered frame's patches of this many pixels a side.
    fn distances(&self, position: usize, patch: usize) -> Result<&[f32], TrainError> {
        let measure = || {
            let geometry = self.simulation.geometry(self.frames[position])?;
            Ok(distances::patch_distances(&self.cameras[position], geometry.size, &geometry.depth, patch))
        };
        kept(&self.distances[position], measure).map(Vec::as_slice)
    }
}

/// The value of a slot, made when it is empty.
fn kept<T>(slot: &OnceLock<T>, make: impl FnOnce() -> Result<T, TrainError>) -> Result<&T, TrainError> {
    if let Some(known) = slot.get() {
        return Ok(known);
    }
    // Another thread may make the same meanwhile.
    let value = make()?;
    Ok(slot.get_or_init(|| value))
}

impl RoomsSource {
    /// A source whose cameras are normalised by `normalisation`.
    pub fn new(config: RoomsConfig, normalisation: PoseNormalisation) -> Self {
        let (cache, replaced, unstable) = (Mutex::default(), Mutex::default(), Mutex::default());
        Self { config, normalisation, patch: None, cache, replaced, unstable }
    }

    /// Samples have the exact distances of context patches of this many pixels a side.
    #[must_use]
    pub fn with_distances(self, patch: NonZeroUsize) -> Self {
        Self { patch: Some(patch.get()), ..self }
    }

    /// The clip of a scene, from the cache or rendered; cameras are in the clip's world.
    fn clip(&self, number: u32) -> Result<Arc<Clip>, TrainError> {
        if let Some(cached) = self.with_cache(|cache| cache.clips.get(&number).cloned()) {
            return Ok(cached);
        }
        let clip = Arc::new(Clip::new(self.simulate(number)?, self.config.stride.get())?);
        Ok(self.with_cache(|cache| {
            // Another thread may have simulated it meanwhile, and rendered frames.
            if let Some(other) = cache.clips.get(&number) {
                return Arc::clone(other);
            }
            cache.clips.insert(number, Arc::clone(&clip));
            cache.order.push_back(number);
            cache.bytes += self.bytes(&clip);
            while cache.bytes > self.config.cache_mib << 20
                && let Some(oldest) = cache.order.pop_front()
            {
                #[expect(clippy::expect_used, reason = "both are filled together, above")]
                let clip = cache.clips.remove(&oldest).expect("the order lists clips that are kept");
                cache.bytes -= self.bytes(&clip);
            }
            clip
        }))
    }

    /// Memory of a clip with all of its frames.
    fn bytes(&self, clip: &Clip) -> usize {
        let pixels = self.config.size.width * self.config.size.height;
        let patches = self.patch.map_or(0, |patch| pixels / (patch * patch));
        clip.frames.len() * (3 * pixels + patches * size_of::<f32>())
    }

    fn simulate(&self, number: u32) -> Result<Simulation, TrainError> {
        let mut request = Request::new(self.config.scenes_of, SceneSeed { split: self.config.split, number });
        request.size = pixel_size(self.config.size);
        request.samples = self.config.samples;
        let mut simulation = Simulation::new(request.clone())?;
        let called: Vec<EffectKind> = simulation.active_effects().iter().map(|called| called.effect).collect();
        if called.contains(&EffectKind::LensDistortion) {
            let others = called.into_iter().filter(|kind| *kind != EffectKind::LensDistortion).collect();
            request.effects = EffectChoice::Only(others);
            simulation = Simulation::new(request)?;
        }
        Ok(simulation)
    }

    fn replaced_draws(&self) -> MutexGuard<'_, ReplacedDraws> {
        self.replaced.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn unstable(&self) -> MutexGuard<'_, UnstablePoses> {
        self.unstable.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a draw that gave no sample, and returns why.
    fn count_replaced(&self, key: &str, error: &impl std::fmt::Display) -> String {
        let reason = format!("{key}: {error}");
        self.replaced_draws().add(key, &reason);
        reason
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
            Err(error) => return Ok(Err(self.count_replaced(&key, &error))),
        };
        let cameras_of = |frames: &[usize]| frames.iter().map(|frame| clip.cameras[*frame]).collect::<Vec<Camera>>();
        let cameras = normalised(&cameras_of(&entry.context), &cameras_of(&entry.target), &self.normalisation);
        let NormalisedCameras { context, targets, scale, fallbacks } = match cameras {
            Ok(cameras) => cameras,
            Err(error) => return Ok(Err(self.count_replaced(&key, &error))),
        };
        let needed: Vec<usize> = entry.context.iter().chain(&entry.target).copied().collect();
        needed.into_par_iter().try_for_each(|frame| clip.image(frame).map(drop))?;
        let name = format!("{key}, frames {:?} to {:?}", entry.context, entry.target);
        self.unstable().add(&key, &name, &fallbacks);
        Ok(Ok(Sample {
            name,
            context: self.posed(&clip, &entry.context, context)?,
            targets: self.posed(&clip, &entry.target, targets)?,
            distances: self.patch.map(|patch| self.distances(&clip, &entry.context, patch, scale)).transpose()?,
        }))
    }

    fn with_cache<T>(&self, work: impl FnOnce(&mut Cache) -> T) -> T {
        work(&mut self.cache.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Distances of some frames' patches in the frame of a sample.
    fn distances(&self, clip: &Clip, frames: &[usize], patch: usize, scale: f64) -> Result<PatchDistances, TrainError> {
        let frames = frames.iter().map(|frame| clip.distances(*frame, patch)).collect::<Result<Vec<_>, _>>()?;
        let columns = self.config.size.width / patch;
        Ok(PatchDistances { columns, distances: frames.concat() }.scaled(scale))
    }

    fn posed(&self, clip: &Clip, frames: &[usize], cameras: Vec<Camera>) -> Result<PosedImages, TrainError> {
        let size = self.config.size;
        let mut images = Vec::with_capacity(frames.len() * 3 * size.width * size.height);
        for frame in frames {
            images.extend(clip.image(*frame)?.iter().map(|byte| f32::from(*byte) / 255.0));
        }
        Ok(PosedImages { size, images, cameras })
    }
}

impl Source for RoomsSource {
    fn name(&self) -> String {
        self.config.description(Some(&GENERATION.to_string()))
    }

    fn replaced(&self) -> ReplacedDraws {
        self.replaced_draws().clone()
    }

    fn replaced_count(&self) -> u64 {
        self.replaced_draws().count
    }

    fn unstable_poses(&self) -> UnstablePoses {
        self.unstable().clone()
    }

    fn sample(&self, id: SampleId) -> Result<Sample, TrainError> {
        first_sample(self, &self.config.scenes_and_size(), id, |random| self.try_sample(id.step, random))
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
