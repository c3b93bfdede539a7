//! RE10K-like paths: a stabilised camera glides along a gentle arc and rotates slightly.

use glam::{DVec2, DVec3};

use super::{HandheldPose, Motion, SLOWEST, is_free_along, no_room, shows_enough, spaced};
use crate::RoomsError;
use crate::rng::Rng;
use crate::world::World;

/// Microseconds per frame at 30 frames per second.
const MICROS: f64 = 1e6 / 30.0;
/// Attempts at one speed before a slower one is tried.
const TRIES: usize = 60;

/// A path, the microseconds per frame, and the share of the drawn speed to which it is slowed.
///
/// # Errors
/// [`RoomsError::Request`] if no path fits.
pub(super) fn glide(rng: &mut Rng, world: &World, frames: usize) -> Result<(Vec<HandheldPose>, f64, f64), RoomsError> {
    let speed = Motion::SPEED.draw(rng.unit());
    let turn = Motion::TURN.draw(rng.unit()).to_radians() * rng.sign();
    let aside = Motion::TRAVEL_TO_AXIS.draw(rng.unit()).to_radians() * rng.sign();
    let straightness = Motion::STRAIGHTNESS.draw(rng.unit());
    let mut slowed_to = 1.0;
    while slowed_to >= SLOWEST {
        for _ in 0..TRIES {
            let path = candidate(rng, world, frames, [speed * slowed_to, turn, aside, straightness]);
            if is_valid(world, &path) {
                return Ok((path, MICROS, slowed_to));
            }
        }
        slowed_to *= 0.9;
    }
    Err(no_room(frames))
}

fn candidate(
    rng: &mut Rng,
    world: &World,
    frames: usize,
    [speed, turn, aside, straightness]: [f64; 4],
) -> Vec<HandheldPose> {
    let [low, high] = world.space;
    let start = DVec3::new(rng.within(low.x, high.x), rng.within(low.y, high.y), low.z + rng.within(1.0, 1.75));
    let azimuth = rng.within(0.0, std::f64::consts::TAU);
    let seconds = frames as f64 * MICROS * 1e-6;
    let chord = speed * seconds * straightness;
    let end = start + DVec3::new(azimuth.cos(), azimuth.sin(), rng.within(-0.04, 0.04)) * chord;
    // The approximate height of an arc `1 / straightness` times as long as its chord.
    let rise = chord * (0.375 * (1.0 / straightness - 1.0)).sqrt() * rng.sign();
    let across = DVec2::from_angle(azimuth).perp().extend(0.0);
    let pitch = rng.within(-0.16, 0.04);
    let [sway, phase, slower] = [rng.within(0.0, 0.006), rng.within(0.0, 6.0), rng.within(-0.08, 0.08)];
    (0..frames)
        .map(|frame| {
            let even = frame as f64 / frames as f64;
            let t = even + slower * (std::f64::consts::TAU * even + phase).sin() / std::f64::consts::TAU;
            let wave = |rate: f64| sway * (rate * even * seconds + phase).sin();
            let position = start.lerp(end, t) + across * (4.0 * rise * t * (1.0 - t)) + DVec3::Z * wave(2.1);
            HandheldPose {
                position,
                yaw: azimuth + aside + turn * seconds * (even - 0.5) + wave(1.3),
                pitch: pitch + wave(1.7),
                roll: wave(0.9),
            }
        })
        .collect()
}

fn is_valid(world: &World, path: &[HandheldPose]) -> bool {
    is_free_along(world, path, [2, 16])
        && spaced(path, 3).all(|pose| shows_enough(world, pose.position, pose.forward(), 1.3))
}
