use atsplat_camera::CentreSpread;
use glam::{DMat3, DVec2, DVec3};

use super::{PointMatch, View};

/// The epipolar constraint of two posed pinhole views.
///
/// Points have to be undistorted first, by [`View::undistorted`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EpipolarGeometry {
    fundamental: DMat3,
    essential: DMat3,
    rotation: DMat3,
    translation: DVec3,
    first_plane_from_pixel: DMat3,
    second_plane_from_pixel: DMat3,
}

impl EpipolarGeometry {
    /// The geometry of two views; `None` if the camera centres coincide within the precision of their poses, so that there
    /// are no epipolar lines, or if a number is not finite.
    pub fn new(first: &View, second: &View) -> Option<Self> {
        let (world_from_first, world_from_second) =
            (first.camera.camera_from_world.inverse(), second.camera.camera_from_world.inverse());
        let spread = CentreSpread::of([&world_from_first, &world_from_second]);
        let second_from_first = world_from_second.camera_from_other(&world_from_first);
        let translation = second_from_first.translation().try_normalize()?;
        let rotation = second_from_first.rotation();
        let [tx, ty, tz] = translation.to_array();
        let cross = DMat3::from_cols_array(&[0.0, tz, -ty, -tz, 0.0, tx, ty, -tx, 0.0]);
        let essential = cross * rotation;
        let first_plane_from_pixel = first.pixel_from_plane().inverse();
        let second_plane_from_pixel = second.pixel_from_plane().inverse();
        let fundamental = second_plane_from_pixel.transpose() * essential * first_plane_from_pixel;
        (spread != CentreSpread::Coincident && fundamental.is_finite()).then_some(Self {
            fundamental,
            essential,
            rotation,
            translation,
            first_plane_from_pixel,
            second_plane_from_pixel,
        })
    }

    /// F with `second ᵀ · F · first = 0` for homogeneous pixels (Hartley and Zisserman, *Multiple View
    /// Geometry*, 2nd edition, §9.2).
    pub const fn fundamental(&self) -> DMat3 {
        self.fundamental
    }

    /// E with `second ᵀ · E · first = 0` on the z = 1 planes, for a translation of unit length (§9.6).
    pub const fn essential(&self) -> DMat3 {
        self.essential
    }

    /// Symmetric epipolar distance in pixels: the root mean square of the two distances between a point and the epipolar
    /// line of the other one (§11.4.3 sums their squares; the root of the mean is in pixels of one image).
    ///
    /// A point on the epipole is on every line. NaN for a NaN point.
    pub fn distance(&self, points: &PointMatch) -> f64 {
        let (first, second) = (points.first.extend(1.0), points.second.extend(1.0));
        let (line_in_second, line_in_first) = (self.fundamental * first, self.fundamental.transpose() * second);
        let residual = second.dot(line_in_second);
        let (a, b) = (from_line(residual, line_in_second), from_line(residual, line_in_first));
        (0.5 * (a * a + b * b)).sqrt()
    }

    /// Whether the triangulated point is in front of both cameras.
    ///
    /// Unlike the epipolar distance this detects a translation of the wrong sign. Parallel rays meet at infinity, in front
    /// if they point in the same direction.
    pub fn in_front(&self, points: &PointMatch) -> bool {
        let a = self.rotation * (self.first_plane_from_pixel * points.first.extend(1.0));
        let b = self.second_plane_from_pixel * points.second.extend(1.0);
        let t = self.translation;
        let (aa, ab, bb, at, bt) = (a.dot(a), a.dot(b), b.dot(b), a.dot(t), b.dot(t));
        let (depth_first, depth_second) = (ab * bt - bb * at, aa * bt - ab * at);
        if a.cross(b).length_squared() <= f64::EPSILON * aa * bb {
            return ab > 0.0;
        }
        depth_first > 0.0 && depth_second > 0.0
    }
}

