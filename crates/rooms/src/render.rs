use std::sync::OnceLock;

use atsplat_camera::{Distortion, ImageSize, Lens, PixelIntrinsics, WorldFromCamera};
use atsplat_numeric::unit_of_bits;
use atsplat_pixels::Image;
use glam::{DMat2, DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::RoomsError;
use crate::effects::Effects;
use crate::material::{Material, srgb_encoded};
use crate::noise::as_f32;
use crate::path::Shot;
use crate::rng::mix;
use crate::sampling::{self, Sample};
use crate::world::{Surface, World};

/// Surfaces hit by the rays through the pixels' centres in the middle of the exposure; row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Geometry {
    /// Columns and rows.
    pub size: ImageSize,
    /// Depth along the camera's z axis, in metres; infinite for the sky.
    pub depth: Vec<f32>,
    /// Unit normals in the world, on the camera's side; zero for the sky.
    pub normals: Vec<[f32; 3]>,
    /// Instance indices, from 1; 0 for the sky.
    pub instances: Vec<u32>,
}

/// Maps pixels to ray directions.
pub(crate) struct Rays {
    k: PixelIntrinsics,
    lens: Option<Lens>,
}

impl Rays {
    pub(crate) fn new(shot: &Shot, lens: Distortion, size: ImageSize) -> Result<Self, RoomsError> {
        let lens = if lens == Distortion::None { None } else { Some(lens.lens()?) };
        Ok(Self { k: shot.camera.intrinsics.pixel_from_normalized(size), lens })
    }

    /// The point of the plane z = 1 behind a pixel's centre.
    pub(crate) fn centre(&self, column: u32, row: u32) -> Result<DVec2, RoomsError> {
        Ok(self.pixel(column, row)?.0)
    }

    /// The point of the plane z = 1 behind a pixel's centre, and its derivative with respect to pixel coordinates.
    fn pixel(&self, column: u32, row: u32) -> Result<(DVec2, DMat2), RoomsError> {
        let k = &self.k;
        let centre = DVec2::new(f64::from(column) + 0.5 - k.cx, f64::from(row) + 0.5 - k.cy);
        let bent = centre / DVec2::new(k.fx, k.fy);
        let straight_from_pixels = DMat2::from_diagonal(DVec2::new(1.0 / k.fx, 1.0 / k.fy));
        match &self.lens {
            None => Ok((bent, straight_from_pixels)),
            Some(lens) => {
                let straight = lens.undistorted_from_distorted(bent)?;
                Ok((straight, lens.jacobian(straight)?.inverse() * straight_from_pixels))
            }
        }
    }
}

/// Tone curve of cameras: linear up to a knee, then saturating towards white.
fn tone_curve(light: f32) -> f32 {
    const KNEE: f32 = 0.7;
    if light <= KNEE { light } else { KNEE + (1.0 - KNEE) * (1.0 - (-(light - KNEE) / (1.0 - KNEE)).exp()) }
}

/// One frame while it is rendered.
pub(crate) struct Frame<'a> {
    pub world: &'a World,
    pub effects: &'a Effects,
    pub size: ImageSize,
    pub samples: u32,
    /// Width of a pixel at a distance of 1.
    pub spread: f64,
    rays: Rays,
    lens_table: Option<&'a LensTable>,
    /// The camera's pose and the place in the pixel of each sample.
    samples_at: Vec<(WorldFromCamera, DVec2)>,
    seed: u64,
}

/// A pixel's centre on the plane z = 1, and the derivative with respect to pixel coordinates.
type PixelPlane = (DVec2, DMat2);

/// All pixels through a lens, whose inverse is iterative and takes up to a fifth of a frame. Frames of a clip share it.
#[derive(Debug)]
pub(crate) struct LensTable {
    k: PixelIntrinsics,
    lens: Distortion,
    size: ImageSize,
    /// Row by row.
    pixels: Vec<PixelPlane>,
}

impl LensTable {
    fn new(frame: &Frame<'_>) -> Result<Self, RoomsError> {
        let size = frame.size;
        let row = |row| (0..size.width).map(|column| frame.rays.pixel(column, row)).collect::<Result<Vec<_>, _>>();
        let rows = (0..size.height).into_par_iter().map(row).collect::<Result<Vec<_>, _>>()?;
        Ok(Self { k: frame.rays.k, lens: frame.effects.lens(), size, pixels: rows.concat() })
    }
}

/// A ray through a pixel.
pub(crate) struct CameraRay {
    pub origin: DVec3,
    pub direction: DVec3,
    /// The point of each lamp towards which its shadow rays go, in [0, 1)².
    pub place_on_lamps: DVec2,
}

