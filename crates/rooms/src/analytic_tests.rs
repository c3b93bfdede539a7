//! Depth and co-visibility of scenes with analytic solutions: walls of known depth, an occluder, back faces.

use atsplat_camera::{Camera, ImageSize, NormalizedIntrinsics, WorldFromCamera};
use atsplat_numeric::Tolerance;
use glam::{DMat3, DVec2, DVec3, Vec3};

use crate::Simulation;
use crate::material::{Material, Pattern};
use crate::shape::Shape;
use crate::sky::Sky;
use crate::world::{Builder, World};

const SIZE: ImageSize = ImageSize { width: 40, height: 30 };

/// A camera that looks along the world's +y, with its +y down, rotated about the vertical by `yaw`.
fn camera(position: DVec3, yaw: f64) -> Camera {
    let upright = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
    let pose = WorldFromCamera::new(DMat3::from_rotation_z(yaw) * upright, position).unwrap();
    Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.9, 1.1, 0.45, 0.53).unwrap())
}

/// Coordinates of the pixels' centres on the plane at distance 1: right and down.
fn pixels(camera: &Camera, size: ImageSize) -> Vec<[f64; 2]> {
    let k = camera.intrinsics;
    let place = |at: u32, of: u32, c: f64, f: f64| ((f64::from(at) + 0.5) / f64::from(of) - c) / f;
    let row = |row: u32| {
        let across = (0..size.width).map(move |column| place(column, size.width, k.cx, k.fx));
        across.map(move |right| [right, place(row, size.height, k.cy, k.fy)])
    };
    (0..size.height).flat_map(row).collect()
}

fn world(put: impl FnOnce(&mut Builder, usize)) -> World {
    let mut builder = Builder::new();
    let material = builder.material(Material::matte(Pattern::Plain(Vec3::ONE), 0));
    put(&mut builder, material);
    builder.finish(Sky::BLACK, Vec3::ONE, [DVec3::splat(-9.0), DVec3::splat(9.0)])
}

/// A wall across the whole view whose near side is `y = 4 + x tan(turn)`.
fn wall(builder: &mut Builder, material: usize, turn: f64) {
    builder.instance(DVec3::new(0.0, 4.0, 0.0), turn);
    builder.block(DVec3::new(-60.0, 0.0, -60.0), DVec3::new(60.0, 0.2, 60.0), material);
}

/// Depth is along the optical axis, so that a wall facing the camera has the same depth in the corners and in the middle.
#[test]
fn a_wall_facing_the_camera_has_one_depth() {
    let simulation = Simulation::of_world(world(|b, m| wall(b, m, 0.0)), SIZE, &[camera(DVec3::ZERO, 0.0)]);
    let geometry = simulation.geometry(0).unwrap();
    Tolerance::absolute(1e-6).assert(geometry.depth.iter().map(|&d| f64::from(d)), vec![4.0; 1200], "depth");
    assert!(geometry.instances.iter().all(|instance| *instance == 1));
}

/// A slanted wall and a floor: each pixel's depth is the nearer of `4 / (1 − right · tan)` and `0.8 / down` at its centre. An
/// error of half a pixel would change every depth.
#[test]
fn a_slanted_wall_and_a_floor_have_the_depth_of_the_pixels_centres() {
    for turn in [0.6f64, -0.35] {
        let scene = world(|builder, material| {
            wall(builder, material, turn);
            builder.instance(DVec3::ZERO, 0.0);
            builder.block(DVec3::new(-90.0, -90.0, -2.0), DVec3::new(90.0, 90.0, -0.8), material);
        });
        let camera = camera(DVec3::ZERO, 0.0);
        let geometry = Simulation::of_world(scene, SIZE, &[camera]).geometry(0).unwrap();
        let mut seen = [0, 0];
        for (pixel, [right, down]) in pixels(&camera, SIZE).into_iter().enumerate() {
            let (of_wall, of_floor) = (4.0 / (1.0 - right * turn.tan()), 0.8 / down);
            let floor = down > 0.0 && of_floor < of_wall;
            let expected = if floor { of_floor } else { of_wall };
            let normal = if floor { [0.0, 0.0, 1.0] } else { [turn.sin(), -turn.cos(), 0.0] };
            let what = format!("turn {turn}, pixel {pixel}");
            Tolerance::relative(1e-6).assert([f64::from(geometry.depth[pixel])], [expected], &what);
            Tolerance::absolute(1e-6).assert(geometry.normals[pixel].map(f64::from), normal, &what);
            assert_eq!(geometry.instances[pixel], 1 + u32::from(floor), "{what}");
            seen[usize::from(floor)] += 1;
        }
        assert!(seen.iter().all(|count| *count > 100), "{seen:?}");
    }
}

