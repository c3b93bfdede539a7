use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use atsplat_numeric::Extremes;
use glam::{DVec2, DVec3, Vec3};

use crate::noise::as_f32;
use crate::ray_packet::Extent;

/// A light source other than the sky. The body of a lamp is a separate object.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Lamp {
    /// A rectangle with these half sides that emits to the side of `half_u × half_v`.
    Panel { centre: DVec3, half_u: DVec3, half_v: DVec3, radiance: Vec3 },
    /// A ball.
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
    /// Irradiance / π at a surface that sees the whole lamp: exact for a bulb and the sun, approximated from a panel's centre.
    pub(crate) fn reaches(&self, point: DVec3, normal: DVec3) -> Vec3 {
        match *self {
            Self::Panel { centre, half_u, half_v, radiance } => {
                let (towards, face) = (centre - point, half_u.cross(half_v));
                let (cosines, area) = (cosine(normal, towards) * cosine(face, -towards), 4.0 * face.length());
                // Close to a panel it is bounded like the light of a disc of this area.
                radiance * as_f32(cosines * area / (PI * towards.length_squared() + area))
            }
            Self::Bulb { centre, radius, radiance } => {
                let (towards, disc) = (centre - point, radius * radius);
                // From its surface on, the ball fills the view.
                radiance * as_f32(cosine(normal, towards) * disc / towards.length_squared().maximum_of(disc))
            }
            Self::Sun { direction, irradiance, .. } => irradiance * as_f32(normal.dot(direction).clamp(0.0, 1.0) / PI),
        }
    }

    /// The box that contains `origin + towards(origin, …)`, or for the sun `towards` itself, for any origin.
    pub(crate) fn extent(&self) -> LampExtent {
        match *self {
            Self::Panel { centre, half_u, half_v, .. } => {
                LampExtent::Near(Extent::around(centre, half_u.abs() + half_v.abs() + DVec3::splat(SHORT)))
            }
            // The rim of the visible disc is √2 radii from the centre.
            Self::Bulb { centre, radius, .. } => {
                LampExtent::Near(Extent::around(centre, DVec3::splat(1.5 * radius + SHORT)))
            }
            Self::Sun { direction, radius, .. } => {
                LampExtent::Far(Extent::around(direction * FAR, DVec3::splat(1.5 * radius * FAR)))
            }
        }
    }

    /// Vector from `point` to a random point of the lamp, not normalised: a shadow ray with `t` up to 1.
    /// `uniform` is uniform in [0, 1)²; its middle is the centre of the lamp as seen from `point`.
    pub(crate) fn towards(&self, point: DVec3, uniform: DVec2) -> DVec3 {
        let place = match *self {
            Self::Panel { centre, half_u, half_v, .. } => {
                centre + half_u * (2.0 * uniform.x - 1.0) + half_v * (2.0 * uniform.y - 1.0)
            }
            Self::Bulb { centre, radius, .. } => {
                // The visible side, as a disc perpendicular to the line of sight.
                let away = (centre - point).normalize_or(DVec3::Z);
                centre + (across(away, uniform) - away) * radius
            }
            Self::Sun { direction, radius, .. } => {
                return (direction + across(direction, uniform) * radius).normalize() * FAR;
            }
        };
        let offset = place - point;
        offset * (1.0 - SHORT / (offset.length() + SHORT))
    }
}

/// The cosine of the angle between two vectors; 0 if it is not positive.
fn cosine(a: DVec3, b: DVec3) -> f64 {
    let along = a.dot(b);
    if along > 0.0 { (along / (a.length_squared() * b.length_squared()).sqrt()).clamp(0.0, 1.0) } else { 0.0 }
}

/// A point of the unit disc around the origin that is perpendicular to the unit vector `axis`.
fn across(axis: DVec3, uniform: DVec2) -> DVec3 {
    let (right, up) = axis.any_orthonormal_pair();
    let point = disc_point(uniform);
    right * point.x + up * point.y
}

