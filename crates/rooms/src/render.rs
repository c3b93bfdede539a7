use atsplat_camera::{Distortion, ImageSize, Lens, PixelIntrinsics, WorldFromCamera};
use atsplat_pixels::Image;
use glam::{DMat2, DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::RoomsError;
use crate::effects::{Effects, PixelSample};
use crate::material::{Material, srgb_encoded};
use crate::noise::as_f32;
use crate::path::Shot;
use crate::rng::mix;
use crate::world::{Surface, World};

/// Picture and geometry of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// sRGB-encoded, in [0, 1].
    pub picture: Image,
    /// Geometry behind each pixel.
    pub geometry: Geometry,
}

/// Surfaces hit by the rays through the pixels' centres when the shutter opens; row-major.
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

/// Position of a sample in its pixel: Roberts' R2 sequence, uniform for any count.
fn place_in_pixel(sample: u32) -> DVec2 {
    let n = f64::from(sample) + 0.5;
    DVec2::new((0.5 + n * 0.754_877_666_246_692_8).fract(), (0.5 + n * 0.569_840_290_998_053_2).fract()) - 0.5
}

/// Renders linear light before exposure: the mean of `samples` rays per pixel.
pub(crate) fn light(
    world: &World,
    effects: &Effects,
    shot: &Shot,
    size: ImageSize,
    samples: u32,
) -> Result<Vec<Vec3>, RoomsError> {
    let rays = Rays::new(shot, effects.lens, size)?;
    let from = shot.camera.camera_from_world.inverse();
    let poses: Vec<WorldFromCamera> = (0..samples)
        .map(|sample| {
            interpolated_pose(&from, &shot.moving_to, effects.shutter * f64::from(sample) / f64::from(samples))
        })
        .collect::<Result<_, _>>()?;
    let frame = mix(shot.timestamp_micros.cast_unsigned());
    let spread = 0.7 / (rays.k.fx * f64::from(samples).sqrt()).clamp(1.0, f64::MAX);
    let rows = (0..size.height).into_par_iter().map(|row| {
        let pixel = |column: u32| {
            let (centre, moves) = rays.pixel(column, row)?;
            let index = u64::from(row) * u64::from(size.width) + u64::from(column);
            let mut sum = Vec3::ZERO;
            for (sample, pose) in (0..samples).zip(&poses) {
                let plane = centre + moves * place_in_pixel(sample);
                let direction = pose.transform_vector(plane.extend(1.0)).normalize();
                let dice = PixelSample { pixel: mix(frame ^ index), sample };
                sum += radiance(world, effects, pose.centre(), direction, spread, dice);
            }
            Ok(sum / samples as f32)
        };
        (0..size.width).map(pixel).collect::<Result<Vec<Vec3>, RoomsError>>()
    });
    Ok(rows.collect::<Result<Vec<_>, _>>()?.concat())
}

/// Renders a picture: light, multiplied by `gain`, developed by effects of the sensor, sRGB-encoded.
pub(crate) fn picture(
    world: &World,
    effects: &Effects,
    shot: &Shot,
    size: ImageSize,
    samples: u32,
    gain: f32,
) -> Result<Image, RoomsError> {
    let light = light(world, effects, shot, size, samples)?;
    let developed = light.par_iter().enumerate().flat_map_iter(|(pixel, &light)| {
        let counted = effects.develop(shot, pixel as u64, (light * gain).map(tone_curve));
        counted.map(srgb_encoded).to_array()
    });
    Ok(Image::new(size.width, size.height, developed.collect())?)
}

/// Computes depth, normals and instances behind the pixels' centres.
#[expect(clippy::cast_possible_truncation, reason = "depths and normals are stored as f32")]
pub(crate) fn geometry(world: &World, lens: Distortion, shot: &Shot, size: ImageSize) -> Result<Geometry, RoomsError> {
    let rays = Rays::new(shot, lens, size)?;
    let pose = shot.camera.camera_from_world.inverse();
    let pixels = (0..size.height).into_par_iter().flat_map_iter(|row| (0..size.width).map(move |column| (column, row)));
    let met = pixels.map(|(column, row)| {
        let (plane, _) = rays.pixel(column, row)?;
        let ray = plane.extend(1.0);
        let surface = world.trace(pose.centre(), pose.transform_vector(ray).normalize());
        Ok(surface.map_or((f32::INFINITY, [0.0; 3], 0), |surface| {
            let depth = surface.distance / ray.length();
            (depth as f32, surface.normal.as_vec3().to_array(), surface.instance)
        }))
    });
    let met = met.collect::<Result<Vec<_>, RoomsError>>()?;
    let mut geometry = Geometry { size, depth: Vec::new(), normals: Vec::new(), instances: Vec::new() };
    for (depth, normal, instance) in met {
        geometry.depth.push(depth);
        geometry.normals.push(normal);
        geometry.instances.push(instance);
    }
    Ok(geometry)
}

/// The pose at a share of the motion to the next; rotations between frames are small.
fn interpolated_pose(from: &WorldFromCamera, to: &WorldFromCamera, share: f64) -> Result<WorldFromCamera, RoomsError> {
    if share <= 0.0 {
        return Ok(*from);
    }
    let turn = glam::DQuat::from_mat3(&from.rotation()).slerp(glam::DQuat::from_mat3(&to.rotation()), share);
    Ok(WorldFromCamera::new(glam::DMat3::from_quat(turn), from.centre().lerp(to.centre(), share))?)
}

/// Radiance along a unit direction. A pixel is `spread` wide at a distance of 1.
fn radiance(world: &World, effects: &Effects, origin: DVec3, direction: DVec3, spread: f64, dice: PixelSample) -> Vec3 {
    let Some(surface) = world.trace(origin, direction) else {
        return world.sky.radiance(direction, as_f32(spread));
    };
    let material = world.material(&surface);
    let facing = -surface.normal.dot(direction);
    let footprint = as_f32(spread * surface.distance / facing.clamp(0.05, 1.0).sqrt());
    let diffuse = reflected_light(world, effects, &surface, material, footprint, Some(dice));
    if !effects.mirrors || material.mirror <= 0.0 {
        return diffuse;
    }
    let fresnel = material.mirror
        + (1.0 - material.mirror) * as_f32(1.0 - facing).powi(5) * (3.0 * material.mirror).clamp(0.0, 1.0);
    let bounced = direction + surface.normal * (2.0 * facing);
    let mirrored = world.trace(surface.leave(), bounced).map_or_else(
        || world.sky.radiance(bounced, as_f32(spread)),
        |other| {
            let wide = footprint + as_f32(spread * other.distance);
            reflected_light(world, effects, &other, world.material(&other), wide, None)
        },
    );
    diffuse * (1.0 - fresnel) + mirrored * fresnel
}

/// Light reflected diffusely and emitted by a surface. Surfaces seen in a mirror have no shadows.
fn reflected_light(
    world: &World,
    effects: &Effects,
    surface: &Surface,
    material: &Material,
    footprint: f32,
    dice: Option<PixelSample>,
) -> Vec3 {
    let ambient = effects.ambient(world, surface.point, surface.normal);
    let enough = ambient.max_element() * 0.01;
    let mut arriving = ambient;
    for lamp in &world.lamps {
        let reached = lamp.reaches(surface.point, surface.normal);
        if reached.max_element() > enough {
            arriving += reached * dice.map_or(0.6, |dice| effects.visibility(world, lamp, surface, dice));
        }
    }
    material.albedo(&surface.texture_point(footprint)) * arriving + material.emission
}
