//! Invariants of intrinsics, poses, projections and rays.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::f64::consts::PI;

use atsplat_camera::{
    Camera, CameraFromWorld, CropRect, DirectionScale, Distortion, ImageSize, NormalizedIntrinsics, PixelIntrinsics,
    PrincipalPointRule, WorldFromCamera,
};
use atsplat_numeric::{Extremes, Tolerance};
use glam::{DMat3, DVec2, DVec3, EulerRot};
use proptest::prelude::*;

const RULES: [PrincipalPointRule; 2] = [PrincipalPointRule::Frozen, PrincipalPointRule::Corrected];
const SLACK: Tolerance = Tolerance::absolute(1e-11);
/// For the intrinsics of a crop of one pixel, a thousand times the image's.
const INTRINSICS: Tolerance = Tolerance { absolute: 1e-9, relative: 1e-12 };
const LENGTH: Tolerance = Tolerance { absolute: 1e-11, relative: 1e-11 };

fn any_pose() -> impl Strategy<Value = WorldFromCamera> {
    ((-PI..PI, -1.5..1.5, -PI..PI), prop::array::uniform3(-5.0..5.0)).prop_map(|((y, x, z), centre)| {
        WorldFromCamera::new(DMat3::from_euler(EulerRot::YXZ, y, x, z), DVec3::from_array(centre)).unwrap()
    })
}

fn any_intrinsics() -> impl Strategy<Value = NormalizedIntrinsics> {
    (0.3..2.0, 0.3..2.0, 0.3..0.7, 0.3..0.7)
        .prop_map(|(fx, fy, cx, cy)| NormalizedIntrinsics::new(fx, fy, cx, cy).unwrap())
}

/// Lenses that do not fold inside the image.
fn any_distortion() -> impl Strategy<Value = Distortion> {
    let small = -0.01..0.01;
    prop_oneof![
        Just(Distortion::None),
        (-0.02..0.1, small.clone(), small.clone(), small.clone()).prop_map(|(k1, k2, p1, p2)| Distortion::OpenCv {
            k1,
            k2: k2 * 0.01,
            k3: 0.0,
            p1,
            p2: p2 * 0.1
        }),
        prop::array::uniform4(small).prop_map(|k| Distortion::Fisheye { k }),
    ]
}

fn any_camera() -> impl Strategy<Value = Camera> {
    (any_pose(), any_intrinsics(), any_distortion()).prop_map(|(pose, intrinsics, distortion)| Camera {
        camera_from_world: pose.inverse(),
        intrinsics,
        distortion,
    })
}

fn numbers(k: NormalizedIntrinsics) -> [f64; 4] {
    [k.fx, k.fy, k.cx, k.cy]
}

/// An image and two crops, the second inside the first.
fn nested_crops() -> impl Strategy<Value = (ImageSize, CropRect, CropRect)> {
    let inside = |outer: u32| (1..=outer).prop_flat_map(move |length| (0..=outer - length, Just(length)));
    (8u32..2000, 8u32..2000).prop_flat_map(move |(width, height)| {
        (inside(width), inside(height)).prop_flat_map(move |((column, w), (row, h))| {
            let first = CropRect { column, row, size: ImageSize { width: w, height: h } };
            (inside(w), inside(h)).prop_map(move |((column, w), (row, h))| {
                let second = CropRect { column, row, size: ImageSize { width: w, height: h } };
                (ImageSize { width, height }, first, second)
            })
        })
    })
}

