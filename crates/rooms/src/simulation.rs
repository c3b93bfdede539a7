use std::fmt;
use std::time::Instant;

use atsplat_camera::{Camera, ImageSize};
use atsplat_pixels::Image;

use crate::effects::{CalledEffect, Case, Conditions, EffectChoice, EffectKind, Effects};
use crate::render::{self, Geometry, View};
use crate::rng::Rng;
use crate::shot::Shot;
use crate::world::World;
use crate::{RoomsError, SceneKind, SceneSeed, build, path};

/// Which generator makes the pictures. It is raised with every change of a pixel, so that whoever keeps what was computed
/// from a simulated picture need not render it again to know that it is the same.
pub const GENERATOR: &str = "atsplat rooms 1";

/// Where the camera goes.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Route {
    /// As people film such places.
    #[default]
    Natural,
    /// As these cameras with their times in microseconds do, from a place in the scene that has room for it. The
    /// first camera is taken as upright; lengths are metres and shrink where the scene is too small. Lenses are ignored.
    Given(Vec<(i64, Camera)>),
}

/// All that a simulated scene depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// What kind of place.
    pub kind: SceneKind,
    /// Which of the kind.
    pub seed: SceneSeed,
    /// How many frames; with a given route, its own number counts.
    pub frames: usize,
    /// Columns and rows of each picture.
    pub size: ImageSize,
    /// Rays a pixel, 1 to 256.
    pub samples: u32,
    /// Which effects to run.
    pub effects: EffectChoice,
    /// Where the camera goes.
    pub route: Route,
}

impl Request {
    /// A clip of 150 frames (5 seconds) for rooms and 100 views for yards, 256×256, 4 samples a pixel, effects as
    /// called for.
    pub const fn new(kind: SceneKind, seed: SceneSeed) -> Self {
        let frames = match kind {
            SceneKind::Rooms => 150,
            SceneKind::Yards => 100,
        };
        let size = ImageSize { width: 256, height: 256 };
        Self { kind, seed, frames, size, samples: 4, effects: EffectChoice::Auto, route: Route::Natural }
    }
}

/// A scene that was built and filmed; pictures are rendered when they are asked for, in any order.
#[derive(Debug)]
pub struct Simulation {
    request: Request,
    pub(crate) world: World,
    conditions: Conditions,
    effects: Effects,
    shots: Vec<Shot>,
    slowed_to: f64,
    gain: f32,
}

/// What one effect adds to the time of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffectCost {
    /// Which.
    pub effect: EffectKind,
    /// Seconds with all of the scene's effects less seconds without this one; noise may make it negative.
    pub secs: f64,
}

impl Simulation {
    /// Builds the scene and finds the camera's way.
    ///
    /// # Errors
    /// [`RoomsError::Request`] for no frames, no pixels, a side over 16384, or samples outside 1 to 256.
    pub fn new(request: Request) -> Result<Self, RoomsError> {
        let ImageSize { width, height } = request.size;
        let check = |fine: bool, field, expected, found: String| {
            if fine { Ok(()) } else { Err(RoomsError::Request { field, expected, found }) }
        };
        check(request.frames > 0, "frames", "at least 1", request.frames.to_string())?;
        let sides = 1..=16384;
        check(
            sides.contains(&width) && sides.contains(&height),
            "size",
            "sides of 1 to 16384",
            request.size.to_string(),
        )?;
        check((1..=256).contains(&request.samples), "samples", "1 to 256", request.samples.to_string())?;
        let seed = request.seed.word();
        let world = build::world(request.kind, seed);
        let walked = match &request.route {
            Route::Natural => {
                let shape = f64::from(width) / f64::from(height);
                path::natural(request.kind, seed, &world, request.frames, shape)?
            }
            Route::Given(cameras) => path::place(seed, &world, cameras)?,
        };
        let conditions = conditions(request.kind, seed);
        let case = Case { world: &world, conditions: &conditions, shots: &walked.shots };
        let effects = Effects::choose(&case, &request.effects);
        let gain = metered(&world, &effects, &walked.shots)?;
        let (shots, slowed_to) = (walked.shots, walked.slowed_to);
        Ok(Self { request, world, conditions, effects, shots, slowed_to, gain })
    }

    /// A world made by hand, filmed by cameras at rest, without effects.
    #[cfg(test)]
    pub(crate) fn of_world(world: World, size: ImageSize, cameras: &[Camera]) -> Self {
        let seed = SceneSeed { split: crate::Split::Test, number: 0 };
        let request = Request { size, effects: EffectChoice::None, ..Request::new(SceneKind::Rooms, seed) };
        let still = |camera: &Camera| Shot::still(0, *camera, camera.camera_from_world.inverse());
        let shots: Vec<Shot> = cameras.iter().map(still).collect();
        let conditions = conditions(request.kind, seed.word());
        let case = Case { world: &world, conditions: &conditions, shots: &shots };
        let effects = Effects::choose(&case, &request.effects);
        Self { request, world, conditions, effects, shots, slowed_to: 1.0, gain: 1.0 }
    }

    /// The scene's name.
    pub fn key(&self) -> String {
        self.request.seed.key(self.request.kind)
    }

    /// What was asked for.
    pub const fn request(&self) -> &Request {
        &self.request
    }

    /// The clip's cameras without their lens, in order.
    pub fn shots(&self) -> &[Shot] {
        &self.shots
    }

