//! Light of the sky and two bounces on a grid of points in each interior: for each point, that from six sides (an "ambient cube").

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::SceneContext;
use crate::noise::as_f32;
use crate::rng::sphere_point;
use crate::world::World;

/// Irradiance / π from +x, −x, +y, −y, +z, −z; `None` inside a solid.
type AmbientCube = Option<[Vec3; 6]>;

#[derive(Debug)]
pub(super) struct IndirectLight {
    grids: Vec<Grid>,
    share: f32,
}

/// Points in one interior: light does not pass from the points of another through a wall.
#[derive(Debug)]
struct Grid {
    /// The interior's corners.
    interior: [DVec3; 2],
    /// Position of the first point.
    low: DVec3,
    step: DVec3,
    count: [usize; 3],
    cubes: Vec<AmbientCube>,
}

/// Rays from each point of the grid.
const RAYS: u32 = 128;
/// Smallest distance of grid points, in metres, and largest number of points per axis.
const STEP: f64 = 0.6;
const MAX_POINTS: usize = 14;
/// Smallest distance of grid points to the border, in steps: on it, they would be inside the walls.
const INSET: f64 = 0.15;
/// A surface this close to an interior is in it, in metres.
const TOUCHING: f64 = 1e-6;

pub(super) fn needed_by(scene: &SceneContext<'_>) -> Option<String> {
    let share = scene.conditions.bounce;
    (share > 0.0).then(|| "surfaces reflect light onto each other".to_owned())
}

impl IndirectLight {
    pub(super) fn new(world: &World, share: f64) -> Self {
        let grids = world.interiors.iter().map(|interior| Grid::new(*interior)).collect();
        #[expect(clippy::cast_possible_truncation, reason = "a share")]
        let mut light = Self { grids, share: share as f32 };
        for _ in 0..2 {
            let cubes = |grid: &Grid| {
                let points = (0..grid.count.iter().product::<usize>()).into_par_iter();
                points.map(|at| light.cube(world, grid.place(at))).collect::<Vec<AmbientCube>>()
            };
            let bounced: Vec<_> = light.grids.iter().map(cubes).collect();
            for (grid, cubes) in light.grids.iter_mut().zip(bounced) {
                grid.cubes = cubes;
            }
        }
        light
    }

    /// Irradiance / π from everything except lamps; `None` where no point of a grid is outside solids.
    pub(super) fn ambient(&self, world: &World, point: DVec3, normal: DVec3) -> Option<Vec3> {
        Some(world.ambient.lerp(self.at(point, normal)?, self.share))
    }

    fn cube(&self, world: &World, origin: DVec3) -> AmbientCube {
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

    /// Light in the interior that contains the point. Between two, as in a doorway, of both: the nearer counts more.
    fn at(&self, point: DVec3, normal: DVec3) -> Option<Vec3> {
        if let Some(grid) = self.grids.iter().find(|grid| grid.distance(point) < TOUCHING) {
            return grid.at(point, normal);
        }
        let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
        for grid in &self.grids {
            if let Some(light) = grid.at(point, normal) {
                let weight = as_f32(1.0 / grid.distance(point));
                sum += light * weight;
                weights += weight;
            }
        }
        (weights > 0.0).then(|| sum / weights)
    }
}

impl Grid {
    fn new(interior: [DVec3; 2]) -> Self {
        let [low, high] = interior;
        let side = high - low;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a small count")]
        let points = |length: f64| ((length / STEP).ceil() as usize + 1).clamp(2, MAX_POINTS);
        let count = side.to_array().map(points);
        let intervals = DVec3::from(count.map(|count| (count - 1) as f64));
        let inset = side / intervals * INSET;
        Self { interior, low: low + inset, step: (side - inset * 2.0) / intervals, count, cubes: Vec::new() }
    }

    fn place(&self, at: usize) -> DVec3 {
        let [x, y, _] = self.count;
        self.low + self.step * DVec3::from([at % x, at / x % y, at / (x * y)].map(|step| step as f64))
    }

