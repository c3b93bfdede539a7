//! Placement of a given trajectory in a scene.

use atsplat_camera::{Camera, CameraError, WorldFromCamera};
use glam::{DMat3, DVec3};

use super::{CameraPath, is_free, shots, shows_enough};
use crate::RoomsError;
use crate::rng::Rng;
use crate::world::World;

const TRIES: usize = 400;
/// Scales end above this one: a route of a thousand kilometres still fits into a room.
const SMALLEST: f64 = 1e-9;

/// Moves a given path so that its first camera, assumed upright, is at a free position of the world. Lengths are scaled down to
/// 0.6, 0.36 … while none of many random positions has all cameras free.
///
/// # Errors
/// [`RoomsError::Request`] for a path without cameras, or one that does not fit at any scale.
pub(crate) fn place(seed: u64, world: &World, given: &[(i64, Camera)]) -> Result<CameraPath, RoomsError> {
    let empty = || RoomsError::Request { field: "trajectory", expected: "cameras", found: "none".to_owned() };
    let (_, first) = given.first().ok_or_else(empty)?;
    let poses: Vec<WorldFromCamera> = given.iter().map(|(_, camera)| camera.camera_from_world.inverse()).collect();
    let rng = &mut Rng::for_part(seed, "place");
    let [low, high] = world.space;
    let mut scale = 1.0;
    // Number of free cameras, scale and poses.
    let mut best: Option<(usize, f64, Vec<WorldFromCamera>)> = None;
    while scale > SMALLEST {
        for _ in 0..TRIES {
            let at = DVec3::new(rng.within(low.x, high.x), rng.within(low.y, high.y), low.z + rng.within(1.2, 1.7));
            let yaw = rng.within(0.0, std::f64::consts::TAU);
            let upright = DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X);
            let start = WorldFromCamera::new(DMat3::from_rotation_z(yaw) * upright, at)?;
            if !is_free(world, at) || !shows_enough(world, at, start.forward(), 1.3) {
                continue;
            }
            let relative = |pose: &WorldFromCamera| -> Result<WorldFromCamera, CameraError> {
                let seen = first.camera_from_world.inverse().camera_from_other(pose);
                Ok(seen.scaled_by(scale)?.moved_by(&start))
            };
            let moved = poses.iter().map(relative).collect::<Result<Vec<_>, _>>()?;
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
    let no_room = |found| RoomsError::Request { field: "trajectory", expected: "a scene with room for it", found };
    let (slowed_to, moved) = match best {
        Some((free, scale, moved)) if free == poses.len() => (scale, moved),
        Some((free, ..)) => return Err(no_room(format!("{free} of {} cameras in free space", poses.len()))),
        None => return Err(no_room("no free place".to_owned())),
    };
    let timed = given.iter().zip(&moved).map(|((micros, camera), pose)| {
        (*micros, Camera { camera_from_world: pose.inverse(), ..camera.without_distortion() })
    });
    Ok(CameraPath { shots: shots(&timed.collect::<Vec<_>>()), slowed_to })
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{CameraFromWorld, NormalizedIntrinsics};
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::{SceneKind, SceneSeed, Split};

    /// Cameras `apart` metres apart along their optical axis, placed in a simulated house.
    fn placed(cameras: u32, apart: f64) -> (World, Result<CameraPath, RoomsError>) {
        let intrinsics = NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).unwrap();
        let given = (0..cameras).map(|at| {
            let translation = DVec3::new(0.0, 0.0, -apart * f64::from(at));
            let pose = CameraFromWorld::new(DMat3::IDENTITY, translation).unwrap();
            (i64::from(at) * 33_333, Camera::pinhole(pose, intrinsics))
        });
        let seed = SceneSeed { split: Split::Test, number: 8 }.bits();
        let world = crate::build::world(SceneKind::Rooms, seed);
        let path = place(seed, &world, &given.collect::<Vec<_>>());
        (world, path)
    }

    #[test]
    fn a_long_route_shrinks_until_every_camera_is_inside() {
        let (world, path) = placed(20, 500.0);
        let CameraPath { shots, slowed_to } = path.unwrap();
        let centres: Vec<DVec3> = shots.iter().map(|shot| shot.camera.camera_from_world.inverse().centre()).collect();
        assert_eq!(centres.len(), 20);
        assert!(centres.iter().all(|centre| is_free(&world, *centre)), "{centres:?} in {:?}", world.space);
        let steps = centres.windows(2).map(|pair| pair[0].distance(pair[1]));
        Tolerance::relative(1e-6).assert(steps, [500.0 * slowed_to; 19], "distances between cameras");
    }

    #[test]
    fn a_route_that_fits_at_no_scale_is_an_error() {
        let error = placed(3, 1e15).1.unwrap_err().to_string();
        let expected = "trajectory: expected a scene with room for it, found 1 of 3 cameras in free space";
        assert_eq!(error, expected);
    }
}