impl<'a> Frame<'a> {
    pub(crate) fn new(
        world: &'a World,
        effects: &'a Effects,
        shot: &Shot,
        size: ImageSize,
        samples: u32,
    ) -> Result<Self, RoomsError> {
        let rays = Rays::new(shot, effects.lens(), size)?;
        let from = shot.camera.camera_from_world.inverse();
        let open = shot.share_of_motion(effects.shutter());
        let sample_at = |Sample { place, time }| Ok((interpolated_pose(&from, &shot.moving_to, open * time)?, place));
        let samples_at = sampling::samples(samples).into_iter().map(sample_at).collect::<Result<_, RoomsError>>()?;
        let seed = mix(effects.seed ^ mix(shot.timestamp_micros.cast_unsigned()));
        let spread = 0.7 / (rays.k.fx * f64::from(samples).sqrt()).clamp(1.0, f64::MAX);
        Ok(Self { world, effects, size, samples, spread, rays, lens_table: None, samples_at, seed })
    }

    /// The frame with its lens looked up in `table`, which is filled by the first frame with a lens.
    pub(crate) fn with_lens_table(self, table: &'a OnceLock<LensTable>) -> Result<Self, RoomsError> {
        if self.rays.lens.is_none() {
            return Ok(self);
        }
        let filled = if let Some(filled) = table.get() {
            filled
        } else {
            let made = LensTable::new(&self)?;
            table.get_or_init(|| made)
        };
        let fits = (filled.k, filled.lens, filled.size) == (self.rays.k, self.effects.lens(), self.size);
        Ok(Self { lens_table: fits.then_some(filled), ..self })
    }

    pub(crate) fn pixel(&self, column: u32, row: u32) -> Result<PixelPlane, RoomsError> {
        match self.lens_table {
            Some(table) => Ok(table.pixels[row as usize * self.size.width as usize + column as usize]),
            None => self.rays.pixel(column, row),
        }
    }

    /// A sample's ray through a pixel with this [`Self::pixel`].
    pub(crate) fn ray(&self, [column, row]: [u32; 2], (centre, moves): PixelPlane, sample: u32) -> CameraRay {
        let (pose, place) = &self.samples_at[sample as usize];
        let plane = centre + moves * *place;
        let direction = pose.transform_vector(plane.extend(1.0)).normalize();
        let index = u64::from(row) * u64::from(self.size.width) + u64::from(column);
        // The samples of a pixel cover a lamp as they cover the pixel, shifted by an offset of each pixel.
        let bits = mix(self.seed ^ index);
        let offset = DVec2::new(unit_of_bits(bits), unit_of_bits(mix(bits)));
        CameraRay { origin: pose.centre(), direction, place_on_lamps: (*place + 0.5 + offset).fract() }
    }

    /// Linear light before exposure, row by row: the mean of the pixel's samples, each with every effect.
    pub(crate) fn light(&self) -> Result<Vec<Vec3>, RoomsError> {
        let rows = (0..self.size.height).into_par_iter().map(|row| {
            let pixel = |column: u32| {
                let plane = self.pixel(column, row)?;
                let sum: Vec3 =
                    (0..self.samples).map(|sample| self.radiance(&self.ray([column, row], plane, sample))).sum();
                Ok(sum / self.samples as f32)
            };
            (0..self.size.width).map(pixel).collect::<Result<Vec<Vec3>, RoomsError>>()
        });
        Ok(rows.collect::<Result<Vec<_>, _>>()?.concat())
    }

    /// Radiance along a ray.
    fn radiance(&self, ray: &CameraRay) -> Vec3 {
        let Self { world, effects, .. } = *self;
        let Some(surface) = world.trace(ray.origin, ray.direction) else { return self.sky(ray) };
        let view = Incidence::new(&surface, ray.direction, self.spread);
        let material = world.material(&surface);
        let diffuse = reflected_light(world, effects, &surface, material, view.footprint, Some(ray.place_on_lamps));
        if !effects.mirrors || material.mirror <= 0.0 {
            return diffuse;
        }
        let fresnel = view.fresnel(material);
        let shown = world.trace(surface.leave(), view.bounced);
        diffuse * (1.0 - fresnel) + self.mirrored(shown.as_ref(), &view) * fresnel
    }

    pub(crate) fn sky(&self, ray: &CameraRay) -> Vec3 {
        self.world.sky.radiance(ray.direction, as_f32(self.spread))
    }

    /// Radiance from what a mirror shows; `None` is the sky.
    pub(crate) fn mirrored(&self, shown: Option<&Surface>, view: &Incidence) -> Vec3 {
        let Self { world, effects, spread, .. } = *self;
        shown.map_or_else(
            || world.sky.radiance(view.bounced, as_f32(spread)),
            |shown| {
                let wide = view.footprint + as_f32(spread * shown.distance);
                reflected_light(world, effects, shown, world.material(shown), wide, None)
            },
        )
    }
}

