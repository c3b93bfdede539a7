use std::collections::{HashMap, VecDeque};
use std::num::{NonZeroU32, NonZeroUsize};
use std::sync::{Arc, Mutex, PoisonError};

use atsplat_camera::{Camera, PoseNormalisation};
use atsplat_model::ImageSize;
use atsplat_pixels::Rounding;
use atsplat_protocol::samplers::{SceneViews, SplitMix64};
use atsplat_rooms::{EffectChoice, EffectKind, Request, SceneKind, SceneSeed, Simulation, Split};
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
    /// Every how-many-th frame of a clip is offered: fewer frames are rendered, and they are used more often.
    #[serde(default = "one")]
    pub stride: NonZeroUsize,
    /// Which frames become a sample; gaps count offered frames.
    pub views: ViewChoice,
    /// Rendered frames that are kept in memory, in MiB; 0 renders each anew.
    #[serde(default)]
    pub cache_mib: usize,
}

const fn train() -> Split {
    Split::Train
}

const fn four() -> u32 {
    4
}

const fn one() -> NonZeroUsize {
    NonZeroUsize::MIN
}

/// Simulated scenes without end. Lenses are left out: the network and the papers' renderers take cameras for pinholes.
#[derive(Debug)]
pub struct RoomsSource {
    config: RoomsConfig,
    normalisation: PoseNormalisation,
    cache: Mutex<Cache>,
}

/// What was made so far; whatever is thrown away is made again as it was.
#[derive(Debug, Default)]
struct Cache {
    cameras: HashMap<u32, Arc<[Camera]>>,
    simulations: VecDeque<(u32, Arc<Simulation>)>,
    frames: HashMap<(u32, usize), Arc<[u8]>>,
    /// Oldest first.
    order: VecDeque<(u32, usize)>,
}

/// Built scenes that wait for their next frame.
const SIMULATIONS: usize = 8;

impl RoomsSource {
    /// Scenes whose cameras go through `normalisation`.
    pub fn new(config: RoomsConfig, normalisation: PoseNormalisation) -> Self {
        Self { config, normalisation, cache: Mutex::default() }
    }

    fn key(&self, number: u32) -> String {
        SceneSeed { split: self.config.split, number }.key(self.config.scenes_of)
    }

    fn simulation(&self, number: u32) -> Result<Arc<Simulation>, TrainError> {
        let known = self.with(|cache| cache.simulations.iter().find(|(of, _)| *of == number).map(|(_, s)| Arc::clone(s)));
        if let Some(known) = known {
            return Ok(known);
        }
        let mut request = Request::new(self.config.scenes_of, SceneSeed { split: self.config.split, number });
        let ImageSize { height, width } = self.config.size;
        let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX);
        request.size = atsplat_camera::ImageSize { width: side(width), height: side(height) };
        request.samples = self.config.samples;
        let called = Simulation::new(request.clone())?;
        let without_lens = |called: &Simulation| {
            let kinds = called.called_effects().iter().map(|called| called.effect);
            kinds.filter(|kind| *kind != EffectKind::LensDistortion).collect::<Vec<_>>()
        };
        let lens = called.called_effects().iter().any(|called| called.effect == EffectKind::LensDistortion);
        let made = if lens {
            request.effects = EffectChoice::Only(without_lens(&called));
            Simulation::new(request)?
        } else {
            called
        };
        let made = Arc::new(made);
        self.with(|cache| {
            cache.simulations.push_back((number, Arc::clone(&made)));
            if cache.simulations.len() > SIMULATIONS {
                cache.simulations.pop_front();
            }
        });
        Ok(made)
    }

    /// Cameras of the frames that are offered.
    fn cameras(&self, number: u32) -> Result<Arc<[Camera]>, TrainError> {
        if let Some(known) = self.with(|cache| cache.cameras.get(&number).cloned()) {
            return Ok(known);
        }
        let simulation = self.simulation(number)?;
        let shots = simulation.shots().iter().step_by(self.config.stride.get());
        let cameras: Arc<[Camera]> = shots.map(|shot| shot.camera).collect();
        self.with(|cache| cache.cameras.insert(number, Arc::clone(&cameras)));
        Ok(cameras)
    }

    /// An offered frame's picture, as a file of 8 bits would hold it.
    fn picture(&self, number: u32, frame: usize) -> Result<Arc<[u8]>, TrainError> {
        let place = (number, frame);
        if let Some(known) = self.with(|cache| cache.frames.get(&place).cloned()) {
            return Ok(known);
        }
        let picture = self.simulation(number)?.picture(frame * self.config.stride.get())?;
        let bytes: Arc<[u8]> = picture.to_u8(Rounding::Nearest)?.into_samples().into();
        let most = (self.config.cache_mib << 20) / bytes.len().max(1);
        self.with(|cache| {
            if most > 0 && cache.frames.insert(place, Arc::clone(&bytes)).is_none() {
                cache.order.push_back(place);
                if cache.order.len() > most
                    && let Some(oldest) = cache.order.pop_front()
                {
                    cache.frames.remove(&oldest);
                }
            }
        });
        Ok(bytes)
    }

    fn with<T>(&self, work: impl FnOnce(&mut Cache) -> T) -> T {
        work(&mut self.cache.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn posed(&self, number: u32, frames: &[usize], cameras: Vec<Camera>) -> Result<Posed, TrainError> {
        let mut pictures = Vec::with_capacity(frames.len() * self.config.size.height * self.config.size.width * 3);
        for &frame in frames {
            pictures.extend(self.picture(number, frame)?.iter().map(|byte| f32::from(*byte) / 255.0));
        }
        Ok(Posed { size: self.config.size, pictures, cameras })
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
            let (key, cameras) = (self.key(number), self.cameras(number)?);
            let entry = match self.config.views.draw(&SceneViews { key: &key, cameras: &cameras }, draw.step, &mut random)
            {
                Ok(entry) => entry,
                Err(error) => {
                    reason = format!("{key}: {error}");
                    continue;
                }
            };
            let of = |frames: &[usize]| -> Vec<Camera> {
                frames.iter().filter_map(|frame| cameras.get(*frame).copied()).collect()
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
                context: self.posed(number, &entry.context, context)?,
                targets: self.posed(number, &entry.target, targets)?,
            });
        }
        Err(TrainError::NoSample { source_name: self.name(), attempts: ATTEMPTS, reason })
    }
}