proptest! {
    #[test]
    fn crops_compose((size, first, second) in nested_crops(), k in any_intrinsics()) {
        let both = CropRect { column: first.column + second.column, row: first.row + second.row, size: second.size };
        for rule in RULES {
            let twice = k.cropped(size, first, rule).unwrap().cropped(first.size, second, rule).unwrap();
            let once = k.cropped(size, both, rule).unwrap();
            prop_assert!(INTRINSICS.check(numbers(twice), numbers(once)).is_ok());
        }
    }

    #[test]
    fn crops_in_pixels_and_in_normalised_units_agree((size, crop, _) in nested_crops(), k in any_intrinsics()) {
        let whole = k.pixel_from_normalized(size);
        let of_crop =
            PixelIntrinsics { cx: whole.cx - f64::from(crop.column), cy: whole.cy - f64::from(crop.row), ..whole };
        let by_pixels = of_crop.normalized_from_pixel(crop.size).unwrap();
        let by_shares = k.cropped(size, crop, PrincipalPointRule::Corrected).unwrap();
        prop_assert!(INTRINSICS.check(numbers(by_pixels), numbers(by_shares)).is_ok());
    }

    #[test]
    fn a_crop_has_the_same_rays_at_other_positions((size, crop, _) in nested_crops(), camera in any_camera(), u in 0.0..1.0, v in 0.0..1.0) {
        let intrinsics = camera.intrinsics.cropped(size, crop, PrincipalPointRule::Corrected).unwrap();
        let cropped = Camera { intrinsics, ..camera };
        let of_crop = |share: f64, start: u32, length: u32, whole: u32| {
            (f64::from(start) + share * f64::from(length)) / f64::from(whole)
        };
        let there = DVec2::new(
            of_crop(u, crop.column, crop.size.width, size.width),
            of_crop(v, crop.row, crop.size.height, size.height),
        );
        let ray = |camera: &Camera, at: DVec2| camera.projector().unwrap().ray(at, DirectionScale::UnitLength);
        if let (Ok(small), Ok(whole)) = (ray(&cropped, DVec2::new(u, v)), ray(&camera, there)) {
            prop_assert!(Tolerance::absolute(1e-9).check(small.direction.to_array(), whole.direction.to_array()).is_ok());
        }
    }

    #[test]
    fn points_of_a_ray_project_to_its_pixel(
        camera in any_camera(), u in 0.0..1.0, v in 0.0..1.0, depth in 0.1..100.0f64,
    ) {
        let at = DVec2::new(u, v);
        let projector = camera.projector().unwrap();
        for scale in [DirectionScale::UnitLength, DirectionScale::UnitDepth] {
            let Ok(ray) = projector.ray(at, scale) else { continue };
            let seen = projector.project(ray.at(depth)).unwrap();
            // The ray starts up to 9 units from the origin, with the corresponding rounding errors near the camera.
            prop_assert!(Tolerance::absolute(1e-10).check(seen.position.to_array(), at.to_array()).is_ok(), "{:?}", camera.distortion);
            let measured = match scale { DirectionScale::UnitLength => seen.distance, DirectionScale::UnitDepth => seen.depth };
            prop_assert!(LENGTH.accepts(measured, depth));
        }
    }

    #[test]
    fn projection_is_invariant_to_rigid_motions(camera in any_camera(), motion in any_pose(), point in prop::array::uniform3(-5.0..5.0)) {
        let point = DVec3::from_array(point);
        let moved = Camera { camera_from_world: camera.camera_from_world.inverse().moved_by(&motion).inverse(), ..camera };
        if let (Ok(here), Ok(there)) = (camera.project(point), moved.project(motion.transform_point(point))) {
            // For near points, rounding errors are magnified in the image.
            let closeness = here.depth.abs().minimum_of(1.0).maximum_of(1e-3);
            let slack = Tolerance { absolute: 1e-9 / closeness, relative: 1e-9 / closeness };
            prop_assert!(slack.check(there.position.to_array(), here.position.to_array()).is_ok());
            prop_assert!(SLACK.check([there.distance], [here.distance]).is_ok());
        }
    }

    #[test]
    fn poses_form_a_group(a in any_pose(), b in any_pose(), c in any_pose()) {
        let identity = WorldFromCamera::IDENTITY;
        prop_assert!(SLACK.check(a.moved_by(&identity).to_rows(), a.to_rows()).is_ok());
        prop_assert!(SLACK.check(a.camera_from_other(&a).to_rows(), identity.to_rows()).is_ok());
        let (left, right) = (c.moved_by(&b).moved_by(&a), c.moved_by(&b.moved_by(&a)));
        prop_assert!(Tolerance::absolute(1e-10).check(left.to_rows(), right.to_rows()).is_ok(), "associative");
        let relative = a.camera_from_other(&b);
        prop_assert!(Tolerance::absolute(1e-10).check(relative.moved_by(&a).to_rows(), b.to_rows()).is_ok());
        let kept = a.moved_by(&c).camera_from_other(&b.moved_by(&c));
        prop_assert!(Tolerance::absolute(1e-10).check(kept.to_rows(), relative.to_rows()).is_ok(), "relative poses are invariant");
    }

    #[test]
    fn axis_conversion_is_an_involution_and_keeps_the_centre(pose in any_pose()) {
        let flipped = pose.opengl_from_opencv();
        prop_assert_eq!(flipped.opencv_from_opengl(), pose);
        prop_assert_eq!(flipped.centre(), pose.centre());
        prop_assert_eq!(flipped.forward(), -pose.forward());
        prop_assert!(SLACK.accepts(flipped.determinant(), 1.0));
    }

    #[test]
    fn rows_round_trip_in_both_directions(pose in any_pose()) {
        let again = CameraFromWorld::from_rows(&pose.inverse().to_rows()).unwrap().inverse();
        prop_assert!(SLACK.check(again.to_rows(), pose.to_rows()).is_ok());
    }

    #[test]
    fn the_field_of_view_is_the_angle_between_edge_rays(k in any_intrinsics()) {
        let projector = Camera::pinhole(CameraFromWorld::IDENTITY, k).projector().unwrap();
        let ray = |x, y| projector.ray(DVec2::new(x, y), DirectionScale::UnitLength).unwrap().direction;
        let angle = |a: DVec3, b: DVec3| a.cross(b).length().atan2(a.dot(b));
        let fov = k.field_of_view();
        let edges = [angle(ray(0.0, 0.5), ray(1.0, 0.5)), angle(ray(0.5, 0.0), ray(0.5, 1.0))];
        prop_assert!(SLACK.check([fov.x, fov.y], edges).is_ok());
        let longer = NormalizedIntrinsics::new(2.0 * k.fx, 2.0 * k.fy, k.cx, k.cy).unwrap().field_of_view();
        prop_assert!(longer.x < fov.x && longer.y < fov.y, "longer focal lengths have a smaller field of view");
    }

    #[test]
    fn plucker_moments_are_orthogonal_to_their_rays(camera in any_camera()) {
        let size = ImageSize { width: 3, height: 2 };
        let Ok(rays) = camera.pixel_rays(size, DirectionScale::UnitLength) else { return Ok(()) };
        for ray in rays {
            let [m0, m1, m2, d0, d1, d2] = ray.plucker();
            let (moment, direction) = (DVec3::new(m0, m1, m2), DVec3::new(d0, d1, d2));
            prop_assert!(SLACK.accepts(moment.dot(direction), 0.0));
            prop_assert!(SLACK.accepts(direction.length(), 1.0));
            let foot = direction.cross(moment);
            prop_assert!(SLACK.accepts((foot - ray.origin).cross(direction).length(), 0.0), "d × m is on the ray");
        }
    }
}
