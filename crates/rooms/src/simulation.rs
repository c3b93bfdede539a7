use std::fmt;
use std::sync::OnceLock;

use atsplat_camera::{Camera, ImageSize};
use atsplat_files::Sha256Digest;
use atsplat_numeric::counted;
use atsplat_pixels::Image;
use atsplat_scene::{FrameImage, Scene, TimestampSource};

use crate::effects::{AbsentEffect, ActiveEffect, Conditions, EffectChoice, Effects, SceneContext};
use crate::path::Shot;
use crate::render::{self, Frame, Geometry, LensTable};
use crate::rng::Rng;
use crate::tiled_light::TiledLight;
use crate::world::World;
use crate::{RoomsError, SceneKind, SceneSeed, build, path};

/// Name and version of the generator. The version is raised with every change of a pixel, so that results computed from a
/// simulated image can be reused without rendering it again.
pub const GENERATOR: &str = "atsplat rooms 2";
/// The version in [`GENERATOR`].
pub const GENERATION: u32 = 2;

/// Route of the camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Route {
    /// As people film such places.
    #[default]
    Natural,
    /// As these cameras with their times in microseconds do, from a place in the scene that has room for it. The
    /// first camera is taken as upright; lengths are metres and shrink where the scene is too small. Lenses are ignored.
    /// Normalised intrinsics hold for images of the requested size.
    Given(Vec<(i64, Camera)>),
}

impl Route {
    /// As a scene's cameras, for images of `size`; `times` are those of its dataset ([`atsplat_scene::SceneSource::times`]).
    /// Scenes without times ([`Scene::has_times`]) are assumed to have 30 frames per second. Where the images' size is stated,
    /// the vertical field of view and the shape of pixels are kept, whatever the aspect ratio; otherwise normalised intrinsics.
    pub fn of_scene(scene: &Scene, times: TimestampSource, size: ImageSize) -> Self {
        Self::Given(path::route_cameras(scene, times, size))
    }

    /// Identifies a given route: the hash of its cameras and times. `None` for a natural one.
    pub(crate) fn digest(&self) -> Option<Sha256Digest> {
        match self {
            Self::Natural => None,
            Self::Given(cameras) => Some(Sha256Digest::of(format!("{cameras:?}").as_bytes())),
        }
    }

    pub(crate) const fn is_given(&self) -> bool {
        matches!(self, Self::Given(_))
    }
}

/// Everything on which a simulated scene depends.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Kind of scene.
    pub kind: SceneKind,
    /// Seed of the scene.
    pub seed: SceneSeed,
    /// Number of frames; ignored for a given route.
    pub frames: usize,
    /// Size of each image.
    pub size: ImageSize,
    /// Rays per pixel, 1 to 256.
    pub samples: u32,
    /// Effects to run.
    pub effects: EffectChoice,
    /// Route of the camera.
    pub route: Route,
}

impl Request {
    /// Longest side of an image.
    pub const MAX_SIDE: u32 = 16384;

    /// A clip of 150 frames (5 seconds) for rooms and 100 views for yards, 256×256, 4 samples per pixel, with the effects that
    /// the scene needs.
    pub const fn new(kind: SceneKind, seed: SceneSeed) -> Self {
        let frames = match kind {
            SceneKind::Rooms => 150,
            SceneKind::Yards => 100,
        };
        let size = ImageSize { width: 256, height: 256 };
        Self { kind, seed, frames, size, samples: 4, effects: EffectChoice::Auto, route: Route::Natural }
    }

    fn check(&self) -> Result<(), RoomsError> {
        let Self { frames, size, samples, .. } = self;
        let check = |valid: bool, field, expected, found: &dyn fmt::Display| {
            if valid { Ok(()) } else { Err(RoomsError::Request { field, expected, found: found.to_string() }) }
        };
        let sides = 1..=Self::MAX_SIDE;
        check(*frames > 0, "frames", "at least 1", frames)?;
        check(sides.contains(&size.width) && sides.contains(&size.height), "size", "sides of 1 to 16384", size)?;
        check((1..=256).contains(samples), "samples", "1 to 256", samples)
    }
}

/// A simulated scene with its camera path; images are rendered on request, in any order.
#[derive(Debug)]
pub struct Simulation {
    request: Request,
    pub(crate) world: World,
    pub(crate) conditions: Conditions,
    pub(crate) effects: Effects,
    shots: Vec<Shot>,
    slowed_to: f64,
    gain: f32,
    /// Whether a lens that the scene needs is kept.
    pub(crate) keeps_lens: bool,
    lens_table: OnceLock<LensTable>,
}

