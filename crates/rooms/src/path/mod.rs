//! Camera paths.

mod clip_motion;
mod glide;
mod place;
mod route;
mod statistics;
mod walk;

use std::collections::BTreeSet;

use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
use glam::{DMat3, DVec2, DVec3};

use crate::rng::{Rng, sphere_point};
use crate::world::World;
use crate::{RoomsError, SceneKind};
pub use clip_motion::ClipMotion;
pub(crate) use place::place;
pub(crate) use route::{route_cameras, timed_cameras};
pub use statistics::Motion;

/// One camera of a simulated clip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// Time since the clip's start, in microseconds, as in an RE10K trajectory.
    pub timestamp_micros: i64,
    /// Pose and pinhole intrinsics; the lens is one of the scene's effects.
    pub camera: Camera,
    /// The pose `frame_seconds` later, towards which the camera moves at constant speed around this time.
    pub moving_to: WorldFromCamera,
    /// Seconds to the next frame; 0 for a camera that does not move.
    pub frame_seconds: f64,
}

impl Shot {
    /// A camera that does not move.
    pub(crate) fn still(timestamp_micros: i64, camera: Camera) -> Self {
        let moving_to = camera.camera_from_world.inverse();
        Self { timestamp_micros, camera, moving_to, frame_seconds: 0.0 }
    }

    /// The share of the motion to the next frame that takes `seconds`. A shutter is open until the next frame at most.
    pub(crate) fn share_of_motion(&self, seconds: f64) -> f64 {
        if self.frame_seconds > 0.0 { (seconds / self.frame_seconds).clamp(0.0, 1.0) } else { 0.0 }
    }
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
///
/// # Errors
/// [`RoomsError::Request`] if no path with that many frames fits into the world.
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
        SceneKind::Rooms => glide::glide(rng, world, frames)?,
        SceneKind::Yards => walk::walk(rng, world, frames)?,
    };
    let timed = handheld.iter().enumerate().map(|(at, handheld)| {
        #[expect(clippy::cast_possible_truncation, reason = "microseconds of a clip")]
        let timestamp_micros = (at as f64 * micros).round() as i64;
        Ok((timestamp_micros, Camera::pinhole(handheld.pose()?.inverse(), intrinsics)))
    });
    Ok(CameraPath { shots: shots(&timed.collect::<Result<Vec<_>, RoomsError>>()?), slowed_to })
}