/// How a ray meets a surface.
pub(crate) struct Incidence {
    /// Cosine between the normal and the ray back.
    facing: f64,
    /// Width of a pixel on the surface, in metres.
    pub footprint: f32,
    /// Direction of reflection.
    pub bounced: DVec3,
}

impl Incidence {
    pub(crate) fn new(surface: &Surface, direction: DVec3, spread: f64) -> Self {
        let facing = -surface.normal.dot(direction);
        let footprint = as_f32(spread * surface.distance / facing.clamp(0.05, 1.0).sqrt());
        Self { facing, footprint, bounced: direction + surface.normal * (2.0 * facing) }
    }

    /// Share of light that a material reflects specularly: m + (1 − m) · (1 − cos θ)⁵ · min(1, 3m) for the reflectance m at
    /// normal incidence. The first two terms are Schlick's approximation. The last stands for roughness, which dims grazing
    /// reflection: dull surfaces are rough, so that a floor of m = 0.03 tends to 0.12 and not to 1; from m = 1/3 on it is 1.
    pub(crate) fn fresnel(&self, material: &Material) -> f32 {
        material.mirror
            + (1.0 - material.mirror) * as_f32(1.0 - self.facing).powi(5) * (3.0 * material.mirror).clamp(0.0, 1.0)
    }
}

/// The image of linear light: multiplied by `gain`, measured by the sensor with its effects, then through the tone curve and
/// sRGB-encoded.
pub(crate) fn image_of_light(
    light: &[Vec3],
    effects: &Effects,
    shot: &Shot,
    size: ImageSize,
    gain: f32,
) -> Result<Image, RoomsError> {
    let encoded = light.par_iter().enumerate().flat_map_iter(|(pixel, &light)| {
        let measured = effects.sensor_value(shot, pixel as u64, light * gain);
        measured.map(tone_curve).map(srgb_encoded).to_array()
    });
    Ok(Image::new(size.width, size.height, encoded.collect())?)
}

/// Computes depth, normals and instances behind the pixels' centres.
#[expect(clippy::cast_possible_truncation, reason = "depths and normals are stored as f32")]
pub(crate) fn geometry(world: &World, lens: Distortion, shot: &Shot, size: ImageSize) -> Result<Geometry, RoomsError> {
    let rays = Rays::new(shot, lens, size)?;
    let pose = shot.camera.camera_from_world.inverse();
    let pixels = (0..size.height).into_par_iter().flat_map_iter(|row| (0..size.width).map(move |column| (column, row)));
    let hits = pixels.map(|(column, row)| {
        let (plane, _) = rays.pixel(column, row)?;
        let ray = plane.extend(1.0);
        let surface = world.trace(pose.centre(), pose.transform_vector(ray).normalize());
        Ok(surface.map_or((f32::INFINITY, [0.0; 3], 0), |surface| {
            let depth = surface.distance / ray.length();
            (depth as f32, surface.normal.as_vec3().to_array(), surface.instance)
        }))
    });
    let hits = hits.collect::<Result<Vec<_>, RoomsError>>()?;
    let mut geometry = Geometry { size, depth: Vec::new(), normals: Vec::new(), instances: Vec::new() };
    for (depth, normal, instance) in hits {
        geometry.depth.push(depth);
        geometry.normals.push(normal);
        geometry.instances.push(instance);
    }
    Ok(geometry)
}

/// The pose at a share of the motion from one frame to the next; below zero it is the pose before the first, at the same speed.
fn interpolated_pose(from: &WorldFromCamera, to: &WorldFromCamera, share: f64) -> Result<WorldFromCamera, RoomsError> {
    if share.abs() <= 0.0 {
        return Ok(*from);
    }
    let turn = glam::DQuat::from_mat3(&from.rotation()).slerp(glam::DQuat::from_mat3(&to.rotation()), share);
    Ok(WorldFromCamera::new(glam::DMat3::from_quat(turn), from.centre().lerp(to.centre(), share))?)
}

/// Share of a lamp's light that arrives at a surface seen in a mirror, if shadows run. Shadow rays of reflections would cost
/// more than they show, so that their shadows are spread evenly.
const MIRRORED_VISIBILITY: f32 = 0.6;

