//! Optional effects of rendering. Each effect is one file, and a field of [`Effects`]; unless others are requested, a scene runs only
//! those that can change its images, with the reason. Effects of light need lamps, glossy surfaces or indirect light, those of the
//! sensor a strength above zero. Lens distortion and motion blur run if they move what is seen by more than a small part of a
//! pixel.

mod choice;
mod exposure_drift;
mod indirect_light;
mod lens_distortion;
mod motion_blur;
mod sensor_noise;
mod soft_shadows;
mod specular_reflection;

pub use choice::EffectChoice;

use std::fmt;

use atsplat_camera::{Distortion, ImageSize};
use glam::{DVec2, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::lamp::Lamp;
use crate::path::Shot;
use crate::world::{Surface, World};
use exposure_drift::ExposureDrift;
use indirect_light::IndirectLight;
use sensor_noise::SensorNoise;

/// Parameters of the camera's effects and of the lighting, drawn from the scene's seed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Conditions {
    /// Radial distortion k1, k2.
    pub lens: [f64; 2],
    /// Seconds during which the shutter is open.
    pub shutter: f64,
    /// Standard deviation of noise where light is 0.9 of white, as a share of white.
    pub noise: f64,
    /// Swing of the automatic exposure, in stops.
    pub drift: f64,
    /// Share of indirect light that varies in space; the rest is uniform, as in fused exposures.
    pub bounce: f64,
    pub seed: u64,
}

/// The name of an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EffectKind {
    /// Shadows of lamps, with penumbrae.
    SoftShadows,
    /// Reflections of floors, screens and metal.
    SpecularReflection,
    /// Light reflected by other surfaces.
    IndirectLight,
    /// Automatic exposure that changes along the path.
    ExposureDrift,
    /// Radial lens distortion.
    LensDistortion,
    /// Blur from camera motion while the shutter is open.
    MotionBlur,
    /// Noise of photons and electronics.
    SensorNoise,
}

impl EffectKind {
    /// All effects, in the order in which they are applied.
    pub const ALL: [Self; 7] = [
        Self::SoftShadows,
        Self::SpecularReflection,
        Self::IndirectLight,
        Self::ExposureDrift,
        Self::LensDistortion,
        Self::MotionBlur,
        Self::SensorNoise,
    ];

    /// The name in files and on command lines.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SoftShadows => "soft-shadows",
            Self::SpecularReflection => "specular-reflection",
            Self::IndirectLight => "indirect-light",
            Self::ExposureDrift => "exposure-drift",
            Self::LensDistortion => "lens-distortion",
            Self::MotionBlur => "motion-blur",
            Self::SensorNoise => "sensor-noise",
        }
    }
}

impl fmt::Display for EffectKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name().replace('-', " "))
    }
}

/// An effect that a scene runs, with the reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ActiveEffect {
    /// The effect.
    pub effect: EffectKind,
    /// The reason, with the deciding number.
    pub reason: String,
}

/// An effect that a scene's images do not show although it was requested, or although the scene needs it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct AbsentEffect {
    /// The effect.
    pub effect: EffectKind,
    /// Why not.
    pub reason: &'static str,
}

/// The reason of a requested effect whose strength in this scene is 0 or too small to be seen.
const NONE_IN_SCENE: &str = "requested: this scene has none that can be seen";
/// The reason of a lens that the scene needs, in a layout without lenses.
const NO_LENS_IN_LAYOUT: &str = "left out: this layout stores no lens";
/// The reason of motion blur that the scene needs, with one ray for each pixel.
const ONE_MOMENT: &str = "left out: one ray per pixel shows one moment";

/// The effects of one scene.
#[derive(Debug)]
pub(crate) struct Effects {
    pub active: Vec<ActiveEffect>,
    pub absent: Vec<AbsentEffect>,
    shadows: bool,
    /// Whether reflected rays are traced.
    pub mirrors: bool,
    ambient: Option<IndirectLight>,
    drift: Option<ExposureDrift>,
    lens: Option<Distortion>,
    /// Seconds during which the shutter is open.
    shutter: Option<f64>,
    noise: Option<SensorNoise>,
    /// Seed of all draws for single pixels.
    pub seed: u64,
}