/// Shots of cameras with their times in microseconds: each camera moves towards the next one, the last goes on as it came.
fn shots(timed: &[(i64, Camera)]) -> Vec<Shot> {
    let pose = |camera: &Camera| camera.camera_from_world.inverse();
    let seconds = |from: i64, to: i64| to.saturating_sub(from) as f64 * 1e-6;
    let moving = |((from, camera), (to, next)): (&(i64, Camera), &(i64, Camera))| Shot {
        timestamp_micros: *from,
        camera: *camera,
        moving_to: pose(next),
        frame_seconds: seconds(*from, *to),
    };
    let mut shots: Vec<Shot> = timed.iter().zip(timed.iter().skip(1)).map(moving).collect();
    if let Some((micros, camera)) = timed.last() {
        let still = Shot::still(*micros, *camera);
        shots.push(shots.last().map_or(still, |before| Shot {
            moving_to: pose(&before.camera).camera_from_other(&pose(camera)).moved_by(&pose(camera)),
            frame_seconds: before.frame_seconds,
            ..still
        }));
    }
    shots
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

/// Slower paths are not tried: as a share of the drawn speed.
const SLOWEST: f64 = 0.01;

/// The error if no path is valid at any speed.
fn no_room(frames: usize) -> RoomsError {
    let expected = "a path that fits into the scene at 1 % of the drawn speed (request fewer frames or another scene)";
    RoomsError::Request { field: "frames", expected, found: frames.to_string() }
}

/// Evenly spaced poses of a path, its ends among them.
fn spaced(path: &[HandheldPose], parts: usize) -> impl Iterator<Item = &HandheldPose> {
    (0..=parts).filter_map(move |part| path.get(part * (path.len() - 1) / parts))
}

/// Whether a path keeps clear of objects: at the ends of `few` parts, which rejects most paths early, and of `many`. A long path
/// has more parts, so that the free balls around their ends touch each other.
fn is_free_along(world: &World, path: &[HandheldPose], [few, many]: [usize; 2]) -> bool {
    let are_free = |parts: usize| spaced(path, parts).all(|pose| is_free(world, pose.position));
    let length: f64 = path.windows(2).map(|pair| pair[0].position.distance(pair[1].position)).sum();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded by the number of poses")]
    let of_length = ((length / (2.0 * CLEARANCE)).ceil() as usize).min(path.len());
    are_free(few) && are_free(many.max(of_length))
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

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;
    use glam::Vec3;

    use super::*;
    use crate::material::{Material, Pattern};
    use crate::sky::Sky;
    use crate::world::Builder;

    fn at(z: f64, turn: f64) -> Camera {
        let pose = WorldFromCamera::new(DMat3::from_rotation_y(turn), DVec3::new(1.0, 2.0, z)).unwrap();
        Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).unwrap())
    }

    /// Poses along x, 0.1 m apart.
    fn straight(frames: u32) -> Vec<HandheldPose> {
        let position = |frame| DVec3::new(0.1 * f64::from(frame), 0.0, 0.0);
        (0..frames).map(|frame| HandheldPose { position: position(frame), yaw: 0.0, pitch: 0.0, roll: 0.0 }).collect()
    }

    /// A world with a post at `x`, in a space of this half side.
    fn post(x: f64, half: f64) -> World {
        let mut builder = Builder::new();
        let material = builder.material(Material::matte(Pattern::Plain(Vec3::ONE), 0));
        builder.instance(DVec3::ZERO, 0.0);
        builder.block(DVec3::new(x - 0.05, -0.05, -1.0), DVec3::new(x + 0.05, 0.05, 1.0), material);
        builder.finish(Sky::BLACK, Vec3::ONE, [DVec3::splat(-half), DVec3::splat(half)])
    }

    /// The sixteenths of 60 m are 3.75 m apart; a post between two of them is in the way of a long path only.
    #[test]
    fn long_paths_do_not_pass_through_objects_between_the_poses_that_are_checked() {
        for x in [1.9, 31.8, 58.1] {
            assert!(!is_free_along(&post(x, 100.0), &straight(601), [2, 16]), "a post at {x} m");
        }
        for x in [-0.4, 60.4] {
            assert!(is_free_along(&post(x, 100.0), &straight(601), [2, 16]), "a post at {x} m");
        }
        assert!(is_free_along(&post(1.9, 100.0), &straight(10), [2, 16]), "a short path");
    }

    #[test]
    fn without_room_for_any_path_the_number_of_frames_is_rejected() {
        for kind in SceneKind::ALL {
            let error = natural(kind, 5, &post(0.0, 0.2), 7, 1.0).unwrap_err().to_string();
            assert!(error.starts_with("frames: expected a path that fits into the scene"), "{error}");
            assert!(error.ends_with("(request fewer frames or another scene), found 7"), "{error}");
        }
    }

    #[test]
    fn the_last_shot_moves_on_as_it_came() {
        let shots = shots(&[(0, at(0.0, 0.0)), (40_000, at(0.5, 0.0)), (60_000, at(2.0, 0.1))]);
        let seconds: Vec<f64> = shots.iter().map(|shot| shot.frame_seconds).collect();
        Tolerance::absolute(1e-12).assert(seconds, [0.04, 0.02, 0.02], "seconds to the next frame");
        let poses = [at(0.5, 0.0), at(2.0, 0.1)].map(|camera| camera.camera_from_world.inverse());
        for (shot, next) in shots.iter().zip(poses) {
            Tolerance::F64.assert(shot.moving_to.to_rows(), next.to_rows(), "the next pose");
        }
        // In the last camera's axes, the step forwards is 1.5 along the axis of the camera before it.
        let last = shots[2].camera.camera_from_world.inverse();
        let expected = last.centre() + last.rotation() * DVec3::new(0.0, 0.0, 1.5);
        Tolerance::F64.assert(shots[2].moving_to.centre().to_array(), expected.to_array(), "position");
        let turned = DMat3::from_rotation_y(0.2) * DVec3::Z;
        Tolerance::F64.assert(shots[2].moving_to.forward().to_array(), turned.to_array(), "direction");
    }

    #[test]
    fn a_single_camera_and_frames_of_one_time_do_not_move() {
        let alone = shots(&[(7, at(0.0, 0.0))]);
        assert_eq!(alone, [Shot::still(7, at(0.0, 0.0))]);
        for (micros, share) in [(40_000, 0.5), (20_000, 1.0), (5_000, 1.0), (0, 0.0), (-5_000, 0.0)] {
            let shots = shots(&[(0, at(0.0, 0.0)), (micros, at(0.5, 0.0))]);
            Tolerance::absolute(1e-12).assert([shots[0].share_of_motion(0.02)], [share], &format!("{micros} µs"));
        }
    }
}