    /// The effects that run, and why.
    pub fn called_effects(&self) -> &[CalledEffect] {
        &self.effects.called
    }

    /// The speed that fits the scene, as a share of the speed that was drawn or given; 1 in most scenes.
    pub const fn slowed_to(&self) -> f64 {
        self.slowed_to
    }

    /// A frame's camera with the lens that its picture is seen through.
    ///
    /// # Errors
    /// [`RoomsError::NoFrame`].
    pub fn camera(&self, frame: usize) -> Result<Camera, RoomsError> {
        Ok(Camera { distortion: self.effects.lens, ..self.shot(frame)?.camera })
    }

    /// Renders a frame's picture alone.
    ///
    /// # Errors
    /// [`RoomsError::NoFrame`]; [`RoomsError::Camera`] if the lens folds over inside the picture.
    pub fn picture(&self, frame: usize) -> Result<Image, RoomsError> {
        let Request { size, samples, .. } = self.request;
        render::picture(&self.world, &self.effects, self.shot(frame)?, size, samples, self.gain)
    }

    /// Finds what is behind each pixel's centre, without rendering.
    ///
    /// # Errors
    /// As [`Self::picture`].
    pub fn geometry(&self, frame: usize) -> Result<Geometry, RoomsError> {
        render::geometry(&self.world, self.effects.lens, self.shot(frame)?, self.request.size)
    }

    /// A frame's picture and geometry.
    ///
    /// # Errors
    /// As [`Self::picture`].
    pub fn view(&self, frame: usize) -> Result<View, RoomsError> {
        Ok(View { picture: self.picture(frame)?, geometry: self.geometry(frame)? })
    }

    /// What each effect costs in a frame: the best of three renderings with and without it.
    ///
    /// # Errors
    /// As [`Self::picture`].
    pub fn effect_costs(&self, frame: usize) -> Result<Vec<EffectCost>, RoomsError> {
        let shot = self.shot(frame)?;
        let kinds: Vec<EffectKind> = self.effects.called.iter().map(|called| called.effect).collect();
        let case = Case { world: &self.world, conditions: &self.conditions, shots: &self.shots };
        let secs = |effects: &Effects| {
            let mut least = f64::INFINITY;
            for _ in 0..3 {
                let start = Instant::now();
                render::picture(&self.world, effects, shot, self.request.size, self.request.samples, self.gain)?;
                let secs = start.elapsed().as_secs_f64();
                least = if secs < least { secs } else { least };
            }
            Ok::<_, RoomsError>(least)
        };
        let all = secs(&self.effects)?;
        kinds
            .iter()
            .map(|&effect| {
                let others = kinds.iter().copied().filter(|other| *other != effect).collect();
                let without = Effects::choose(&case, &EffectChoice::Only(others));
                Ok(EffectCost { effect, secs: all - secs(&without)? })
            })
            .collect()
    }

    pub(crate) fn shot(&self, frame: usize) -> Result<&Shot, RoomsError> {
        let frames = self.shots.len();
        self.shots.get(frame).ok_or_else(|| RoomsError::NoFrame { key: self.key(), frames, frame })
    }
}

impl fmt::Display for Simulation {
    /// The scene's name and size, and its effects with their reasons, one a line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (objects, lamps) = (self.world.objects.len(), self.world.lamps.len());
        writeln!(f, "{}: {objects} objects, {lamps} lamps, {} frames", self.key(), self.shots.len())?;
        if self.slowed_to < 1.0 {
            writeln!(f, "  the camera moves at {:.0} % of the speed drawn, to fit", self.slowed_to * 100.0)?;
        }
        self.effects.called.iter().try_for_each(|called| writeln!(f, "  {}: {}", called.effect, called.reason))
    }
}

/// How the scene is lit and filmed.
fn conditions(kind: SceneKind, seed: u64) -> Conditions {
    let rng = &mut Rng::for_part(seed, "conditions");
    let lens = [rng.within(-0.09, 0.03), rng.within(-0.01, 0.02)];
    let (shutter, noise, drift) = (rng.within(0.15, 0.6), rng.within(0.005, 0.018), rng.within(0.04, 0.2));
    let bent = match kind {
        SceneKind::Rooms => 0.12,
        SceneKind::Yards => 0.4,
    };
    Conditions {
        lens: if rng.chance(bent) { lens } else { [0.0; 2] },
        shutter: if rng.chance(0.35) { shutter } else { 0.0 },
        noise: if rng.chance(0.35) { noise } else { 0.0 },
        drift: if rng.chance(0.35) { drift } else { 0.0 },
        bounce: if rng.chance(0.88) { 1.0 } else { 0.0 },
        seed: rng.next(),
    }
}

/// The gain that shows four fifths of what the clip sees below two thirds of white.
fn metered(world: &World, effects: &Effects, shots: &[Shot]) -> Result<f32, RoomsError> {
    const SIDE: ImageSize = ImageSize { width: 20, height: 20 };
    let mut seen = Vec::new();
    for part in 0..4 {
        let Some(shot) = shots.get(part * (shots.len() - 1) / 3) else { continue };
        seen.extend(render::light(world, effects, shot, SIDE, 1)?.iter().map(|light| light.element_sum() / 3.0));
    }
    seen.sort_by(f32::total_cmp);
    let bright = seen.get(seen.len() * 4 / 5).copied().unwrap_or_default();
    Ok(if bright > 1e-6 { 0.6 / bright } else { 1.0 })
}