/// Uniform on the unit disc from two uniform numbers: squares around the middle of [0, 1)² become circles (Shirley and Chiu,
/// "A low distortion map between disk and square", 1997).
fn disc_point(uniform: DVec2) -> DVec2 {
    let DVec2 { x, y } = 2.0 * uniform - DVec2::ONE;
    let (radius, angle) = if x.abs() > y.abs() {
        (x, FRAC_PI_4 * (y / x))
    } else if y.abs() > 0.0 {
        (y, FRAC_PI_2 - FRAC_PI_4 * (x / y))
    } else {
        (0.0, 0.0)
    };
    DVec2::from_angle(angle) * radius
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    /// A panel of 0.4 m by 0.6 m, 3 m above the origin, that emits downwards.
    fn panel() -> Lamp {
        let (half_u, half_v) = (DVec3::Y * 0.3, DVec3::X * 0.2);
        Lamp::Panel { centre: DVec3::Z * 3.0, half_u, half_v, radiance: Vec3::new(5.0, 4.0, 3.0) }
    }

    fn bulb() -> Lamp {
        Lamp::Bulb { centre: DVec3::Z * 0.5, radius: 0.2, radiance: Vec3::new(3.0, 2.0, 1.0) }
    }

    /// 60° from the vertical.
    fn sun() -> Lamp {
        let direction = DVec3::new(0.75f64.sqrt(), 0.0, 0.5);
        Lamp::Sun { direction, radius: 0.006, irradiance: Vec3::new(6.0, 5.0, 4.0) }
    }

    fn reached(lamp: Lamp, cases: &[(DVec3, DVec3)]) -> Vec<f64> {
        cases.iter().map(|(point, normal)| f64::from(lamp.reaches(*point, *normal).x)).collect()
    }

    /// Far from a panel, irradiance is radiance · area · both cosines / distance².
    #[test]
    fn a_panel_lights_what_is_before_it() {
        let aside = DVec3::X * 27f64.sqrt();
        let towards = DVec3::new(-(0.75f64.sqrt()), 0.0, 0.5);
        let cases = [
            (DVec3::ZERO, DVec3::Z),
            (aside, DVec3::Z),
            (aside, towards),
            (aside, -towards),
            (DVec3::ZERO, DVec3::NEG_Z),
            (DVec3::Z * 4.0, DVec3::NEG_Z),
        ];
        let expected = [0.042_441, 0.002_652_6, 0.005_305_2, 0.0, 0.0, 0.0];
        Tolerance::relative(0.01).assert(reached(panel(), &cases), expected, "panel");
    }

    /// Irradiance is π · radiance · (radius / distance)² · cosine, and no more than of a full view of the ball.
    #[test]
    fn a_bulb_lights_like_a_ball() {
        let cases = [
            (DVec3::ZERO, DVec3::Z),
            (DVec3::ZERO, DVec3::new(0.6, 0.0, 0.8)),
            (DVec3::Z * -1.5, DVec3::Z),
            (DVec3::Z * 0.3, DVec3::Z),
            (DVec3::Z * 0.4, DVec3::Z),
            (DVec3::ZERO, DVec3::NEG_Z),
        ];
        Tolerance::relative(1e-6).assert(reached(bulb(), &cases), [0.48, 0.384, 0.03, 3.0, 3.0, 0.0], "bulb");
        assert_eq!(bulb().reaches(DVec3::Z * 0.5, DVec3::Z), Vec3::ZERO, "a surface in the centre has no side");
    }

    #[test]
    fn the_sun_lights_with_the_cosine() {
        let cases = [(DVec3::ZERO, DVec3::Z), (DVec3::ONE, DVec3::X), (DVec3::ZERO, DVec3::NEG_X)];
        Tolerance::relative(1e-6).assert(reached(sun(), &cases), [0.954_929_66, 1.653_986_7, 0.0], "sun");
    }

    #[test]
    fn the_middle_of_the_square_is_the_centre_of_the_lamp() {
        let point = DVec3::new(0.7, -0.4, 0.1);
        let centres = [(panel(), DVec3::Z * 3.0 - point), (bulb(), DVec3::Z * 0.5 - point)];
        for (lamp, centre) in centres.into_iter().chain([(sun(), DVec3::new(0.75f64.sqrt(), 0.0, 0.5))]) {
            let found = lamp.towards(point, DVec2::splat(0.5)).normalize();
            Tolerance::F64.assert(found.to_array(), centre.normalize().to_array(), &format!("{lamp:?}"));
        }
    }

    #[test]
    fn shadow_rays_end_in_the_extent() {
        for lamp in [panel(), bulb(), sun()] {
            for point in [DVec3::ZERO, DVec3::new(2.0, -1.0, -0.3)] {
                for at in 0..441u32 {
                    let uniform = DVec2::new(f64::from(at % 21), f64::from(at / 21)) / 20.0;
                    let to = lamp.towards(point, uniform);
                    let (end, extent) = match lamp.extent() {
                        LampExtent::Near(extent) => (point + to, extent),
                        LampExtent::Far(extent) => (to, extent),
                    };
                    let inside = end.cmpge(extent.low).all() && end.cmple(extent.high).all();
                    assert!(inside, "{lamp:?}: {end} of {uniform}");
                }
            }
        }
    }

    /// Where an edge hides half of the disc's width, half of its light arrives; a quarter of it is within half the radius.
    #[test]
    fn shadow_rays_cover_the_discs_of_bulb_and_sun_evenly() {
        // The disc of the bulb is its radius nearer than the centre.
        let discs = [(bulb(), DVec3::Z * 0.3, 0.2), (sun(), DVec3::new(0.75f64.sqrt(), 0.0, 0.5), 0.006)];
        for (lamp, middle, radius) in discs {
            let axis = middle.normalize();
            let points: Vec<DVec3> = (0..10_000u32)
                .map(|at| {
                    let uniform = (DVec2::new(f64::from(at % 100), f64::from(at / 100)) + 0.5) / 100.0;
                    let to = lamp.towards(DVec3::ZERO, uniform);
                    (to * (middle.length() / to.dot(axis)) - middle) / radius
                })
                .collect();
            let share = |inside: &dyn Fn(DVec3) -> bool| points.iter().filter(|p| inside(**p)).count() as f64 / 1e4;
            let (right, up) = axis.any_orthonormal_pair();
            let found = [
                share(&|p: DVec3| p.length() <= 1.0),
                share(&|p: DVec3| p.length() < 0.5),
                share(&|p: DVec3| p.dot(right) > 0.0),
                share(&|p: DVec3| p.dot(right + up) > 1.0),
            ];
            // The last is the disc's segment beyond 1/√2: (π/4 − 1/2) / π.
            Tolerance::absolute(0.005).assert(found, [1.0, 0.25, 0.5, 0.090_845], &format!("{lamp:?}"));
        }
    }
}