/// The scene properties that decide which effects run.
pub(crate) struct SceneContext<'a> {
    pub world: &'a World,
    pub conditions: &'a Conditions,
    pub shots: &'a [Shot],
    /// Size of each image.
    pub size: ImageSize,
    /// Rays per pixel.
    pub samples: u32,
}

impl Effects {
    pub(crate) fn choose(scene: &SceneContext<'_>, choice: &EffectChoice) -> Self {
        let mut effects = Self::none(scene.conditions.seed);
        let is_auto = *choice == EffectChoice::Auto;
        for effect in EffectKind::ALL.into_iter().filter(|effect| is_auto || choice.requests(*effect)) {
            match needed_by(effect, scene) {
                Some(_) if effect == EffectKind::MotionBlur && scene.samples == 1 => {
                    effects.absent.push(AbsentEffect { effect, reason: ONE_MOMENT });
                    continue;
                }
                Some(reason) => effects.active.push(ActiveEffect { effect, reason }),
                None if is_auto => continue,
                None => effects.absent.push(AbsentEffect { effect, reason: NONE_IN_SCENE }),
            }
            // A requested effect runs even if the scene has none that can be seen.
            effects.enable(effect, scene);
        }
        effects
    }

    const fn none(seed: u64) -> Self {
        Self {
            active: Vec::new(),
            absent: Vec::new(),
            shadows: false,
            mirrors: false,
            ambient: None,
            drift: None,
            lens: None,
            shutter: None,
            noise: None,
            seed,
        }
    }

    fn enable(&mut self, effect: EffectKind, scene: &SceneContext<'_>) {
        let conditions = scene.conditions;
        match effect {
            EffectKind::SoftShadows => self.shadows = true,
            EffectKind::SpecularReflection => self.mirrors = true,
            EffectKind::IndirectLight => self.ambient = Some(IndirectLight::new(scene.world, conditions.bounce)),
            EffectKind::ExposureDrift => self.drift = Some(ExposureDrift::new(conditions)),
            EffectKind::LensDistortion => self.lens = Some(lens_distortion::distortion(scene)),
            EffectKind::MotionBlur => self.shutter = Some(conditions.shutter),
            EffectKind::SensorNoise => self.noise = Some(SensorNoise::new(conditions)),
        }
    }

    const fn runs(&self, effect: EffectKind) -> bool {
        match effect {
            EffectKind::SoftShadows => self.shadows,
            EffectKind::SpecularReflection => self.mirrors,
            EffectKind::IndirectLight => self.ambient.is_some(),
            EffectKind::ExposureDrift => self.drift.is_some(),
            EffectKind::LensDistortion => self.lens.is_some(),
            EffectKind::MotionBlur => self.shutter.is_some(),
            EffectKind::SensorNoise => self.noise.is_some(),
        }
    }

    /// The same effects through a lens that does not bend, for layouts that store none.
    pub(crate) fn without_lens(mut self) -> Self {
        let effect = EffectKind::LensDistortion;
        let needed = self.active.len();
        self.active.retain(|active| active.effect != effect);
        if self.active.len() < needed {
            self.absent.push(AbsentEffect { effect, reason: NO_LENS_IN_LAYOUT });
        }
        self.lens = None;
        self
    }

    /// The effects that run, also those of which nothing can be seen.
    pub(crate) fn kinds(&self) -> impl Iterator<Item = EffectKind> {
        EffectKind::ALL.into_iter().filter(|effect| self.runs(*effect))
    }

    /// The lens in front of the pinhole.
    pub(crate) fn lens(&self) -> Distortion {
        self.lens.unwrap_or(Distortion::None)
    }

    /// Seconds over which samples are spread.
    pub(crate) fn shutter(&self) -> f64 {
        self.shutter.unwrap_or(0.0)
    }

    /// Whether shadow rays run.
    pub(crate) const fn shadowed(&self) -> bool {
        self.shadows
    }

    /// Share of a lamp that a surface sees; `place` is the point of the lamp to test, in [0, 1)².
    pub(crate) fn visibility(&self, world: &World, lamp: &Lamp, surface: &Surface, place: DVec2) -> f32 {
        if self.shadows { soft_shadows::visibility(world, lamp, surface, place) } else { 1.0 }
    }

