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

use super::{Draw, Posed, Sample, Source, ViewChoice, normalised};
use crate::TrainError;

/// Simulated scenes, rendered when they are needed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RoomsConfig {
    /// What kind of place.
    pub scenes_of: SceneKind,
    /// Training scenes or test scenes: never the same.
    #[serde(default = "train")]
    pub split: Split,
    /// How many different scenes.
    pub scenes: NonZeroU32,
    /// Number of the first.
    #[serde(default)]
    pub first: u32,
    /// Height and width of pictures, in pixels.
    pub size: ImageSize,
    /// Rays a pixel.
    #[serde(default = "four")]
    pub samples: u32,
    /// Every how-many-th frame of a clip is offered. All that are offered are rendered when the scene is first needed.
    #[serde(default = "one")]
    pub stride: NonZeroUsize,
    /// Which frames become a sample; gaps count offered frames.
    pub views: ViewChoice,
    /// Most rendered frames that are kept in memory, in MiB; where it is less than all, scenes are rendered again.
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

/// Simulated scenes. Lenses are left out: the network and the papers' renderers take cameras for pinholes.
#[derive(Debug)]
pub struct RoomsSource {
    config: RoomsConfig,
    normalisation: PoseNormalisation,
    cache: Mutex<Cache>,
}

/// The frames of a scene that are offered.
#[derive(Debug)]
struct Clip {
    cameras: Vec<Camera>,
    /// As files of 8 bits would hold them.
    pictures: Vec<Vec<u8>>,
}

/// Clips that were rendered; whatever is thrown away is rendered again as it was.
#[derive(Debug, Default)]
struct Cache {
    clips: HashMap<u32, Arc<Clip>>,
    /// Oldest first.
    order: VecDeque<u32>,
    bytes: usize,
}

impl Clip {
    fn bytes(&self) -> usize {
        self.pictures.iter().map(Vec::len).sum()
    }
}

impl RoomsSource {
    /// Scenes whose cameras go through `normalisation`.
    pub fn new(config: RoomsConfig, normalisation: PoseNormalisation) -> Self {
        Self { config, normalisation, cache: Mutex::default() }
    }

    /// Which scene and which frames, with their cameras in the clip's world.
    fn clip(&self, number: u32) -> Result<Arc<Clip>, TrainError> {
        if let Some(known) = self.with(|cache| cache.clips.get(&number).cloned()) {
            return Ok(known);
        }
        let clip = Arc::new(self.rendered(number)?);
        self.with(|cache| {
            if cache.clips.insert(number, Arc::clone(&clip)).is_none() {
                cache.order.push_back(number);
                cache.bytes += clip.bytes();
            }
            while cache.bytes > self.config.cache_mib << 20
                && let Some(oldest) = cache.order.pop_front()
            {
                cache.bytes -= cache.clips.remove(&oldest).map_or(0, |clip| clip.bytes());
            }
        });
        Ok(clip)
    }

    fn rendered(&self, number: u32) -> Result<Clip, TrainError> {
        let mut request = Request::new(self.config.scenes_of, SceneSeed { split: self.config.split, number });
        let ImageSize { height, width } = self.config.size;
        let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX);
        request.size = atsplat_camera::ImageSize { width: side(width), height: side(height) };
        request.samples = self.config.samples;
        let mut simulation = Simulation::new(request.clone())?;
        let called: Vec<EffectKind> = simulation.called_effects().iter().map(|called| called.effect).collect();
        if called.contains(&EffectKind::LensDistortion) {
            let others = called.into_iter().filter(|kind| *kind != EffectKind::LensDistortion).collect();
            request.effects = EffectChoice::Only(others);
            simulation = Simulation::new(request)?;
        }
        let frames = || (0..simulation.shots().len()).step_by(self.config.stride.get());
        let cameras = frames().map(|frame| simulation.camera(frame)).collect::<Result<_, _>>()?;
        let picture = |frame| Ok::<_, TrainError>(simulation.picture(frame)?.to_u8(Rounding::Nearest)?.into_samples());
        let pictures = frames().collect::<Vec<_>>().into_par_iter().map(picture).collect::<Result<_, _>>()?;
        Ok(Clip { cameras, pictures })
    }

    fn with<T>(&self, work: impl FnOnce(&mut Cache) -> T) -> T {
        work(&mut self.cache.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn posed(&self, clip: &Clip, frames: &[usize], cameras: Vec<Camera>) -> Posed {
        let bytes = frames.iter().filter_map(|frame| clip.pictures.get(*frame)).flatten();
        Posed { size: self.config.size, pictures: bytes.map(|byte| f32::from(*byte) / 255.0).collect(), cameras }
    }
}

impl Source for RoomsSource {
    fn name(&self) -> String {
        let RoomsConfig { scenes_of, split, scenes, first, size, .. } = &self.config;
        let last = first.saturating_add(scenes.get() - 1);
        format!("{scenes_of} {split} {first} to {last} at {size}")
    }

    fn sample(&self, draw: Draw) -> Result<Sample, TrainError> {
        const ATTEMPTS: u32 = 20;
        let mut reason = String::new();
        for attempt in 0..ATTEMPTS {
            let stream = format!("{} {} {attempt}", self.name(), draw.number);
            let mut random = SplitMix64::for_scene(draw.seed, &stream);
            let last = self.config.scenes.get() as usize - 1;
            let offset = random.within(0..=last).and_then(|offset| u32::try_from(offset).ok()).unwrap_or_default();
            let number = self.config.first.saturating_add(offset);
            let key = SceneSeed { split: self.config.split, number }.key(self.config.scenes_of);
            let clip = self.clip(number)?;
            let views = SceneViews { key: &key, cameras: &clip.cameras };
            let entry = match self.config.views.draw(&views, draw.step, &mut random) {
                Ok(entry) => entry,
                Err(error) => {
                    reason = format!("{key}: {error}");
                    continue;
                }
            };
            let of = |frames: &[usize]| -> Vec<Camera> {
                frames.iter().filter_map(|frame| clip.cameras.get(*frame).copied()).collect()
            };
            let poses = normalised(&of(&entry.context), &of(&entry.target), &self.normalisation);
            let [context, targets] = match poses {
                Ok(poses) => poses,
                Err(error) => {
                    reason = format!("{key}: {error}");
                    continue;
                }
            };
            return Ok(Sample {
                name: format!("{key}, frames {:?} to {:?}", entry.context, entry.target),
                context: self.posed(&clip, &entry.context, context),
                targets: self.posed(&clip, &entry.target, targets),
            });
        }
        Err(TrainError::NoSample { source_name: self.name(), attempts: ATTEMPTS, reason })
    }
}
