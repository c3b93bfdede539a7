use atsplat_numeric::Extremes;
use glam::{DMat3, DQuat, DVec3};

use super::quaternion;
use crate::WorldFromCamera;
use crate::so3::{exp, log};

/// The motion from one pose to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Segment {
    pub(super) start: f64,
    pub(super) duration: f64,
    from: Knot,
    to: Knot,
}

/// A pose and its velocity per unit of time.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Knot {
    centre: DVec3,
    rotation: DQuat,
    velocity: DVec3,
    /// Angular velocity in the camera's own axes.
    spin: DVec3,
}

/// Mean velocity and angular velocity from one pose to the next.
#[derive(Clone, Copy)]
struct Rate {
    duration: f64,
    velocity: DVec3,
    spin: DVec3,
}

/// The segments between consecutive poses; none for a single pose.
pub(super) fn through(times: &[f64], poses: &[WorldFromCamera]) -> Vec<Segment> {
    let rotations: Vec<DQuat> = poses.iter().map(quaternion).collect();
    let vectors: Vec<DVec3> = rotations.windows(2).map(|pair| log(pair[0].inverse() * pair[1])).collect();
    let rates: Vec<Rate> = vectors
        .iter()
        .zip(times.windows(2).zip(poses.windows(2)))
        .map(|(vector, (times, poses))| {
            let duration = times[1] - times[0];
            Rate { duration, velocity: (poses[1].centre() - poses[0].centre()) / duration, spin: vector / duration }
        })
        .collect();
    let knot = |index: usize| {
        // A rotation's axis is the same in the frames of both its ends, so adjacent spins may be averaged.
        let (velocity, spin) = tangent(index.checked_sub(1).and_then(|i| rates.get(i)), rates.get(index));
        Knot { centre: poses[index].centre(), rotation: rotations[index], velocity, spin }
    };
    (0..rates.len())
        .map(|index| Segment {
            start: times[index],
            duration: rates[index].duration,
            from: knot(index),
            to: knot(index + 1),
        })
        .collect()
}

/// With tangents up to this multiple of the slower side's rate a cubic does not overshoot (Fritsch and Carlson 1980);
/// it also keeps a control rotation within the rotation of its segment.
const OVERSHOOT_LIMIT: f64 = 3.0;

/// Slope at the middle of the parabola through three poses, limited: the weight of a side decreases with its duration.
fn tangent(before: Option<&Rate>, after: Option<&Rate>) -> (DVec3, DVec3) {
    match (before, after) {
        (Some(a), Some(b)) => {
            let weight = b.duration / (a.duration + b.duration);
            let mix = |a: DVec3, b: DVec3| {
                let limit = OVERSHOOT_LIMIT * a.length().minimum_of(b.length());
                a.lerp(b, 1.0 - weight).clamp_length_max(limit)
            };
            (mix(a.velocity, b.velocity), mix(a.spin, b.spin))
        }
        (Some(only), None) | (None, Some(only)) => (only.velocity, only.spin),
        (None, None) => (DVec3::ZERO, DVec3::ZERO),
    }
}

impl Segment {
    /// The pose at a time inside the segment.
    pub(super) fn pose_at(&self, time: f64) -> WorldFromCamera {
        let u = (time - self.start) / self.duration;
        WorldFromCamera::from_parts(DMat3::from_quat(self.bezier(u).normalize()), self.hermite(u))
    }

    /// Speed of the centre at `u` in [0, 1], per unit of `u`.
    pub(super) fn speed(&self, u: f64) -> f64 {
        let step = self.to.centre - self.from.centre;
        let (a, b) = (self.from.velocity * self.duration, self.to.velocity * self.duration);
        (step * (6.0 * u * (1.0 - u)) + a * ((1.0 - u) * (1.0 - 3.0 * u)) + b * (u * (3.0 * u - 2.0))).length()
    }

    /// The cubic with the centres and velocities of both ends, written as an offset from the straight line, so that the
    /// ends are exact and equal centres stay equal.
    fn hermite(&self, u: f64) -> DVec3 {
        let step = self.to.centre - self.from.centre;
        let (a, b) = (self.from.velocity * self.duration - step, self.to.velocity * self.duration - step);
        self.from.centre.lerp(self.to.centre, u) + (a * (1.0 - u) - b * u) * (u * (1.0 - u))
    }

    /// De Casteljau's construction with slerps. The two inner control rotations are a third of the spin away from the
    /// ends, because the velocity of a Bézier curve at its end is three times the step to the next control point.
    fn bezier(&self, u: f64) -> DQuat {
        let third = self.duration / 3.0;
        let mut controls = [
            self.from.rotation,
            self.from.rotation * exp(self.from.spin * third),
            self.to.rotation * exp(self.to.spin * -third),
            self.to.rotation,
        ];
        for level in (1..controls.len()).rev() {
            for index in 0..level {
                controls[index] = slerp(controls[index], controls[index + 1], u);
            }
        }
        controls[0]
    }
}

fn slerp(from: DQuat, to: DQuat, u: f64) -> DQuat {
    from * exp(log(from.inverse() * to) * u)
}
