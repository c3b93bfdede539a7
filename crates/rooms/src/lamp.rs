use glam::{DVec2, DVec3, Vec3};

use crate::bundle::Extent;
use crate::noise::as_f32;
use crate::rng::sphere_point;

/// A light source other than the sky. The body of a lamp is a separate object.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Lamp {
    /// A rectangle with these half sides that emits to the side of `half_u × half_v`.
    Panel { centre: DVec3, half_u: DVec3, half_v: DVec3, radiance: Vec3 },
    /// A sphere.
    Bulb { centre: DVec3, radius: f64, radiance: Vec3 },
    /// The sun: direction to it, angular radius in radians, and irradiance of a surface that faces it.
    Sun { direction: DVec3, radius: f64, irradiance: Vec3 },
}

/// The ends of shadow rays.
pub(crate) enum LampExtent {
    /// A box of positions.
    Near(Extent),
    /// A box of vectors from any origin.
    Far(Extent),
}

/// Length of shadow rays to the sun, in metres.
const FAR: f64 = 1e3;

/// Shadow rays end this far before a lamp, in metres.
const SHORT: f64 = 1e-3;

impl Lamp {
    /// Irradiance / π at a surface that sees the whole lamp, approximated from the lamp's centre.
    pub(crate) fn reaches(&self, point: DVec3, normal: DVec3) -> Vec3 {
        let gathered = |towards: DVec3, area: f64, shines: f64| {
            let facing = normal.dot(towards);
            if facing <= 0.0 || shines <= 0.0 {
                return 0.0;
            }
            let squared = towards.length_squared();
            let cosine = facing / squared.sqrt();
            // Close to a lamp the point approximation is bounded by the lamp's area.
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
                radiance * as_f32(gathered(towards, 4.0 * size, shines.clamp(0.0, 1.0)))
            }
            Self::Bulb { centre, radius, radiance } => {
                radiance * as_f32(gathered(centre - point, std::f64::consts::PI * radius * radius, 1.0))
            }
            Self::Sun { direction, irradiance, .. } => {
                irradiance * as_f32(normal.dot(direction).clamp(0.0, 1.0) / std::f64::consts::PI)
            }
        }
    }

    /// The box that contains `origin + towards(origin, …)`, or for the sun `towards` itself, for any origin.
    pub(crate) fn extent(&self) -> LampExtent {
        match *self {
            Self::Panel { centre, half_u, half_v, .. } => {
                LampExtent::Near(Extent::around(centre, half_u.abs() + half_v.abs()))
            }
            // The rim of the visible disc is √2 radii from the centre.
            Self::Bulb { centre, radius, .. } => LampExtent::Near(Extent::around(centre, DVec3::splat(1.5 * radius))),
            Self::Sun { direction, radius, .. } => {
                LampExtent::Far(Extent::around(direction * FAR, DVec3::splat(2.5 * radius * FAR)))
            }
        }
    }

    /// Vector from `point` to a random point of the lamp, not normalised: a shadow ray with `t` up to 1.
    /// `uniform` is uniform in [0, 1)².
    pub(crate) fn towards(&self, point: DVec3, uniform: DVec2) -> DVec3 {
        let place = match *self {
            Self::Panel { centre, half_u, half_v, .. } => {
                centre + half_u * (2.0 * uniform.x - 1.0) + half_v * (2.0 * uniform.y - 1.0)
            }
            Self::Bulb { centre, radius, .. } => {
                // The visible side, as a disc perpendicular to the line of sight.
                let away = (centre - point).normalize_or(DVec3::Z);
                let (right, up) = away.any_orthonormal_pair();
                let (sin, cos) = (std::f64::consts::TAU * uniform.y).sin_cos();
                centre - away * radius + (right * cos + up * sin) * (radius * uniform.x.sqrt())
            }
            Self::Sun { direction, radius, .. } => {
                return (direction + sphere_point(uniform) * radius).normalize() * FAR;
            }
        };
        let offset = place - point;
        offset * (1.0 - SHORT / (offset.length() + SHORT))
    }
}
