use glam::{DVec2, DVec3, Vec3};

use crate::rng::sphere_point;

/// Something that gives light, apart from the sky. A lamp's own body is an object like others.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Lamp {
    /// A rectangle with these half sides that shines to the side of `half_u × half_v`.
    Panel { centre: DVec3, half_u: DVec3, half_v: DVec3, radiance: Vec3 },
    /// A ball that is part of a fitting.
    Bulb { centre: DVec3, radius: f64, radiance: Vec3 },
    /// The sun: the direction to it, its radius in radians, and what it sends to a surface that faces it.
    Sun { direction: DVec3, radius: f64, irradiance: Vec3 },
}

/// Shadow rays end this far before a lamp, in metres.
const SHORT: f64 = 1e-3;

impl Lamp {
    /// Irradiance over π at a surface that sees all of the lamp, from its middle.
    pub(crate) fn reaches(&self, point: DVec3, normal: DVec3) -> Vec3 {
        let gathered = |towards: DVec3, area: f64, shines: f64| {
            let facing = normal.dot(towards);
            if facing <= 0.0 || shines <= 0.0 {
                return 0.0;
            }
            let squared = towards.length_squared();
            let cosine = facing / squared.sqrt();
            // Close up a lamp is no point: at most as much as it would give from its own radius.
            cosine.clamp(0.0, 1.0) * shines * area / (std::f64::consts::PI * squared + area)
        };
        match *self {
            Self::Panel { centre, half_u, half_v, radiance } => {
                let (towards, face) = (centre - point, half_u.cross(half_v));
                let along = -towards.dot(face);
                if along <= 0.0 {
                    return Vec3::ZERO;
                }
                let size = face.length();
                let shines = along / (towards.length() * size);
                radiance * as_colour(gathered(towards, 4.0 * size, shines.clamp(0.0, 1.0)))
            }
            Self::Bulb { centre, radius, radiance } => {
                radiance * as_colour(gathered(centre - point, std::f64::consts::PI * radius * radius, 1.0))
            }
            Self::Sun { direction, irradiance, .. } => {
                irradiance * as_colour(normal.dot(direction).clamp(0.0, 1.0) / std::f64::consts::PI)
            }
        }
    }

    /// A place on the lamp as seen from `point`: the way there, not normalised, to travel up to `t = 1`.
    /// `dice` are uniform in [0, 1)².
    pub(crate) fn towards(&self, point: DVec3, dice: DVec2) -> DVec3 {
        let place = match *self {
            Self::Panel { centre, half_u, half_v, .. } => {
                centre + half_u * (2.0 * dice.x - 1.0) + half_v * (2.0 * dice.y - 1.0)
            }
            Self::Bulb { centre, radius, .. } => {
                // The side that can be seen: a disc across the way.
                let away = (centre - point).normalize_or(DVec3::Z);
                let (right, up) = away.any_orthonormal_pair();
                let (sin, cos) = (std::f64::consts::TAU * dice.y).sin_cos();
                centre - away * radius + (right * cos + up * sin) * (radius * dice.x.sqrt())
            }
            Self::Sun { direction, radius, .. } => {
                return (direction + sphere_point(dice) * radius).normalize() * 1e3;
            }
        };
        let way = place - point;
        way * (1.0 - SHORT / (way.length() + SHORT))
    }
}

#[expect(clippy::cast_possible_truncation, reason = "a share of light")]
const fn as_colour(share: f64) -> f32 {
    share as f32
}