    /// Irradiance / π from everything except lamps.
    pub(crate) fn ambient(&self, world: &World, point: DVec3, normal: DVec3) -> Vec3 {
        self.ambient.as_ref().and_then(|light| light.ambient(world, point, normal)).unwrap_or(world.ambient)
    }

    /// A pixel's linear light as measured by the sensor, before the tone curve; 1 is white. Noise is that of the exposed light.
    pub(crate) fn sensor_value(&self, shot: &Shot, pixel: u64, light: Vec3) -> Vec3 {
        let exposed = self.drift.as_ref().map_or(light, |drift| drift.exposed(shot, light));
        self.noise.as_ref().map_or(exposed, |noise| noise.measured(shot, pixel, exposed))
    }
}

fn needed_by(effect: EffectKind, scene: &SceneContext<'_>) -> Option<String> {
    match effect {
        EffectKind::SoftShadows => soft_shadows::needed_by(scene),
        EffectKind::SpecularReflection => specular_reflection::needed_by(scene),
        EffectKind::IndirectLight => indirect_light::needed_by(scene),
        EffectKind::ExposureDrift => exposure_drift::needed_by(scene),
        EffectKind::LensDistortion => lens_distortion::needed_by(scene),
        EffectKind::MotionBlur => motion_blur::needed_by(scene),
        EffectKind::SensorNoise => sensor_noise::needed_by(scene),
    }
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics, WorldFromCamera};
    use atsplat_numeric::Tolerance;
    use glam::DMat3;

    use super::*;
    use crate::material::{Material, Pattern};
    use crate::sky::Sky;
    use crate::world::Builder;

    /// A floor; `mirror` and `lamps` are its reflectance and the lamps above it.
    fn world(mirror: f32, lamps: Vec<Lamp>) -> World {
        let mut builder = Builder::new();
        let material = Material { mirror, ..Material::matte(Pattern::Plain(Vec3::ONE), 0) };
        let material = builder.material(material);
        builder.instance(DVec3::ZERO, 0.0);
        builder.block(DVec3::new(-5.0, -5.0, -1.0), DVec3::new(5.0, 5.0, 0.0), material);
        builder.lamps = lamps;
        builder.finish(Sky::BLACK, Vec3::ONE, [DVec3::splat(-5.0), DVec3::splat(5.0)])
    }

    const SIZE: ImageSize = ImageSize { width: 256, height: 256 };

    fn camera() -> Camera {
        Camera::pinhole(CameraFromWorld::IDENTITY, NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).unwrap())
    }

    fn turned() -> WorldFromCamera {
        WorldFromCamera::new(DMat3::from_rotation_y(0.02), DVec3::ZERO).unwrap()
    }

    /// The start of a route from the origin to another pose.
    fn moving(moving_to: WorldFromCamera) -> Shot {
        Shot { timestamp_micros: 0, camera: camera(), moving_to, frame_seconds: 0.04 }
    }

    /// The effects of such a route.
    fn chosen(world: &World, conditions: &Conditions, moving_to: WorldFromCamera) -> Vec<ActiveEffect> {
        let scene = SceneContext { world, conditions, shots: &[moving(moving_to)], size: SIZE, samples: 4 };
        Effects::choose(&scene, &EffectChoice::Auto).active
    }

    fn needed(world: &World, conditions: &Conditions) -> Vec<EffectKind> {
        chosen(world, conditions, turned()).iter().map(|active| active.effect).collect()
    }

    /// What a scene has none of is not said to have run; the reasons of the others are those of `auto`.
    #[test]
    fn requested_effects_that_a_scene_has_none_of_are_absent() {
        let noisy = Conditions { lens: [0.0; 2], shutter: 0.0, noise: 0.01, drift: 0.0, bounce: 0.0, seed: 1 };
        let world = world(0.0, Vec::new());
        let shots = [Shot::still(0, camera())];
        let scene = SceneContext { world: &world, conditions: &noisy, shots: &shots, size: SIZE, samples: 4 };
        let chosen = |choice: EffectChoice| {
            let effects = Effects::choose(&scene, &choice);
            let absent: Vec<EffectKind> = effects.absent.iter().map(|absent| absent.effect).collect();
            let running = effects.kinds().count();
            (effects.active, absent, running)
        };
        let (needed, none, _) = chosen(EffectChoice::Auto);
        assert_eq!((needed[0].effect, needed.len(), &none[..]), (EffectKind::SensorNoise, 1, &[][..]));
        let requested = vec![EffectKind::ExposureDrift, EffectKind::SensorNoise];
        let expected = (needed.clone(), vec![EffectKind::ExposureDrift], 2);
        assert_eq!(chosen(EffectChoice::Only(requested)), expected);
        assert_eq!(chosen(EffectChoice::All), (needed, EffectKind::ALL[..6].to_vec(), 7));
        assert_eq!(chosen(EffectChoice::None), (Vec::new(), Vec::new(), 0));
    }

    /// Whatever else runs stays as it was.
    #[test]
    fn only_the_lens_is_left_out_for_a_layout_without_lenses() {
        let bent = Conditions { lens: [0.02, 0.0], shutter: 0.012, noise: 0.01, drift: 0.0, bounce: 1.0, seed: 7 };
        let world = world(0.04, vec![Lamp::Bulb { centre: DVec3::Z, radius: 0.1, radiance: Vec3::ONE }]);
        let shots = [moving(turned())];
        let scene = SceneContext { world: &world, conditions: &bent, shots: &shots, size: SIZE, samples: 4 };
        let [with, without] = [(); 2].map(|()| Effects::choose(&scene, &EffectChoice::Auto));
        let without = without.without_lens();
        assert!(with.lens() != Distortion::None && without.lens() == Distortion::None);
        let is_other = |active: &&ActiveEffect| active.effect != EffectKind::LensDistortion;
        assert_eq!(without.active, with.active.iter().filter(is_other).cloned().collect::<Vec<_>>());
        let absent = AbsentEffect { effect: EffectKind::LensDistortion, reason: NO_LENS_IN_LAYOUT };
        assert_eq!((&without.absent[..], &with.absent[..]), (&[absent][..], &[][..]));
        let kinds = |effects: &Effects| effects.kinds().collect::<Vec<_>>();
        let mut expected = kinds(&with);
        expected.retain(|kind| *kind != EffectKind::LensDistortion);
        assert_eq!(kinds(&without), expected);
        assert_eq!((without.shadows, without.mirrors), (with.shadows, with.mirrors));
        Tolerance::EXACT.assert([without.shutter()], [with.shutter()], "shutter");
        assert_eq!(without.seed, 7);
    }

    /// Noise of light that was exposed twice as long is not twice the noise; the order of requested names does not matter.
    #[test]
    fn noise_is_added_to_the_exposed_light() {
        let conditions = Conditions { lens: [0.0; 2], shutter: 0.0, noise: 0.05, drift: 1.0, bounce: 0.0, seed: 3 };
        let world = world(0.0, Vec::new());
        let shot = Shot::still(700_000, camera());
        let scene = SceneContext { world: &world, conditions: &conditions, shots: &[shot], size: SIZE, samples: 4 };
        let measured = |kinds: &[EffectKind], light: Vec3| {
            Effects::choose(&scene, &EffectChoice::Only(kinds.to_vec())).sensor_value(&shot, 5, light)
        };
        let (drift, noise) = (EffectKind::ExposureDrift, EffectKind::SensorNoise);
        let light = Vec3::new(0.125, 0.5, 0.75);
        let expected = measured(&[noise], measured(&[drift], light));
        let reversed = measured(&[drift], measured(&[noise], light));
        assert!((expected - reversed).abs().max_element() > 1e-3, "{expected}, {reversed}");
        for requested in [[noise, drift], [drift, noise]] {
            let found = measured(&requested, light).as_dvec3().to_array();
            Tolerance::EXACT.assert(found, expected.as_dvec3().to_array(), &format!("{requested:?}"));
        }
    }

    /// They move what is seen at the border of an image, not at its centre.
    #[test]
    fn a_dolly_and_a_roll_need_motion_blur() {
        let open = Conditions { lens: [0.0; 2], shutter: 0.012, noise: 0.0, drift: 0.0, bounce: 0.0, seed: 1 };
        let world = world(0.0, Vec::new());
        let to = |turn: DMat3, z: f64| WorldFromCamera::new(turn, DVec3::new(0.0, 0.0, z)).unwrap();
        let roll = |angle: f64| to(DMat3::from_rotation_z(angle), 0.0);
        for moved in [to(DMat3::IDENTITY, 0.05), to(DMat3::IDENTITY, -0.05), roll(0.01), roll(-0.01)] {
            let active = chosen(&world, &open, moved);
            assert_eq!(active.iter().map(|active| active.effect).collect::<Vec<_>>(), [EffectKind::MotionBlur]);
            assert_eq!(chosen(&world, &Conditions { shutter: 0.0, ..open }, moved), []);
        }
        for still in [roll(0.0), roll(0.001), to(DMat3::IDENTITY, 1e-4)] {
            assert_eq!(chosen(&world, &open, still), [], "{still:?}");
        }
        let behind = to(DMat3::from_rotation_y(std::f64::consts::PI), 0.0);
        let reason = "up to 30.0 % of the image width in 12 ms of exposure";
        assert_eq!(chosen(&world, &open, behind)[0].reason, reason);
    }

    /// The only sample of a pixel is in the middle of the exposure.
    #[test]
    fn one_ray_per_pixel_has_no_motion_blur_and_says_so() {
        let conditions = Conditions { lens: [0.0; 2], shutter: 0.012, noise: 0.01, drift: 0.0, bounce: 0.0, seed: 1 };
        let world = world(0.0, Vec::new());
        let shots = [moving(turned())];
        let (blur, noise) = (EffectKind::MotionBlur, EffectKind::SensorNoise);
        for choice in [EffectChoice::Auto, EffectChoice::Only(vec![blur, noise])] {
            for (samples, is_blurred) in [(1, false), (2, true)] {
                let scene = SceneContext { world: &world, conditions: &conditions, shots: &shots, size: SIZE, samples };
                let effects = Effects::choose(&scene, &choice);
                let active: Vec<EffectKind> = effects.active.iter().map(|active| active.effect).collect();
                assert_eq!(active, if is_blurred { vec![blur, noise] } else { vec![noise] }, "{choice}, {samples}");
                let absent = AbsentEffect { effect: blur, reason: ONE_MOMENT };
                assert_eq!(effects.absent, if is_blurred { vec![] } else { vec![absent] }, "{choice}, {samples}");
                assert_eq!(effects.kinds().collect::<Vec<_>>(), active, "{choice}, {samples}");
            }
        }
    }

    /// One that is not would never run.
    #[test]
    fn all_effects_are_in_the_list_of_all() {
        let unknown = serde_json::from_value::<EffectKind>("".into()).unwrap_err().to_string();
        let all = EffectKind::ALL.map(|kind| format!("`{}`", kind.name())).join(", ");
        assert_eq!(unknown, format!("unknown variant ``, expected one of {all}"));
    }

    /// Each condition needs one effect, just above its bound and not below: effects of the sensor at any strength.
    #[test]
    fn a_scene_runs_the_effects_that_it_needs_and_no_others() {
        let plain = Conditions { lens: [0.0; 2], shutter: 0.0, noise: 0.0, drift: 0.0, bounce: 0.0, seed: 1 };
        let (matte, bulb) = (world(0.0, Vec::new()), Lamp::Bulb { centre: DVec3::Z, radius: 0.1, radiance: Vec3::ONE });
        assert_eq!(needed(&matte, &plain), []);
        assert_eq!(needed(&world(0.0, vec![bulb]), &plain), [EffectKind::SoftShadows]);
        assert_eq!(needed(&world(0.04, Vec::new()), &plain), [EffectKind::SpecularReflection]);
        let cases = [
            (Conditions { bounce: 1.0, ..plain }, plain, EffectKind::IndirectLight),
            (Conditions { drift: 1e-3, ..plain }, plain, EffectKind::ExposureDrift),
            (
                Conditions { lens: [0.0005, 0.0], ..plain },
                Conditions { lens: [0.0004, 0.0], ..plain },
                EffectKind::LensDistortion,
            ),
            (Conditions { shutter: 0.004, ..plain }, Conditions { shutter: 0.0004, ..plain }, EffectKind::MotionBlur),
            (Conditions { noise: 1e-3, ..plain }, plain, EffectKind::SensorNoise),
        ];
        for (enough, less, effect) in cases {
            assert_eq!(needed(&matte, &enough), [effect], "{enough:?}");
            assert_eq!(needed(&matte, &less), [], "{less:?}");
        }
    }
}
