//! Where the camera goes.

mod clip_motion;
mod glide;
mod place;
mod statistics;
mod walk;

use std::collections::BTreeSet;

use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics, WorldFromCamera};
use glam::{DMat3, DVec2, DVec3};

use crate::rng::{Rng, sphere_point};
use crate::shot::Shot;
use crate::world::World;
use crate::{RoomsError, SceneKind};
pub use clip_motion::ClipMotion;
pub(crate) use place::place;
pub use statistics::Motion;

/// A pose as a person holds a camera: where, and turned how, in radians.
#[derive(Clone, Copy, Debug)]
struct Held {
    place: DVec3,
    yaw: f64,
    pitch: f64,
    roll: f64,
}

impl Held {
    fn forward(&self) -> DVec3 {
        let (sin, cos) = self.yaw.sin_cos();
        DVec3::new(cos * self.pitch.cos(), sin * self.pitch.cos(), self.pitch.sin())
    }

    /// OpenCV axes in a world whose z points up.
    fn pose(&self) -> Result<WorldFromCamera, RoomsError> {
        let forward = self.forward();
        let right = DVec3::new(self.yaw.sin(), -self.yaw.cos(), 0.0);
        let upright = DMat3::from_cols(right, forward.cross(right), forward);
        Ok(WorldFromCamera::new(upright * DMat3::from_rotation_z(self.roll), self.place)?)
    }
}

/// A path that was found, and what had to give for it.
#[derive(Debug)]
pub(crate) struct Walked {
    pub shots: Vec<Shot>,
    /// The speed that was drawn times this is the speed that fits the scene.
    pub slowed_to: f64,
}

/// The camera's way through a world: `frames` shots of a picture of `width_over_height`.
pub(crate) fn natural(
    kind: SceneKind,
    seed: u64,
    world: &World,
    frames: usize,
    width_over_height: f64,
) -> Result<Walked, RoomsError> {
    let rng = &mut Rng::for_part(seed, "path");
    let fy = match kind {
        SceneKind::Rooms => Motion::FY.draw(rng.unit()),
        SceneKind::Yards => rng.within(0.8, 1.15),
    };
    let intrinsics = NormalizedIntrinsics::new(fy / width_over_height, fy, 0.5, 0.5)?;
    let (held, micros, slowed_to) = match kind {
        SceneKind::Rooms => glide::glide(rng, world, frames),
        SceneKind::Yards => walk::walk(rng, world, frames),
    };
    let poses = held.iter().map(Held::pose).collect::<Result<Vec<_>, _>>()?;
    Ok(Walked { shots: shots(&poses, intrinsics, micros), slowed_to })
}

/// Shots one after another, each moving towards the next; the last stands.
fn shots(poses: &[WorldFromCamera], intrinsics: NormalizedIntrinsics, micros: f64) -> Vec<Shot> {
    let next = poses.iter().skip(1).chain(poses.last());
    let shot = |(at, (pose, next)): (usize, (&WorldFromCamera, &WorldFromCamera))| {
        #[expect(clippy::cast_possible_truncation, reason = "microseconds of a clip")]
        let timestamp_micros = (at as f64 * micros).round() as i64;
        let camera_from_world: CameraFromWorld = pose.inverse();
        Shot { timestamp_micros, camera: Camera::pinhole(camera_from_world, intrinsics), moving_to: *next }
    };
    poses.iter().zip(next).enumerate().map(shot).collect()
}

/// Rays that look for things to see, and how many different ones are enough.
const RAYS: u32 = 48;
const THINGS: usize = 5;

/// Nearest that a camera comes to anything, in metres.
const CLEARANCE: f64 = 0.3;

/// Whether a camera can stand there.
fn is_free(world: &World, place: DVec3) -> bool {
    let [low, high] = world.space;
    place.cmpgt(low).all() && place.cmplt(high).all() && world.clearance(place) > CLEARANCE
}

/// Whether a view shows more than a wall: of a bundle of rays the median goes far enough, and they meet some things.
fn is_worth_seeing(world: &World, from: DVec3, forward: DVec3, far: f64) -> bool {
    let mut things = BTreeSet::new();
    let mut reached: Vec<f64> = (0..RAYS)
        .filter_map(|ray| {
            let n = f64::from(ray) + 0.5;
            let aside = sphere_point(DVec2::new(n / f64::from(RAYS), (n * 0.618_033_988_749_895).fract()));
            let way = (forward + aside * 0.45).normalize_or(forward);
            let met = world.trace(from, way)?;
            things.insert(met.instance);
            Some(met.distance)
        })
        .collect();
    reached.sort_by(f64::total_cmp);
    things.len() >= THINGS && reached.get(reached.len() / 2).is_some_and(|median| *median > far)
}