impl Simulation {
    /// Builds the scene and finds a camera path.
    ///
    /// # Errors
    /// [`RoomsError::Request`] for no frames, no pixels, a side over 16384, samples outside 1 to 256, so many frames that no path
    /// fits into the scene, or a given route that does not fit at any scale.
    pub fn new(request: Request) -> Result<Self, RoomsError> {
        request.check()?;
        let (seed, size) = (request.seed.bits(), request.size);
        let world = build::world(request.kind, seed);
        let path = match &request.route {
            Route::Natural => {
                let width_over_height = f64::from(size.width) / f64::from(size.height);
                path::natural(request.kind, seed, &world, request.frames, width_over_height)?
            }
            Route::Given(cameras) => path::place(seed, &world, cameras)?,
        };
        let conditions = conditions(request.kind, seed);
        let samples = request.samples;
        let scene = SceneContext { world: &world, conditions: &conditions, shots: &path.shots, size, samples };
        let effects = Effects::choose(&scene, &request.effects);
        let gain = auto_exposure_gain(&world, &effects, &path.shots)?;
        let (shots, slowed_to) = (path.shots, path.slowed_to);
        let (keeps_lens, lens_table) = (true, OnceLock::new());
        Ok(Self { request, world, conditions, effects, shots, slowed_to, gain, keeps_lens, lens_table })
    }

    /// A simulation of a given world with static cameras and no effects.
    #[cfg(test)]
    pub(crate) fn of_world(world: World, size: ImageSize, cameras: &[Camera]) -> Self {
        let seed = SceneSeed { split: crate::Split::Test, number: 0 };
        let request = Request { size, effects: EffectChoice::None, ..Request::new(SceneKind::Rooms, seed) };
        let shots = cameras.iter().map(|camera| Shot::still(0, *camera)).collect::<Vec<_>>();
        let conditions = conditions(request.kind, seed.bits());
        let samples = request.samples;
        let scene = SceneContext { world: &world, conditions: &conditions, shots: &shots, size, samples };
        let effects = Effects::choose(&scene, &request.effects);
        let (slowed_to, gain, keeps_lens, lens_table) = (1.0, 1.0, true, OnceLock::new());
        Self { request, world, conditions, effects, shots, slowed_to, gain, keeps_lens, lens_table }
    }

    /// The same scene through a lens that does not bend, for layouts that store none. Everything else stays, exposure included.
    #[must_use]
    pub fn without_lens(self) -> Self {
        Self { effects: self.effects.without_lens(), keeps_lens: false, ..self }
    }

    /// The scene's name.
    pub fn key(&self) -> String {
        self.request.seed.key(self.request.kind)
    }

    /// The request.
    pub const fn request(&self) -> &Request {
        &self.request
    }

    /// The clip's cameras without their lens, in order.
    pub fn shots(&self) -> &[Shot] {
        &self.shots
    }

    /// The effects that run, with reasons.
    pub fn active_effects(&self) -> &[ActiveEffect] {
        &self.effects.active
    }

    /// The effects that images do not show although they were requested, or although the scene needs them, with reasons.
    pub fn absent_effects(&self) -> &[AbsentEffect] {
        &self.effects.absent
    }

    /// The camera's speed as a share of the drawn or given one, reduced to fit the scene; 1 in most scenes.
    pub const fn slowed_to(&self) -> f64 {
        self.slowed_to
    }

    /// A frame's camera with its lens.
    ///
    /// # Errors
    /// [`RoomsError::NoFrame`].
    pub fn camera(&self, frame: usize) -> Result<Camera, RoomsError> {
        Ok(Camera { distortion: self.effects.lens(), ..self.shot(frame)?.camera })
    }

    /// A frame of a scene, with its image.
    pub(crate) fn frame_with(&self, at: usize, image: FrameImage) -> Result<atsplat_scene::Frame, RoomsError> {
        let timestamp = self.shot(at)?.timestamp_micros;
        Ok(atsplat_scene::Frame {
            name: timestamp.to_string(),
            timestamp_micros: Some(timestamp),
            camera: self.camera(at)?,
            stated_size: Some(self.request.size),
            image,
        })
    }

    /// Renders a frame's image, sRGB-encoded in [0, 1].
    ///
    /// # Errors
    /// [`RoomsError::NoFrame`].
    pub fn image(&self, frame: usize) -> Result<Image, RoomsError> {
        self.rendered(frame, &self.effects)
    }

    /// Computes the geometry behind each pixel's centre, without rendering.
    ///
    /// # Errors
    /// As [`Self::image`].
    pub fn geometry(&self, frame: usize) -> Result<Geometry, RoomsError> {
        render::geometry(&self.world, self.effects.lens(), self.shot(frame)?, self.request.size)
    }

    /// Renders a frame with these effects at the exposure of the scene's own.
    pub(crate) fn rendered(&self, frame: usize, effects: &Effects) -> Result<Image, RoomsError> {
        self.exposed(frame, effects, self.gain)
    }