/// Distance of a point from `line`, where `residual` is the value of the line's equation at the point.
fn from_line(residual: f64, line: DVec3) -> f64 {
    let slope = DVec2::new(line.x, line.y).length();
    if slope == 0.0 && residual == 0.0 { 0.0 } else { residual.abs() / slope }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::synthetic::{match_of, view};
    use atsplat_camera::{CameraFromWorld, WorldFromCamera};
    use atsplat_numeric::Tolerance;
    use proptest::prelude::*;

    /// For pixels of order 1000 through two 3×3 inverses.
    const PIXELS: Tolerance = Tolerance::absolute(1e-9);

    fn pair() -> (View, View) {
        (view([0.1, -0.2, 0.05], [0.0, 0.0, 0.0]), view([-0.1, 0.15, 0.0], [0.8, -0.1, 0.3]))
    }

    proptest! {
        #[test]
        fn true_matches_lie_on_their_lines_and_in_front(x in -1.5..1.5, y in -1.0..1.0, z in 3.0..40.0) {
            let (first, second) = pair();
            let geometry = EpipolarGeometry::new(&first, &second).unwrap();
            let points = match_of(&first, &second, DVec3::new(x, y, z)).unwrap();
            prop_assert!(PIXELS.accepts(geometry.distance(&points), 0.0), "{}", geometry.distance(&points));
            prop_assert!(geometry.in_front(&points));
        }

        #[test]
        fn the_distance_is_in_pixels(x in -1.5..1.5, y in -1.0..1.0, z in 3.0..40.0, step in 0.1..30.0) {
            let (first, second) = pair();
            let geometry = EpipolarGeometry::new(&first, &second).unwrap();
            let mut points = match_of(&first, &second, DVec3::new(x, y, z)).unwrap();
            let line = geometry.fundamental() * points.first.extend(1.0);
            points.second += step * DVec2::new(line.x, line.y).normalize();
            let residual = points.second.extend(1.0).dot(line);
            let other = geometry.fundamental().transpose() * points.second.extend(1.0);
            let in_first = residual / DVec2::new(other.x, other.y).length();
            let expected = f64::sqrt(0.5 * (step * step + in_first * in_first));
            prop_assert!(Tolerance::relative(1e-7).accepts(geometry.distance(&points), expected));
        }

        #[test]
        fn the_distance_is_symmetric_in_the_views(
            a in 0.0..640.0, b in 0.0..480.0, c in 0.0..640.0, d in 0.0..480.0,
        ) {
            let (first, second) = pair();
            let points = PointMatch { first: DVec2::new(a, b), second: DVec2::new(c, d) };
            let swapped = PointMatch { first: points.second, second: points.first };
            let forth = EpipolarGeometry::new(&first, &second).unwrap();
            let back = EpipolarGeometry::new(&second, &first).unwrap();
            prop_assert!(Tolerance::absolute(1e-6).accepts(back.distance(&swapped), forth.distance(&points)));
        }

        #[test]
        fn the_distance_is_invariant_under_similarities_of_the_world(factor in 1e-3..1e3, turn in -3.0..3.0, shift in -50.0..50.0) {
            let (first, second) = pair();
            let motion = WorldFromCamera::new(DMat3::from_rotation_y(turn), DVec3::splat(shift)).unwrap();
            let moved = |view: &View| {
                let pose = view.camera.camera_from_world.inverse().moved_by(&motion).scaled_by(factor).unwrap();
                View { camera: atsplat_camera::Camera { camera_from_world: pose.inverse(), ..view.camera }, ..*view }
            };
            let points = PointMatch { first: DVec2::new(100.0, 200.0), second: DVec2::new(150.0, 230.0) };
            let here = EpipolarGeometry::new(&first, &second).unwrap();
            let there = EpipolarGeometry::new(&moved(&first), &moved(&second)).unwrap();
            prop_assert!(Tolerance::absolute(1e-6).accepts(there.distance(&points), here.distance(&points)));
            prop_assert_eq!(there.in_front(&points), here.in_front(&points));
        }
    }

    #[test]
    fn coinciding_centres_have_no_geometry() {
        let first = view([0.0, 0.0, 0.0], [1.0, 2.0, 3.0]);
        let turned = view([0.3, 0.0, 0.0], [1.0, 2.0, 3.0]);
        assert!(EpipolarGeometry::new(&first, &turned).is_none(), "rotation only");
        assert!(EpipolarGeometry::new(&first, &first).is_none(), "the same view");
        let in_f32 = |angles: [f64; 3], centre: [f64; 3]| {
            let exact = view(angles, centre);
            #[expect(clippy::cast_possible_truncation, reason = "what a chunk stores")]
            let rows = exact.camera.camera_from_world.to_rows().map(|number| f64::from(number as f32));
            let camera_from_world = CameraFromWorld::from_rows(&rows).unwrap();
            View { camera: atsplat_camera::Camera { camera_from_world, ..exact.camera }, ..exact }
        };
        let first = in_f32([0.2, 0.1, 0.0], [1.0, 2.0, 3.0]);
        let geometry = |angles, centre| EpipolarGeometry::new(&first, &in_f32(angles, centre));
        assert!(geometry([-0.3, 0.2, 0.1], [1.0, 2.0, 3.0]).is_none(), "rotation only, in f32");
        assert!(geometry([-0.3, 0.2, 0.1], [1.0, 2.0, 3.001]).is_some(), "a thousandth ahead");
        let far = |z: f64| view([0.2, 0.1, 0.0], [1e6, 2.0, z]);
        assert!(EpipolarGeometry::new(&far(3.0), &far(3.1)).is_some(), "in f64, far from the origin");
        assert!(EpipolarGeometry::new(&far(3.0), &far(3.001)).is_none(), "less than the ninth decimal of a rotation");
    }

    #[test]
    fn a_reversed_translation_puts_points_behind_at_the_same_distance() {
        let first = view([0.0; 3], [0.0; 3]);
        let second = view([0.0; 3], [0.5, 0.1, 0.0]);
        let reversed = view([0.0; 3], [-0.5, -0.1, 0.0]);
        let points = match_of(&first, &second, DVec3::new(0.3, 0.2, 5.0)).unwrap();
        let wrong = EpipolarGeometry::new(&first, &reversed).unwrap();
        assert!(PIXELS.accepts(wrong.distance(&points), 0.0));
        assert!(!wrong.in_front(&points));
    }

    #[test]
    fn a_point_behind_either_camera_is_not_in_front() {
        let here = view([0.0; 3], [0.0; 3]);
        let ahead = view([0.0; 3], [0.5, 0.1, 10.0]);
        // A point between them has the pixels of its reflection in `ahead`, which looks away from it.
        let (point, centre) = (DVec3::new(0.3, 0.2, 5.0), DVec3::new(0.5, 0.1, 10.0));
        let seen = match_of(&here, &here, point).unwrap().first;
        let reflected = match_of(&ahead, &ahead, 2.0 * centre - point).unwrap().first;
        let matched = PointMatch { first: seen, second: reflected };
        let geometry = EpipolarGeometry::new(&here, &ahead).unwrap();
        assert!(PIXELS.accepts(geometry.distance(&matched), 0.0));
        assert!(!geometry.in_front(&matched), "behind the second");
        let matched = PointMatch { first: reflected, second: seen };
        assert!(!EpipolarGeometry::new(&ahead, &here).unwrap().in_front(&matched), "behind the first");
    }

    #[test]
    fn a_point_at_the_centre_of_a_camera_is_not_in_front() {
        let here = view([0.0; 3], [0.0; 3]);
        let ahead = view([0.0; 3], [0.0, 0.0, 1.0]);
        // The ray through the middle of one image passes through the other camera, which sees the point anywhere.
        let (middle, anywhere) = (DVec2::new(320.0, 240.0), DVec2::new(300.0, 250.0));
        let matched = PointMatch { first: middle, second: anywhere };
        assert!(!EpipolarGeometry::new(&here, &ahead).unwrap().in_front(&matched), "of the second");
        let matched = PointMatch { first: anywhere, second: middle };
        assert!(!EpipolarGeometry::new(&ahead, &here).unwrap().in_front(&matched), "of the first");
    }

    #[test]
    fn the_essential_matrix_has_two_equal_singular_values_and_a_zero() {
        let (first, second) = pair();
        let e = EpipolarGeometry::new(&first, &second).unwrap().essential();
        // 2·E·Eᵀ·E − trace(E·Eᵀ)·E = 0 (Hartley and Zisserman §9.6.2, Result 9.17 in polynomial form).
        let eet = e * e.transpose();
        let trace = eet.x_axis.x + eet.y_axis.y + eet.z_axis.z;
        let rest = 2.0 * (eet * e) - trace * e;
        Tolerance::F64.assert(rest.to_cols_array(), [0.0; 9], "constraint");
        Tolerance::F64.assert([e.determinant(), trace], [0.0, 2.0], "rank and length");
    }

    #[test]
    fn the_epipole_lies_on_every_line_and_nan_stays_nan() {
        // For a translation along the optical axis the epipole is the principal point.
        let first = view([0.0; 3], [0.0; 3]);
        let second = view([0.0; 3], [0.0, 0.0, 1.0]);
        let geometry = EpipolarGeometry::new(&first, &second).unwrap();
        let centre = DVec2::new(320.0, 240.0);
        assert!(PIXELS.accepts(geometry.distance(&PointMatch { first: centre, second: centre }), 0.0));
        let nan = PointMatch { first: DVec2::NAN, second: centre };
        assert!(geometry.distance(&nan).is_nan());
    }

    #[test]
    fn overflowing_poses_give_no_nan() {
        let far = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(1e300, 0.0, 0.0)).unwrap();
        let first = view([0.0; 3], [0.0; 3]);
        let second = View { camera: atsplat_camera::Camera { camera_from_world: far, ..first.camera }, ..first };
        // Lengths overflow; the result must not be a NaN that could be taken for a score.
        if let Some(geometry) = EpipolarGeometry::new(&first, &second) {
            assert!(geometry.fundamental().is_finite());
        }
    }
}
