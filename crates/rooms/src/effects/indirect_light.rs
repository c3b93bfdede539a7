//! Light of the sky and two bounces on a grid of points, each with the light from six sides (an "ambient cube").

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::{Effect, EffectKind, SceneContext};
use crate::rng::sphere_point;
use crate::world::World;

/// Irradiance / π from +x, −x, +y, −y, +z, −z; `None` inside a solid.
type AmbientCube = Option<[Vec3; 6]>;

#[derive(Debug)]
pub(super) struct IndirectLight {
    low: DVec3,
    step: DVec3,
    count: [usize; 3],
    cubes: Vec<AmbientCube>,
    share: f32,
}

/// Rays from each point of the grid.
const RAYS: u32 = 128;
/// Smallest distance of grid points, in metres, and largest number of points per axis.
const STEP: f64 = 0.6;
const MAX_POINTS: usize = 14;

pub(super) fn needed_by(scene: &SceneContext<'_>) -> Option<String> {
    let share = scene.conditions.bounce;
    (share > 0.0).then(|| "surfaces reflect light onto each other".to_owned())
}

impl IndirectLight {
    pub(super) fn new(world: &World, share: f64) -> Self {
        let [low, high] = world.space;
        let side = high - low;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a small count")]
        let points = |length: f64| ((length / STEP).ceil() as usize + 1).clamp(2, MAX_POINTS);
        let count = [points(side.x), points(side.y), points(side.z)];
        let step = side / DVec3::new((count[0] - 1) as f64, (count[1] - 1) as f64, (count[2] - 1) as f64);
        #[expect(clippy::cast_possible_truncation, reason = "a share")]
        let mut light = Self { low, step, count, cubes: Vec::new(), share: share as f32 };
        for _ in 0..2 {
            let cubes = (0..count.iter().product()).into_par_iter().map(|at| light.cube(world, at)).collect();
            light.cubes = cubes;
        }
        light
    }

    fn place(&self, at: usize) -> DVec3 {
        let [x, y, _] = self.count;
        // Points on the border would be inside the walls.
        let inset = |at: usize, count: usize| (at as f64).clamp(0.15, (count - 1) as f64 - 0.15);
        let steps = DVec3::new(inset(at % x, x), inset(at / x % y, y), inset(at / (x * y), self.count[2]));
        self.low + self.step * steps
    }

    fn cube(&self, world: &World, at: usize) -> AmbientCube {
        let origin = self.place(at);
        if world.clearance(origin) <= 0.0 {
            return None;
        }
        let mut cube = [Vec3::ZERO; 6];
        for ray in 0..RAYS {
            // Fibonacci lattice on the sphere.
            let turn = (f64::from(ray) * 0.618_033_988_749_895).fract();
            let direction = sphere_point(glam::DVec2::new((f64::from(ray) + 0.5) / f64::from(RAYS), turn));
            let light = self.arriving(world, origin, direction);
            let d = direction.as_vec3();
            // The mean of max(cos, 0) over the sphere is 1/4.
            let weights = [d.x, -d.x, d.y, -d.y, d.z, -d.z];
            for (side, weight) in cube.iter_mut().zip(weights) {
                *side += light * (weight.clamp(0.0, 1.0) * 4.0 / RAYS as f32);
            }
        }
        Some(cube)
    }

    fn arriving(&self, world: &World, origin: DVec3, direction: DVec3) -> Vec3 {
        let Some(surface) = world.trace(origin, direction) else {
            return world.sky.radiance(direction, 0.1);
        };
        let material = world.material(&surface);
        let lamps = world.lamps.iter().map(|lamp| {
            let reached = lamp.reaches(surface.point, surface.normal);
            let to_lamp = lamp.towards(surface.point, glam::DVec2::splat(0.5));
            if reached.max_element() <= 0.0 || world.blocked(surface.leave(), to_lamp) { Vec3::ZERO } else { reached }
        });
        let indirect = self.at(surface.point, surface.normal).unwrap_or(Vec3::ZERO);
        // Emission is excluded: lamps already give their light, and their bodies must not add it again.
        material.albedo(&surface.texture_point(0.3)) * (lamps.sum::<Vec3>() + indirect)
    }

    /// Trilinear interpolation over the points outside solids, slightly off the surface.
    fn at(&self, point: DVec3, normal: DVec3) -> Option<Vec3> {
        if self.cubes.is_empty() {
            return None;
        }
        let last = DVec3::from(self.count.map(|count| (count - 1) as f64));
        let place = ((point + normal * 0.2 - self.low) / self.step).clamp(DVec3::ZERO, last - DVec3::splat(1e-6));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the grid")]
        let [x, y, z] = place.to_array().map(|place| place as u32 as usize);
        let share = (place - DVec3::new(x as f64, y as f64, z as f64)).as_vec3();
        let n = normal.as_vec3();
        let squared = n * n;
        let sides = [usize::from(n.x < 0.0), 2 + usize::from(n.y < 0.0), 4 + usize::from(n.z < 0.0)];
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
        for corner in 0..8usize {
            let (dx, dy, dz) = (corner & 1, corner >> 1 & 1, corner >> 2);
            let index = x + dx + self.count[0] * (y + dy + self.count[1] * (z + dz));
            let Some(Some(cube)) = self.cubes.get(index) else { continue };
            let along = |share: f32, far: usize| if far == 1 { share } else { 1.0 - share };
            let weight = along(share.x, dx) * along(share.y, dy) * along(share.z, dz);
            let light = cube[sides[0]] * squared.x + cube[sides[1]] * squared.y + cube[sides[2]] * squared.z;
            sum += light * weight;
            weights += weight;
        }
        (weights > 1e-4).then(|| sum / weights)
    }
}

impl Effect for IndirectLight {
    fn kind(&self) -> EffectKind {
        EffectKind::IndirectLight
    }

    fn ambient(&self, world: &World, point: DVec3, normal: DVec3) -> Option<Vec3> {
        Some(world.ambient.lerp(self.at(point, normal)?, self.share))
    }
}
