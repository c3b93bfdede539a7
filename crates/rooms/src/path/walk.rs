//! DL3DV-like paths: a walk through the scene with changing directions of view.

use glam::{DVec2, DVec3};

use super::{HandheldPose, is_free, shows_enough};
use crate::rng::Rng;
use crate::world::World;

/// Microseconds between views, five per second.
const MICROS: f64 = 200_000.0;
const STOPS: usize = 6;
const TRIES: usize = 40;

pub(super) fn walk(rng: &mut Rng, world: &World, frames: usize) -> (Vec<HandheldPose>, f64, f64) {
    let speed = rng.within(0.4, 0.9);
    let mut slowed_to = 1.0;
    loop {
        for _ in 0..TRIES {
            let path = candidate(rng, world, frames, speed * slowed_to);
            if slowed_to < 0.01 || is_valid(world, &path) {
                return (path, MICROS, slowed_to);
            }
        }
        slowed_to *= 0.9;
    }
}

/// A path around a point of the scene at varying distance, looking mostly at it.
fn candidate(rng: &mut Rng, world: &World, frames: usize, speed: f64) -> Vec<HandheldPose> {
    let [low, high] = world.space;
    let between = |rng: &mut Rng, low: f64, high: f64| low + (high - low) * rng.within(0.2, 0.8);
    let about = DVec2::new(between(rng, low.x, high.x), between(rng, low.y, high.y));
    let radius = rng.within(1.5, 5.5);
    let length = speed * frames as f64 * MICROS * 1e-6;
    let sweep = (length / radius).clamp(0.0, 5.5) * rng.sign();
    let begin = rng.within(0.0, std::f64::consts::TAU);
    let inward = rng.chance(0.75);
    let height = rng.within(1.3, 1.7);
    let mut stops = Vec::with_capacity(STOPS);
    for stop in 0..STOPS {
        let angle = begin + sweep * stop as f64 / (STOPS - 1) as f64;
        let place = about + DVec2::from_angle(angle) * radius * rng.within(0.8, 1.2);
        let aim = angle + if inward { std::f64::consts::PI } else { 0.0 } + rng.within(-0.45, 0.45);
        stops.push(HandheldPose {
            position: place.extend(low.z + height + rng.within(-0.12, 0.12)),
            yaw: aim,
            pitch: rng.within(-0.2, 0.08),
            roll: rng.within(-0.02, 0.02),
        });
    }
    (0..frames).map(|frame| between_stops(&stops, frame as f64 / frames as f64)).collect()
}

/// A Catmull–Rom spline through the stops, at a share in [0, 1) of the path.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a stop's number")]
fn between_stops(stops: &[HandheldPose], share: f64) -> HandheldPose {
    let along = share * (STOPS - 1) as f64;
    let (at, t) = (along.floor() as usize, along.fract());
    let value = |read: &dyn Fn(&HandheldPose) -> f64| {
        let of = |back: usize| read(&stops[(at + back).clamp(1, STOPS) - 1]);
        let (a, b, c, d) = (of(0), of(1), of(2), of(3));
        b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
    };
    HandheldPose {
        position: DVec3::new(value(&|h| h.position.x), value(&|h| h.position.y), value(&|h| h.position.z)),
        yaw: value(&|h| h.yaw),
        pitch: value(&|h| h.pitch),
        roll: value(&|h| h.roll),
    }
}

fn is_valid(world: &World, path: &[HandheldPose]) -> bool {
    let spaced = |parts: usize| (0..=parts).filter_map(move |part| path.get(part * (path.len() - 1) / parts));
    spaced(4).all(|pose| is_free(world, pose.position))
        && spaced(40).all(|pose| is_free(world, pose.position))
        && spaced(6).all(|pose| shows_enough(world, pose.position, pose.forward(), 2.0))
}
