use atsplat_numeric::Extremes;

use crate::WorldFromCamera;

/// Rotations of poses in f64, also if computed from quaternions or inverted, are less far from orthonormal.
const F64_RESIDUAL: f64 = 1e-13;
/// Rotations with nine decimals are less far from orthonormal, those in f32 farther: 1e-9 and 5e-8 are usual.
const NINE_DECIMALS_RESIDUAL: f64 = 4e-9;

/// If stored numbers are off by u, the centre `−R⁻¹t` is off by at most 3u of its distance from the origin for the rotation, and √3u
/// for the translation, where f32 adds at most u of the distance: two centres of one place differ by at most 6u of 1 plus the distance.
const F32: f64 = 6.0 / 16_777_216.0;
const NINE_DECIMALS: f64 = 6.0 * 5e-10;
/// Above 6u, for the arithmetic of a few transforms.
const F64: f64 = 1e-14;

/// Below this share of their distance from the origin, f32 does not resolve the differences of centres.
const CLOSE: f64 = 1e-6;

/// How far apart the centres of cameras are, compared with the precision of their poses.
///
/// The precision is that of the least precise pose, which shows in how far its rotation is from orthonormal: f64, nine decimals, or f32.
/// Unlike a precision for each format, it is that of the numbers however often they were converted: chunks of f32 stay so as text with
/// nine decimals. Loading keeps these numbers as they are. Rotations that are less precise than f32 count as f32, because their error may
/// be that of an estimate. If all rotations happen to be more precise than the translations, such as quarter turns, cameras in one
/// place may be found [`Self::Close`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CentreSpread {
    /// Their differences are numbers to compute with.
    Apart,
    /// Closer together than 1e-6 of their distance from the origin, but farther apart than their precision.
    Close,
    /// One place, within the precision of the poses; also a single camera, or none.
    Coincident,
}

impl CentreSpread {
    /// The spread of these cameras' centres.
    pub fn of<'a>(views: impl IntoIterator<Item = &'a WorldFromCamera>) -> Self {
        let views: Vec<&WorldFromCamera> = views.into_iter().collect();
        let Some(first) = views.first().map(|view| view.centre()) else { return Self::Coincident };
        let largest = |of: &dyn Fn(&WorldFromCamera) -> f64| {
            views.iter().copied().fold(0.0f64, |largest, view| largest.maximum_of(of(view)))
        };
        let spread = largest(&|view| view.centre().distance(first));
        let distance = largest(&|view| view.centre().length());
        let precision = match largest(&WorldFromCamera::orthonormality_residual) {
            residual if residual <= F64_RESIDUAL => F64,
            residual if residual <= NINE_DECIMALS_RESIDUAL => NINE_DECIMALS,
            _ => F32,
        };
        if !spread.is_finite() {
            Self::Apart
        } else if spread <= precision * (1.0 + distance) {
            Self::Coincident
        } else if spread <= CLOSE * distance {
            Self::Close
        } else {
            Self::Apart
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CameraFromWorld;
    use glam::{DMat3, DVec3, EulerRot};

    fn in_f32(number: f64) -> f64 {
        #[expect(clippy::cast_possible_truncation, reason = "what a chunk stores")]
        let rounded = number as f32;
        f64::from(rounded)
    }

    fn with_nine_decimals(number: f64) -> f64 {
        (number * 1e9).round() / 1e9
    }

    /// Cameras that turn about two axes, stored as `[R | t]` by `rounded`; each centre is `step` along x from the one before.
    fn turning(centre: DVec3, step: f64, rounded: impl Fn(f64) -> f64) -> Vec<WorldFromCamera> {
        let pose = |at: u32| {
            let turn = f64::from(at);
            let rotation = DMat3::from_euler(EulerRot::YXZ, 0.2 + 0.17 * turn, 0.05 * turn, 0.3);
            let rows =
                CameraFromWorld::new(rotation, -(rotation * (centre + DVec3::X * step * turn))).unwrap().to_rows();
            CameraFromWorld::from_rows(&rows.map(&rounded)).unwrap().inverse()
        };
        (0..5).map(pose).collect()
    }

    fn spread(centre: DVec3, step: f64, rounded: impl Fn(f64) -> f64) -> CentreSpread {
        CentreSpread::of(&turning(centre, step, rounded))
    }

    /// However far from the origin: the precision of what is stored, not that of f64, tells a place from a motion.
    #[test]
    fn cameras_that_only_turn_coincide_in_every_precision() {
        let direction = DVec3::new(1.3, -2.7, 3.1);
        for centre in [1e-2, 1.0, 1e3, 1e6].map(|scale| scale * direction) {
            assert_eq!(spread(centre, 0.0, |number| number), CentreSpread::Coincident, "f64, {centre}");
            assert_eq!(spread(centre, 0.0, with_nine_decimals), CentreSpread::Coincident, "nine decimals, {centre}");
            assert_eq!(spread(centre, 0.0, in_f32), CentreSpread::Coincident, "f32, {centre}");
            let converted = |number: f64| with_nine_decimals(in_f32(number));
            assert_eq!(spread(centre, 0.0, converted), CentreSpread::Coincident, "text of chunks, {centre}");
        }
    }

    #[test]
    fn small_steps_are_apart_where_they_are_stored() {
        let centre = DVec3::new(1.3, -2.7, 3.1);
        for (step, expected) in [
            (1e-3, [CentreSpread::Apart; 3]),
            (2e-7, [CentreSpread::Close, CentreSpread::Close, CentreSpread::Coincident]),
            (1e-10, [CentreSpread::Close, CentreSpread::Coincident, CentreSpread::Coincident]),
        ] {
            let rules: [fn(f64) -> f64; 3] = [|number| number, with_nine_decimals, in_f32];
            assert_eq!(rules.map(|rounded| spread(centre, step, rounded)), expected, "{step}");
        }
        let far = DVec3::new(1e6, 0.0, -2e5);
        assert_eq!(spread(far, 1e-3, |number| number), CentreSpread::Close, "f64 has seven digits of a millimetre");
        assert_eq!(spread(far, 10.0, |number| number), CentreSpread::Apart);
    }

    #[test]
    fn one_camera_and_extreme_numbers_have_a_spread() {
        let at = |x: f64| WorldFromCamera::new(DMat3::IDENTITY, DVec3::new(x, 0.0, 0.0)).unwrap();
        assert_eq!(CentreSpread::of(&[at(1e300)]), CentreSpread::Coincident);
        assert_eq!(CentreSpread::of(std::iter::empty()), CentreSpread::Coincident);
        assert_eq!(CentreSpread::of(&[at(1e300), at(-1e300)]), CentreSpread::Apart, "the distance overflows");
    }
}
