//! Placement of a given trajectory in a scene.

use atsplat_camera::{Camera, WorldFromCamera};
use glam::{DMat3, DVec3};

use super::{CameraPath, is_free, shows_enough};
use crate::RoomsError;
use crate::path::Shot;
use crate::rng::Rng;
use crate::world::World;

const TRIES: usize = 400;

/// Moves a given path so that its first camera, assumed upright, is at a free position of the world. Lengths are scaled down to
/// 0.6, 0.36 … while none of many random positions has all cameras free; if none ever has, the first with the most is chosen.
pub(crate) fn place(seed: u64, world: &World, given: &[(i64, Camera)]) -> Result<CameraPath, RoomsError> {
    let empty = || RoomsError::Request { field: "trajectory", expected: "cameras", found: "none".to_owned() };
    let (_, first) = given.first().ok_or_else(empty)?;
    let poses: Vec<WorldFromCamera> = given.iter().map(|(_, camera)| camera.camera_from_world.inverse()).collect();
    let rng = &mut Rng::for_part(seed, "place");
    let [low, high] = world.space;
    let mut scale = 1.0;
    // Number of free cameras, scale and poses.
    let mut best: Option<(usize, f64, Vec<WorldFromCamera>)> = None;
    while scale > 0.01 {
        for _ in 0..TRIES {
            let at = DVec3::new(rng.within(low.x, high.x), rng.within(low.y, high.y), low.z + rng.within(1.2, 1.7));
            let yaw = rng.within(0.0, std::f64::consts::TAU);
            let upright = DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X);
            let start = WorldFromCamera::new(DMat3::from_rotation_z(yaw) * upright, at)?;
            if !is_free(world, at) || !shows_enough(world, at, start.forward(), 1.3) {
                continue;
            }
            let relative = |pose: &WorldFromCamera| {
                let seen = first.camera_from_world.inverse().camera_from_other(pose);
                seen.scaled_by(scale).moved_by(&start)
            };
            let moved: Vec<WorldFromCamera> = poses.iter().map(relative).collect();
            let free = moved.iter().filter(|pose| is_free(world, pose.centre())).count();
            if best.as_ref().is_none_or(|(most, ..)| free > *most) {
                best = Some((free, scale, moved));
            }
            if free == poses.len() {
                break;
            }
        }
        if best.as_ref().is_some_and(|(free, ..)| *free == poses.len()) {
            break;
        }
        scale *= 0.6;
    }
    let (_, slowed_to, moved) = best.ok_or_else(|| RoomsError::Request {
        field: "trajectory",
        expected: "a scene with room for it",
        found: "no free place".to_owned(),
    })?;
    let next = moved.iter().skip(1).chain(moved.last());
    let shots = given.iter().zip(&moved).zip(next).map(|(((timestamp_micros, camera), pose), next)| Shot {
        timestamp_micros: *timestamp_micros,
        camera: Camera { camera_from_world: pose.inverse(), ..camera.without_distortion() },
        moving_to: *next,
    });
    Ok(CameraPath { shots: shots.collect(), slowed_to })
}
