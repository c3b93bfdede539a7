//! DL3DV-like paths: a walk through the scene with changing directions of view.

use atsplat_numeric::Extremes as _;
use glam::{DVec2, DVec3};

use super::{HandheldPose, SLOWEST, is_free_along, no_room, shows_enough, spaced};
use crate::RoomsError;
use crate::rng::Rng;
use crate::world::World;

/// Microseconds between views, five per second.
const MICROS: f64 = 200_000.0;
const STOPS: usize = 6;
const TRIES: usize = 40;
/// Largest angle of a path around its centre, in radians: paths do not close.
const SWEEP: f64 = 5.5;

/// A path, the microseconds per frame, and the share of the drawn speed to which it is slowed.
///
/// # Errors
/// [`RoomsError::Request`] if no path fits.
pub(super) fn walk(rng: &mut Rng, world: &World, frames: usize) -> Result<(Vec<HandheldPose>, f64, f64), RoomsError> {
    let speed = rng.within(0.4, 0.9);
    let mut slowed_to = 1.0;
    while slowed_to >= SLOWEST {
        for _ in 0..TRIES {
            let (path, share) = candidate(rng, world, frames, speed * slowed_to);
            if is_valid(world, &path) {
                return Ok((path, MICROS, slowed_to * share));
            }
        }
        slowed_to *= 0.9;
    }
    Err(no_room(frames))
}

/// A path around a point of the scene at varying distance, looking mostly at it, and the share of `speed` that it has: less than
/// 1 where the path would go around by more than [`SWEEP`].
fn candidate(rng: &mut Rng, world: &World, frames: usize, speed: f64) -> (Vec<HandheldPose>, f64) {
    let [low, high] = world.space;
    let between = |rng: &mut Rng, low: f64, high: f64| low + (high - low) * rng.within(0.2, 0.8);
    let about = DVec2::new(between(rng, low.x, high.x), between(rng, low.y, high.y));
    let radius = rng.within(1.5, 5.5);
    let length = speed * frames as f64 * MICROS * 1e-6;
    let sweep = (length / radius).clamp(0.0, SWEEP) * rng.sign();
    let share = (SWEEP * radius / length).minimum_of(1.0);
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
    let path = (0..frames).map(|frame| between_stops(&stops, frame as f64 / frames as f64));
    (path.collect(), share)
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
    is_free_along(world, path, [4, 40])
        && spaced(path, 6).all(|pose| shows_enough(world, pose.position, pose.forward(), 2.0))
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::SceneKind;
    use crate::rng::mix;

    /// 180 m do not fit around any centre: at the largest radius of 5.5 m, 5.5 radians are 30 m. The measured length differs from
    /// the nominal one because the distance to the centre varies.
    #[test]
    fn a_path_that_would_go_around_too_far_is_slower_than_asked() {
        let world = crate::build::world(SceneKind::Yards, mix(7));
        for seed in 0..20 {
            let of_frames = |frames| candidate(&mut Rng::new(seed), &world, frames, 0.9);
            Tolerance::EXACT.assert([of_frames(25).1], [1.0], "4.5 m fit around every centre");
            let (path, share) = of_frames(1000);
            let length: f64 = path.windows(2).map(|pair| pair[0].position.distance(pair[1].position)).sum();
            Tolerance::relative(0.25).assert([share], [length / 180.0], &format!("share of 180 m, seed {seed}"));
        }
    }

    #[test]
    fn walks_that_must_be_slower_than_drawn_say_so() {
        for seed in 0..4 {
            let world = crate::build::world(SceneKind::Yards, mix(seed));
            let (_, _, slowed_to) = walk(&mut Rng::new(seed), &world, 1000).unwrap();
            // At least 80 m are drawn, and at most 30.25 m walked.
            assert!(slowed_to <= 30.25 / 80.0, "{seed}: {slowed_to}");
        }
    }
}