/// Half width of the plate below, and its distance from the first camera.
const PLATE: f64 = 0.3;
const PLATE_AT: f64 = 2.0;
const WALL_AT: f64 = 4.0;

/// The point that a camera sees at `right` of its middle, in plan: across and away, the same at every height.
fn seen_point(camera: DVec2, right: f64) -> DVec2 {
    let at = |away: f64| DVec2::new(camera.x + (away - camera.y) * right, away);
    if at(PLATE_AT).x.abs() < PLATE { at(PLATE_AT) } else { at(WALL_AT) }
}

/// A wall behind a plate that is higher than the view, seen by two cameras: the share of pixels visible to the other camera
/// excludes those that the plate hides, more than a tenth.
#[test]
fn surfaces_behind_an_occluder_are_not_covisible() {
    let scene = world(|builder, material| {
        wall(builder, material, 0.0);
        builder.instance(DVec3::ZERO, 0.0);
        builder.block(DVec3::new(-PLATE, PLATE_AT, -50.0), DVec3::new(PLATE, PLATE_AT + 1e-3, 50.0), material);
    });
    let places = [DVec2::new(-0.43, 0.0), DVec2::new(0.57, -1.1)];
    let cameras = places.map(|place| camera(place.extend(0.0), 0.0));
    let found = Simulation::of_world(scene, SIZE, &cameras).covisibility(0, 1).unwrap();
    let k = cameras[0].intrinsics;
    let inside = |[right, down]: [f64; 2]| {
        let within = |at: f64, c: f64, f: f64| at > -c / f && at < (1.0 - c) / f;
        within(right, k.cx, k.fx) && within(down, k.cy, k.fy)
    };
    let share = |from: DVec2, into: DVec2| {
        let all = pixels(&cameras[0], SIZE);
        let [mut seen, mut hidden] = [0.0, 0.0];
        for [right, down] in &all {
            let point = seen_point(from, *right);
            let away = point.y - into.y;
            let there = inside([(point.x - into.x) / away, down * (point.y - from.y) / away]);
            // Where the line from the wall to the other camera passes the plate's distance.
            let passed = into.lerp(point, (PLATE_AT - into.y) / away).x;
            let blocked = point.y > PLATE_AT && passed.abs() < PLATE;
            seen += f64::from(u8::from(there && !blocked));
            hidden += f64::from(u8::from(there && blocked));
        }
        [seen, hidden].map(|count: f64| count / all.len() as f64)
    };
    let [first, second] = [share(places[0], places[1]), share(places[1], places[0])];
    assert!(first[1] > 0.1 && second[1] > 0.1, "the plate hides something: {first:?} {second:?}");
    assert!((first[0] - second[0]).abs() > 0.05, "the directions differ: {first:?} {second:?}");
    let both = [found.first_in_second, found.second_in_first];
    Tolerance::F64.assert(both, [first[0], second[0]], "shares of pixels");
    Tolerance::F64.assert([found.overlap()], [if first[0] < second[0] { first[0] } else { second[0] }], "the smaller");
}

/// A leaf without thickness between two cameras that look at each other: each sees only its own side, at any distance.
/// Through the middle, only the surface itself is between the cameras.
#[test]
fn the_two_sides_of_a_leaf_are_not_covisible() {
    let single = ImageSize { width: 1, height: 1 };
    let straight = |camera: Camera| {
        let intrinsics = NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap();
        Camera { intrinsics, ..camera }
    };
    for distance in [0.5, 0.7, 1.0, 1.3, 2.0, 2.5, 3.1, 5.0] {
        for size in [single, SIZE] {
            let scene = world(|builder, material| {
                builder.instance(DVec3::ZERO, 0.0);
                let upright = DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2);
                builder.put_turned(Shape::Leaf(DVec2::splat(20.0)), DVec3::new(0.0, distance, 0.0), upright, material);
            });
            let other = camera(DVec3::new(0.0, 2.0 * distance, 0.0), std::f64::consts::PI);
            let cameras = [straight(camera(DVec3::ZERO, 0.0)), straight(other)];
            let simulation = Simulation::of_world(scene, size, &cameras);
            let middle = f64::from(simulation.geometry(0).unwrap().depth[0]);
            Tolerance::relative(1e-6).assert([middle], [distance], "the leaf is seen");
            let found = simulation.covisibility(0, 1).unwrap();
            Tolerance::EXACT.assert(
                [found.first_in_second, found.second_in_first],
                [0.0; 2],
                &format!("{distance} m, {size}"),
            );
            let same = simulation.covisibility(0, 0).unwrap().overlap();
            Tolerance::EXACT.assert([same], [1.0], "its own side is seen");
        }
    }
}
