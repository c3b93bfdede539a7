use atsplat_numeric::Extremes;

use crate::WorldFromCamera;

/// If stored numbers are off by u, the centre `−R⁻¹t` is off by at most 3u of its distance from the origin for the rotation, and √3u
/// for the translation, where f32 adds at most u of the distance: two centres of one place differ by at most 6u of 1 plus the distance.
const F32: f64 = 6.0 / 16_777_216.0;
const NINE_DECIMALS: f64 = 6.0 * 5e-10;

/// Inverting a pose twice changes its rotation by less, and its translation by less of its length: 6e-16 is the most of 20 000 poses.
const TWO_INVERSIONS: f64 = 4e-15;

/// Below this share of their distance from the origin, f32 does not resolve the differences of centres.
const CLOSE: f64 = 1e-6;

/// How far apart the centres of cameras are, compared with the precision of their poses.
///
/// The precision is that of f32 if all numbers of all camera-from-world poses are f32, as those of `.torch` chunks, and nine decimals
/// otherwise: text has at least about as many, also of quaternions, and nothing says how many of the digits of an f64 are known. Loading
/// keeps these numbers as they are. Poses that are turned by right angles alone count as nine decimals: whole numbers, such as the
/// coordinates of nadir images in metres, would be f32 too. In f32, such cameras in one place still coincide, because their centres
/// have the very numbers of their translations.
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
        let are_in_f32 = views.iter().copied().all(is_in_f32) && views.iter().copied().any(is_turned);
        let precision = if are_in_f32 { F32 } else { NINE_DECIMALS };
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

/// Whether the camera-from-world pose consists of f32 numbers.
fn is_in_f32(view: &WorldFromCamera) -> bool {
    let stored = view.inverse();
    let length = stored.translation().length();
    let is_f32 = |number: f64, size: f64| {
        #[expect(clippy::cast_possible_truncation, reason = "what an f32 keeps")]
        let rounded = f64::from(number as f32);
        (number - rounded).abs() <= TWO_INVERSIONS * size
    };
    stored.rotation().to_cols_array().iter().all(|entry| is_f32(*entry, 1.0))
        && stored.translation().to_array().iter().all(|entry| is_f32(*entry, length))
}