    /// Renders a frame with these effects and this gain.
    pub(crate) fn exposed(&self, frame: usize, effects: &Effects, gain: f32) -> Result<Image, RoomsError> {
        let light = TiledLight { frame: &self.frame(frame, effects)? }.light()?;
        render::image_of_light(&light, effects, self.shot(frame)?, self.request.size, gain)
    }

    /// A frame to be rendered with these effects.
    pub(crate) fn frame<'a>(&'a self, frame: usize, effects: &'a Effects) -> Result<Frame<'a>, RoomsError> {
        let Request { size, samples, .. } = self.request;
        Frame::new(&self.world, effects, self.shot(frame)?, size, samples)?.with_lens_table(&self.lens_table)
    }

    pub(crate) fn shot(&self, frame: usize) -> Result<&Shot, RoomsError> {
        let frames = self.shots.len();
        self.shots.get(frame).ok_or_else(|| RoomsError::NoFrame { key: self.key(), frames, frame })
    }
}

impl fmt::Display for Simulation {
    /// The scene's name and size, and its effects with their reasons, one a line; those that are absent last.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [objects, lamps, frames] =
            [(self.world.objects.len(), "object"), (self.world.lamps.len(), "lamp"), (self.shots.len(), "frame")]
                .map(|(count, what)| counted(count as u64, what));
        writeln!(f, "{}: {objects}, {lamps}, {frames}", self.key())?;
        if self.slowed_to < 1.0 {
            let speed = if self.request.route.is_given() { "given" } else { "sampled" };
            let percent = self.slowed_to * 100.0;
            let percent = if percent < 1.0 { format!("{percent:.1e}") } else { format!("{percent:.0}") };
            writeln!(
                f,
                "  the camera moves at {percent} % of its {speed} speed, so that the path fits into the scene"
            )?;
        }
        self.effects.active.iter().try_for_each(|active| writeln!(f, "  {}: {}", active.effect, active.reason))?;
        self.effects.absent.iter().try_for_each(|absent| writeln!(f, "  {}: {}", absent.effect, absent.reason))
    }
}

/// Draws how the scene is lit and filmed.
pub(crate) fn conditions(kind: SceneKind, seed: u64) -> Conditions {
    let rng = &mut Rng::for_part(
        seed,
        match kind {
            SceneKind::Rooms => "conditions",
            SceneKind::Yards => "conditions of yards",
        },
    );
    let lens = [rng.within(-0.09, 0.03), rng.within(-0.01, 0.02)];
    let (shutter, noise, drift) = (rng.within(0.005, 0.02), rng.within(0.005, 0.018), rng.within(0.04, 0.2));
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

/// Auto exposure: the gain that puts the 80th percentile of the clip's brightness at 0.6.
pub(crate) fn auto_exposure_gain(world: &World, effects: &Effects, shots: &[Shot]) -> Result<f32, RoomsError> {
    const SIDE: ImageSize = ImageSize { width: 20, height: 20 };
    let mut brightness = Vec::new();
    for part in 0..4 {
        let shot = &shots[part * (shots.len() - 1) / 3];
        brightness
            .extend(Frame::new(world, effects, shot, SIDE, 1)?.light()?.iter().map(|light| light.element_sum() / 3.0));
    }
    brightness.sort_by(f32::total_cmp);
    let bright = brightness[brightness.len() * 4 / 5];
    Ok(if bright > 1e-6 { 0.6 / bright } else { 1.0 })
}

#[cfg(test)]
mod tests {
    use atsplat_camera::Distortion;

    use super::*;
    use crate::Split;

    /// The second yard needs no lens: nothing of it changes.
    #[test]
    fn a_scene_without_its_lens_keeps_its_exposure_and_all_other_effects() {
        for (number, is_bent) in [(0, true), (1, false)] {
            let size = ImageSize { width: 40, height: 30 };
            let seed = SceneSeed { split: Split::Train, number };
            let request = Request { size, frames: 2, ..Request::new(SceneKind::Yards, seed) };
            let whole = Simulation::new(request.clone()).unwrap();
            let straight = Simulation::new(request).unwrap().without_lens();
            assert_eq!(whole.camera(1).unwrap().distortion != Distortion::None, is_bent);
            assert_eq!(straight.camera(1).unwrap().distortion, Distortion::None);
            assert_eq!(straight.gain.to_bits(), whole.gain.to_bits());
            assert_eq!(straight.active_effects().len() + usize::from(is_bent), whole.active_effects().len());
            assert_eq!(straight.absent_effects().len(), usize::from(is_bent));
            let said = straight.to_string();
            assert_eq!(said.contains("  lens distortion: left out: this layout stores no lens\n"), is_bent, "{said}");
            let [bent, image] = [&whole, &straight].map(|simulation| simulation.image(1).unwrap());
            assert_eq!(bent.samples() != image.samples(), is_bent);
        }
    }
}