/// Light reflected diffusely and emitted by a surface; `place_on_lamps` is `None` if it is seen in a mirror.
fn reflected_light(
    world: &World,
    effects: &Effects,
    surface: &Surface,
    material: &Material,
    footprint: f32,
    place_on_lamps: Option<DVec2>,
) -> Vec3 {
    let ambient = effects.ambient(world, surface.point, surface.normal);
    let enough = ambient.max_element() * 0.01;
    let mut arriving = ambient;
    for lamp in &world.lamps {
        let reached = lamp.reaches(surface.point, surface.normal);
        if reached.max_element() > enough {
            let visible = match place_on_lamps {
                Some(place) => effects.visibility(world, lamp, surface, place),
                None if effects.shadowed() => MIRRORED_VISIBILITY,
                None => 1.0,
            };
            arriving += reached * visible;
        }
    }
    material.albedo(&surface.texture_point(footprint)) * arriving + material.emission
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, NormalizedIntrinsics};
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::effects::{Conditions, EffectChoice, EffectKind, SceneContext};
    use crate::lamp::Lamp;
    use crate::material::Pattern;
    use crate::sky::Sky;
    use crate::world::Builder;

    /// A black mirror on the floor in front of a coloured wall, which a lamp that nothing hides lights.
    fn mirror_and_wall() -> World {
        let mut builder = Builder::new();
        let mirror = builder.material(Material { mirror: 0.4, ..Material::matte(Pattern::Plain(Vec3::ZERO), 0) });
        let wall = builder.material(Material::matte(Pattern::Plain(Vec3::new(0.8, 0.5, 0.2)), 0));
        builder.instance(DVec3::ZERO, 0.0);
        builder.block(DVec3::new(-5.0, -5.0, -1.0), DVec3::new(5.0, 5.0, 0.0), mirror);
        builder.block(DVec3::new(-5.0, 4.0, 0.0), DVec3::new(5.0, 5.0, 5.0), wall);
        let radiance = Vec3::new(5000.0, 4000.0, 3000.0);
        builder.lamps = vec![Lamp::Bulb { centre: DVec3::new(1.0, 1.0, 2.0), radius: 0.1, radiance }];
        builder.finish(Sky::BLACK, Vec3::ZERO, [DVec3::splat(-5.0), DVec3::splat(5.0)])
    }

    /// The radiance of the wall seen in the mirror, and seen directly from the mirror times the mirror's Fresnel term.
    fn mirrored_and_direct(kinds: &[EffectKind]) -> [Vec3; 2] {
        let world = mirror_and_wall();
        let size = ImageSize { width: 16, height: 16 };
        let pose = WorldFromCamera::new(glam::DMat3::IDENTITY, DVec3::Z).unwrap();
        let camera = Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).unwrap());
        let shot = Shot { timestamp_micros: 0, camera, moving_to: pose, frame_seconds: 0.0 };
        let conditions = Conditions { lens: [0.0; 2], shutter: 0.0, noise: 0.0, drift: 0.0, bounce: 0.0, seed: 1 };
        let scene = SceneContext { world: &world, conditions: &conditions, shots: &[shot], size, samples: 1 };
        let effects = Effects::choose(&scene, &EffectChoice::Only(kinds.to_vec()));
        let frame = Frame::new(&world, &effects, &shot, size, 1).unwrap();
        let place_on_lamps = DVec2::splat(0.5);
        let direction = DVec3::new(0.1, 1.0, -0.5).normalize();
        let floor = world.trace(DVec3::Z, direction).unwrap();
        let view = Incidence::new(&floor, direction, frame.spread);
        let mirrored = frame.radiance(&CameraRay { origin: DVec3::Z, direction, place_on_lamps });
        let direct = frame.radiance(&CameraRay { origin: floor.leave(), direction: view.bounced, place_on_lamps });
        [mirrored, direct * view.fresnel(world.material(&floor))]
    }

    /// At 0°, 60° and 85° of incidence: a floor, whose grazing reflection is damped, and a mirror with all of Schlick's.
    #[test]
    fn grazing_reflection_of_dull_surfaces_is_damped() {
        for (mirror, expected) in [(0.03, [0.03, 0.032_728, 0.085_335]), (0.4, [0.4, 0.418_75, 0.780_307])] {
            let material = Material { mirror, ..Material::matte(Pattern::Plain(Vec3::ZERO), 0) };
            let found = [0.0f64, 60.0, 85.0].map(|angle| {
                let view = Incidence { facing: angle.to_radians().cos(), footprint: 0.0, bounced: DVec3::Z };
                f64::from(view.fresnel(&material))
            });
            Tolerance::absolute(2e-6).assert(found, expected, &format!("{mirror}"));
        }
    }

    #[test]
    fn a_mirror_dims_lamps_only_if_shadows_run() {
        let shares = [
            (&[EffectKind::SpecularReflection][..], 1.0),
            (&[EffectKind::SoftShadows, EffectKind::SpecularReflection][..], f64::from(MIRRORED_VISIBILITY)),
        ];
        for (kinds, share) in shares {
            let [mirrored, direct] = mirrored_and_direct(kinds).map(Vec3::as_dvec3);
            assert!(direct.min_element() > 0.01, "{kinds:?}: {direct}");
            Tolerance::relative(1e-5).assert(mirrored.to_array(), (direct * share).to_array(), &format!("{kinds:?}"));
        }
    }
}