/// Whether a pose is turned by other angles than right ones. No such rotation consists of binary numbers with few digits.
fn is_turned(view: &WorldFromCamera) -> bool {
    view.rotation().to_cols_array().iter().any(|entry| (entry - entry.round()).abs() > TWO_INVERSIONS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CameraFromWorld;
    use glam::{DMat3, DQuat, DVec3, EulerRot};

    fn in_f32(number: f64) -> f64 {
        #[expect(clippy::cast_possible_truncation, reason = "what a chunk stores")]
        let rounded = number as f32;
        f64::from(rounded)
    }

    fn with_nine_decimals(number: f64) -> f64 {
        (number * 1e9).round() / 1e9
    }

    fn with_twelve_decimals(number: f64) -> f64 {
        (number * 1e12).round() / 1e12
    }

    /// The rotation of one of five cameras that turn about two axes.
    fn turned(at: u32) -> DMat3 {
        DMat3::from_euler(EulerRot::YXZ, 0.2 + 0.17 * f64::from(at), 0.05 * f64::from(at), 0.3)
    }

    /// These cameras, stored as `[R | t]` by `rounded`; each centre is `step` along x from the one before.
    fn spread(centre: DVec3, step: f64, rounded: impl Fn(f64) -> f64) -> CentreSpread {
        let pose = |at: u32| {
            let rotation = turned(at);
            let translation = -(rotation * (centre + DVec3::X * step * f64::from(at)));
            let rows = CameraFromWorld::new(rotation, translation).unwrap().to_rows();
            CameraFromWorld::from_rows(&rows.map(&rounded)).unwrap().inverse()
        };
        CentreSpread::of(&(0..5).map(pose).collect::<Vec<_>>())
    }

    /// As COLMAP stores cameras in one place: a quaternion, which readers normalise, and the translation.
    fn spread_of_quaternions(centre: DVec3, rounded: impl Fn(f64) -> f64) -> CentreSpread {
        let pose = |at: u32| {
            let rotation = turned(at);
            let quaternion = DQuat::from_mat3(&rotation).to_array().map(&rounded);
            let translation = (-(rotation * centre)).to_array().map(&rounded);
            let read = DMat3::from_quat(DQuat::from_array(quaternion).normalize());
            CameraFromWorld::new(read, DVec3::from_array(translation)).unwrap().inverse()
        };
        CentreSpread::of(&(0..5).map(pose).collect::<Vec<_>>())
    }

    /// However far from the origin: the precision of what is stored, not that of f64, tells a place from a motion.
    #[test]
    fn cameras_that_only_turn_coincide_in_every_precision() {
        let direction = DVec3::new(1.3, -2.7, 3.1);
        for centre in [1e-2, 1.0, 1e3, 1e6].map(|scale| scale * direction) {
            assert_eq!(spread(centre, 0.0, |number| number), CentreSpread::Coincident, "f64, {centre}");
            assert_eq!(spread(centre, 0.0, with_nine_decimals), CentreSpread::Coincident, "nine decimals, {centre}");
            assert_eq!(spread(centre, 0.0, in_f32), CentreSpread::Coincident, "f32, {centre}");
            for rounded in [with_nine_decimals as fn(f64) -> f64, with_twelve_decimals] {
                assert_eq!(spread_of_quaternions(centre, rounded), CentreSpread::Coincident, "quaternions, {centre}");
            }
        }
    }

    #[test]
    fn small_steps_are_apart_where_they_are_stored() {
        let centre = DVec3::new(1.3, -2.7, 3.1);
        for (step, expected) in [
            (1e-3, [CentreSpread::Apart; 3]),
            (2e-7, [CentreSpread::Close, CentreSpread::Close, CentreSpread::Coincident]),
            (1e-10, [CentreSpread::Coincident; 3]),
        ] {
            let rules: [fn(f64) -> f64; 3] = [|number| number, with_nine_decimals, in_f32];
            assert_eq!(rules.map(|rounded| spread(centre, step, rounded)), expected, "{step}");
        }
        let far = DVec3::new(1e6, 0.0, -2e5);
        assert_eq!(spread(far, 1e-1, |number| number), CentreSpread::Close, "more than 3e-9 of the distance");
        assert_eq!(spread(far, 10.0, |number| number), CentreSpread::Apart);
    }

    /// Georeferenced captures, whose camera-to-world rotations are in f32, and their centres in f64.
    #[test]
    fn a_rig_far_from_the_origin_does_not_stand_still() {
        let origin = DVec3::new(4.5e5, 5.4e6, 120.0);
        let rig = |step: f64| {
            let pose = |at: u32| {
                let rotation = DMat3::from_cols_array(&turned(at).transpose().to_cols_array().map(in_f32));
                WorldFromCamera::new(rotation, origin + DVec3::X * step * f64::from(at)).unwrap()
            };
            CentreSpread::of(&(0..5).map(pose).collect::<Vec<_>>())
        };
        assert_eq!([0.0, 1.0, 10.0].map(rig), [CentreSpread::Coincident, CentreSpread::Close, CentreSpread::Apart]);
    }

    /// Whole numbers are f32, which says nothing of their precision.
    #[test]
    fn nadir_images_a_metre_apart_are_not_one_place() {
        let nadir = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let rolled = DMat3::from_rotation_z(std::f64::consts::FRAC_PI_2) * nadir;
        let pair = |step: f64, rounded: fn(f64) -> f64| {
            let pose = |(rotation, x): (DMat3, f64)| {
                let translation = -(rotation.transpose() * DVec3::new(x, 5_412_345.0, 120.0));
                let rows = CameraFromWorld::new(rotation.transpose(), translation).unwrap().to_rows();
                CameraFromWorld::from_rows(&rows.map(rounded)).unwrap().inverse()
            };
            CentreSpread::of(&[(nadir, 450_000.0), (rolled, 450_000.0 + step)].map(pose))
        };
        let expected = [CentreSpread::Coincident, CentreSpread::Close, CentreSpread::Apart];
        assert_eq!([0.0, 1.0, 10.0].map(|step| pair(step, |number| number)), expected);
        assert_eq!([0.0, 1.0, 10.0].map(|step| pair(step, in_f32)), expected);
    }

    #[test]
    fn one_camera_and_extreme_numbers_have_a_spread() {
        let at = |x: f64| WorldFromCamera::new(DMat3::IDENTITY, DVec3::new(x, 0.0, 0.0)).unwrap();
        assert_eq!(CentreSpread::of(&[at(1e300)]), CentreSpread::Coincident);
        assert_eq!(CentreSpread::of(std::iter::empty()), CentreSpread::Coincident);
        assert_eq!(CentreSpread::of(&[at(1e300), at(-1e300)]), CentreSpread::Apart, "the distance overflows");
    }
}