    /// Distance of a point to the interior; 0 inside.
    fn distance(&self, point: DVec3) -> f64 {
        let [low, high] = self.interior;
        point.distance(point.clamp(low, high))
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

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::material::{Material, Pattern};
    use crate::sky::Sky;
    use crate::world::Builder;

    const LARGE: [DVec3; 2] = [DVec3::ZERO, DVec3::new(5.0, 5.0, 2.5)];
    /// Beside the first behind a wall of 0.2 m, and shorter, so that the box around both contains a part of the outside.
    const SMALL: [DVec3; 2] = [DVec3::new(5.2, 1.0, 0.0), DVec3::new(9.0, 4.0, 2.5)];

    /// Two white rooms without a doorway under a bright sky; `roof` of the first.
    fn house(roof: bool) -> World {
        let mut builder = Builder::new();
        let white = builder.material(Material::matte(Pattern::Plain(Vec3::splat(0.8)), 0));
        builder.instance(DVec3::ZERO, 0.0);
        for ([low, high], closed) in [(LARGE, roof), (SMALL, true)] {
            let (outer, far) = (low - DVec3::splat(0.1), high + DVec3::splat(0.1));
            for axis in 0..3 {
                let (mut end, mut begin) = (far, outer);
                (end[axis], begin[axis]) = (low[axis], high[axis]);
                builder.block(outer, end, white);
                if axis < 2 || closed {
                    builder.block(begin, far, white);
                }
            }
        }
        let bright = Vec3::splat(100.0);
        let sky = Sky { zenith: bright, horizon: bright, ground: bright, trees: bright, clouds: 0.0, seed: 0 };
        let mut world = builder.finish(sky, Vec3::ONE, [LARGE[0], LARGE[1].with_x(SMALL[1].x)]);
        world.interiors = vec![LARGE, SMALL];
        world
    }

    /// Light on the walls, floor and ceiling of a room, at points near its edges too.
    fn light_in([low, high]: [DVec3; 2], light: &IndirectLight) -> Vec<f64> {
        let mut found = Vec::new();
        for axis in 0..3 {
            for share in [0.02, 0.3, 0.5, 0.98].map(DVec3::splat) {
                for (end, normal) in [(low, DVec3::AXES[axis]), (high, -DVec3::AXES[axis])] {
                    let mut point = low + (high - low) * share;
                    point[axis] = end[axis];
                    found.push(f64::from(light.at(point, normal).unwrap().max_element()));
                }
            }
        }
        found
    }

    #[test]
    fn no_light_passes_through_walls() {
        let light = IndirectLight::new(&house(true), 1.0);
        for room in [LARGE, SMALL] {
            Tolerance::EXACT.assert(light_in(room, &light), [0.0; 24], "light in a closed room");
        }
        let light = IndirectLight::new(&house(false), 1.0);
        assert!(light_in(LARGE, &light).into_iter().all(|light| light > 1.0), "without a roof it is bright");
        Tolerance::EXACT.assert(light_in(SMALL, &light), [0.0; 24], "light in the closed room beside a bright one");
    }

    /// Each point is given its own position as light, which trilinear interpolation keeps.
    #[test]
    fn light_is_interpolated_between_the_places_of_points() {
        let mut grid = Grid::new([DVec3::new(1.0, 2.0, 3.0), DVec3::new(6.0, 4.5, 5.5)]);
        let places = (0..grid.count.iter().product::<usize>()).map(|at| grid.place(at).as_vec3());
        grid.cubes = places.map(|place| Some([place; 6])).collect();
        let normal = DVec3::new(0.6, 0.0, -0.8);
        for point in [DVec3::new(1.3, 2.2, 3.4), DVec3::new(2.5, 3.7, 4.0), DVec3::new(5.7, 4.3, 5.4)] {
            let expected = point + normal * 0.2;
            let found = grid.at(point, normal).unwrap().as_dvec3();
            Tolerance::absolute(1e-5).assert(found.to_array(), expected.to_array(), "position");
        }
        let corner = grid.at(DVec3::ZERO, normal).unwrap().as_dvec3();
        Tolerance::absolute(1e-5).assert(corner.to_array(), grid.place(0).to_array(), "the nearest point from outside");
    }

    /// In the wall between the rooms, light goes over from one room's to the other's.
    #[test]
    fn a_doorway_is_lit_from_both_rooms() {
        let grid = |interior, light: f32| {
            let mut grid = Grid::new(interior);
            grid.cubes = vec![Some([Vec3::splat(light); 6]); grid.count.iter().product()];
            grid
        };
        let light = IndirectLight { grids: vec![grid(LARGE, 1.0), grid(SMALL, 5.0)], share: 1.0 };
        let on_floor = |x: f64| f64::from(light.at(DVec3::new(x, 2.0, 0.0), DVec3::Z).unwrap().x);
        let found = [4.9, 5.0, 5.05, 5.1, 5.15, 5.2, 5.3].map(on_floor);
        Tolerance::absolute(1e-5).assert(found, [1.0, 1.0, 2.0, 3.0, 4.0, 5.0, 5.0], "light over the threshold");
    }
}
