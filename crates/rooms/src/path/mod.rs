//! Camera paths.

mod clip_motion;
mod glide;
mod place;
mod statistics;
mod times;
mod walk;

use std::collections::BTreeSet;

use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics, WorldFromCamera};
use glam::{DMat3, DVec2, DVec3};

use crate::rng::{Rng, sphere_point};
use crate::world::World;
use crate::{RoomsError, SceneKind};
pub use clip_motion::ClipMotion;
pub(crate) use place::place;
pub use statistics::Motion;
pub(crate) use times::timed_cameras;

/// One camera of a simulated clip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// Time since the clip's start, in microseconds, as in an RE10K trajectory.
    pub timestamp_micros: i64,
    /// Pose and pinhole intrinsics; the lens is one of the scene's effects.
    pub camera: Camera,
    /// The pose one frame later, towards which the camera moves while the shutter is open.
    pub moving_to: WorldFromCamera,
}

/// A pose of a handheld camera: position, and angles in radians.
#[derive(Clone, Copy, Debug)]
struct HandheldPose {
    position: DVec3,
    yaw: f64,
    pitch: f64,
    roll: f64,
}

impl HandheldPose {
    fn forward(&self) -> DVec3 {
        let (sin, cos) = self.yaw.sin_cos();
        DVec3::new(cos * self.pitch.cos(), sin * self.pitch.cos(), self.pitch.sin())
    }

    /// The pose with OpenCV axes, in a world with z up.
    fn pose(&self) -> Result<WorldFromCamera, RoomsError> {
        let forward = self.forward();
        let right = DVec3::new(self.yaw.sin(), -self.yaw.cos(), 0.0);
        let upright = DMat3::from_cols(right, forward.cross(right), forward);
        Ok(WorldFromCamera::new(upright * DMat3::from_rotation_z(self.roll), self.position)?)
    }
}

/// The camera path of a scene.
#[derive(Debug)]
pub(crate) struct CameraPath {
    pub shots: Vec<Shot>,
    /// Speed of the path as a share of the drawn speed, reduced to fit the scene.
    pub slowed_to: f64,
}

/// Finds a path of `frames` shots through a world, for images with the aspect ratio `width_over_height`.
pub(crate) fn natural(
    kind: SceneKind,
    seed: u64,
    world: &World,
    frames: usize,
    width_over_height: f64,
) -> Result<CameraPath, RoomsError> {
    let rng = &mut Rng::for_part(seed, "path");
    let fy = match kind {
        SceneKind::Rooms => Motion::FY.draw(rng.unit()),
        SceneKind::Yards => rng.within(0.8, 1.15),
    };
    let intrinsics = NormalizedIntrinsics::new(fy / width_over_height, fy, 0.5, 0.5)?;
    let (handheld, micros, slowed_to) = match kind {
        SceneKind::Rooms => glide::glide(rng, world, frames),
        SceneKind::Yards => walk::walk(rng, world, frames),
    };
    let poses = handheld.iter().map(HandheldPose::pose).collect::<Result<Vec<_>, _>>()?;
    Ok(CameraPath { shots: shots(&poses, intrinsics, micros), slowed_to })
}

/// Consecutive shots, each moving towards the next; the last is static.
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

/// Number of rays that probe a view, and smallest number of instances that they must hit.
const RAYS: u32 = 48;
const MIN_INSTANCES: usize = 5;

/// Smallest distance of a camera to any object, in metres.
const CLEARANCE: f64 = 0.3;

/// Whether a camera can be placed there.
fn is_free(world: &World, position: DVec3) -> bool {
    let [low, high] = world.space;
    position.cmpgt(low).all() && position.cmplt(high).all() && world.clearance(position) > CLEARANCE
}

/// Whether a view shows more than a wall: the median distance of a bundle of rays is large enough, and they hit several
/// instances.
fn shows_enough(world: &World, from: DVec3, forward: DVec3, far: f64) -> bool {
    let mut instances = BTreeSet::new();
    let mut reached: Vec<f64> = (0..RAYS)
        .filter_map(|ray| {
            let n = f64::from(ray) + 0.5;
            let aside = sphere_point(DVec2::new(n / f64::from(RAYS), (n * 0.618_033_988_749_895).fract()));
            let direction = (forward + aside * 0.45).normalize_or(forward);
            let hit = world.trace(from, direction)?;
            instances.insert(hit.instance);
            Some(hit.distance)
        })
        .collect();
    reached.sort_by(f64::total_cmp);
    instances.len() >= MIN_INSTANCES && reached.get(reached.len() / 2).is_some_and(|median| *median > far)
}
