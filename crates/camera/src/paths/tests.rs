use std::f64::consts::PI;

use atsplat_numeric::Tolerance;
use glam::{DMat3, DVec3, EulerRot};
use proptest::prelude::*;

use super::*;

const SLACK: Tolerance = Tolerance::absolute(1e-11);

fn all_paths() -> [CameraPath; 7] {
    [
        CameraPath::Interpolation,
        CameraPath::InterpolationWithWobble { radius: 0.5 },
        CameraPath::Wobble { radius: 0.25 },
        CameraPath::Spiral { radii: [0.25, 0.25, 0.1], focus: 2.0 },
        CameraPath::Orbit { focus: 2.0, degrees: 360.0 },
        CameraPath::Dolly { distance: 1.0 },
        CameraPath::ThroughViews,
    ]
}

fn any_pose() -> impl Strategy<Value = WorldFromCamera> {
    (prop::array::uniform3(-1.0..1.0), prop::array::uniform3(-3.0..3.0)).prop_map(|([y, x, z], centre)| {
        WorldFromCamera::new(DMat3::from_euler(EulerRot::YXZ, y, x, z), DVec3::from_array(centre)).unwrap()
    })
}

proptest! {
    #[test]
    fn paths_move_with_the_world(a in any_pose(), b in any_pose(), motion in any_pose()) {
        // Optical axes that are nearly parallel have no stable pivot.
        prop_assume!(a.forward().cross(b.forward()).length() > 0.1 && a.centre().distance(b.centre()) > 0.1);
        for path in all_paths() {
            let here = path.poses(&[a, b], 7).unwrap();
            let there = path.poses(&[a.moved_by(&motion), b.moved_by(&motion)], 7).unwrap();
            for (here, there) in here.iter().zip(&there) {
                let slack = Tolerance::absolute(1e-9);
                prop_assert!(slack.check(there.to_rows(), here.moved_by(&motion).to_rows()).is_ok(), "{path:?}");
            }
        }
    }

    #[test]
    fn paths_grow_with_the_world(a in any_pose(), b in any_pose(), scale in 0.2..5.0f64) {
        prop_assume!(a.forward().cross(b.forward()).length() > 0.1 && a.centre().distance(b.centre()) > 0.1);
        for path in all_paths() {
            let here = path.poses(&[a, b], 7).unwrap();
            let there = path.poses(&[a.scaled_by(scale), b.scaled_by(scale)], 7).unwrap();
            for (here, there) in here.iter().zip(&there) {
                let slack = Tolerance::absolute(1e-9);
                prop_assert!(slack.check(there.to_rows(), here.scaled_by(scale).to_rows()).is_ok(), "{path:?}");
            }
        }
    }

    #[test]
    fn paths_have_the_requested_number_of_rigid_poses(a in any_pose(), b in any_pose(), frames in 1usize..20) {
        for path in all_paths() {
            let poses = path.poses(&[a, b], frames).unwrap();
            prop_assert_eq!(poses.len(), frames);
            for pose in poses {
                prop_assert!(pose.orthonormality_residual() < 1e-13, "{:?}: {pose:?}", path);
                prop_assert!(pose.determinant() > 0.0);
            }
        }
    }

    #[test]
    fn pivot_interpolation_reaches_both_views(a in any_pose(), b in any_pose()) {
        let ends = pivot_interpolation(&a, &b, &[0.0, 1.0]);
        let slack = Tolerance::absolute(1e-9 * (1.0 + a.centre().distance(ends[0].centre())));
        prop_assert!(slack.check(ends[0].to_rows(), a.to_rows()).is_ok());
        prop_assert!(slack.check(ends[1].to_rows(), b.to_rows()).is_ok(), "{:?} {b:?}", ends[1]);
    }
}

#[test]
fn two_views_of_one_point_rotate_about_it() {
    let on_circle = |angle: f64| {
        let turn = DMat3::from_rotation_y(angle);
        WorldFromCamera::new(turn, turn * DVec3::new(0.0, 0.0, -3.0)).unwrap()
    };
    let times = [0.0, 0.25, 0.5, 1.0];
    for (pose, t) in pivot_interpolation(&on_circle(-0.4), &on_circle(0.6), &times).iter().zip(times) {
        SLACK.assert(pose.to_rows(), on_circle(-0.4 + t).to_rows(), "on the circle");
    }
}

#[test]
fn parallel_and_opposite_views_are_interpolated() {
    let a = WorldFromCamera::IDENTITY;
    for turn in [DMat3::IDENTITY, DMat3::from_rotation_z(1.0), DMat3::from_rotation_y(PI), DMat3::from_rotation_x(5e-3)]
    {
        let b = WorldFromCamera::new(turn, DVec3::new(1.0, 0.5, -2.0)).unwrap();
        let path = pivot_interpolation(&a, &b, &[0.0, 0.5, 1.0]);
        SLACK.assert(path[0].to_rows(), a.to_rows(), "start");
        SLACK.assert(path[2].to_rows(), b.to_rows(), "end");
        assert!(path[1].centre().is_finite());
    }
}

#[test]
fn orbits_and_spirals_look_at_their_focus() {
    let view = WorldFromCamera::new(DMat3::from_rotation_x(0.4), DVec3::new(1.0, 2.0, 3.0)).unwrap();
    let focus = view.transform_point(DVec3::new(0.0, 0.0, 2.0));
    let spiral = CameraPath::Spiral { radii: [0.25, 0.1, 0.1], focus: 2.0 };
    let orbit = CameraPath::Orbit { focus: 2.0, degrees: 90.0 };
    for pose in spiral.poses(&[view], 9).unwrap().iter().chain(&orbit.poses(&[view], 9).unwrap()) {
        let sight = (focus - pose.centre()).normalize();
        SLACK.assert(pose.forward().to_array(), sight.to_array(), "looks at the focus");
    }
    let quarter = orbit.poses(&[view], 2).unwrap();
    SLACK.assert([quarter[1].centre().distance(focus)], [2.0], "constant distance");
    SLACK.assert([quarter[1].forward().dot(view.forward())], [0.0], "a right angle");
    let left = view.inverse().transform_point(quarter[1].centre());
    assert!(left.x < 0.0, "moves to its left: {left}");
}

#[test]
fn wobbles_grow_and_dollies_are_straight() {
    let at = |x: f64| WorldFromCamera::new(DMat3::IDENTITY, DVec3::new(x, 0.0, 0.0)).unwrap();
    let wobble = CameraPath::Wobble { radius: 0.25 }.poses(&[at(0.0), at(2.0)], 5).unwrap();
    let expected = [[0.0, 0.0], [0.125, 0.0], [0.0, 0.25], [-0.375, 0.0], [0.0, -0.5]];
    for (pose, [x, y]) in wobble.iter().zip(expected) {
        SLACK.assert(pose.centre().to_array(), [x, y, 0.0], "growing circle of a quarter baseline");
    }
    let dolly = CameraPath::Dolly { distance: -1.5 }.poses(&[at(0.0)], 2).unwrap();
    SLACK.assert(dolly[1].centre().to_array(), [0.0, 0.0, -1.5], "scene units for a single view");
}

/// From two baselines before the first view to two beyond the second, five times around it: up, right, down, left.
#[test]
fn an_exaggerated_interpolation_goes_beyond_both_views() {
    let at = |x: f64| WorldFromCamera::new(DMat3::IDENTITY, DVec3::new(x, 0.0, 0.0)).unwrap();
    let path = CameraPath::InterpolationWithWobble { radius: 0.5 }.poses(&[at(0.0), at(2.0)], 21).unwrap();
    for (number, pose) in path.iter().enumerate() {
        let [x, y] = [[0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]][number % 4];
        let along = -4.0 + 0.5 * number as f64;
        SLACK.assert(pose.centre().to_array(), [along + x, y, 0.0], &format!("pose {number}"));
    }
}

#[test]
fn a_loop_does_not_repeat_its_ends() {
    let pose = |x: f64| WorldFromCamera::new(DMat3::IDENTITY, DVec3::new(x, 0.0, 0.0)).unwrap();
    let x = |poses: &[WorldFromCamera]| poses.iter().map(|pose| pose.centre().x).collect::<Vec<_>>();
    let three = [pose(0.0), pose(1.0), pose(2.0)];
    Tolerance::EXACT.assert(x(&there_and_back(&three)), [0.0, 1.0, 2.0, 1.0], "loop");
    assert!(there_and_back(&[]).is_empty());
    assert_eq!(there_and_back(&three[..1]), three[..1]);
    assert_eq!(there_and_back(&three[..2]), three[..2]);
}

#[test]
fn easing_starts_and_ends_at_rest() {
    Tolerance::F64.assert([0.0, 0.5, 1.0].map(eased), [0.0, 0.5, 1.0], "ends and middle");
    assert!(eased(0.01) < 0.001);
}

#[test]
fn parameters_are_checked() {
    let view = [WorldFromCamera::IDENTITY];
    assert!(CameraPath::Interpolation.poses(&view, 3).is_err(), "needs two views");
    assert!(CameraPath::ThroughViews.poses(&view, 3).is_err(), "needs two views");
    assert!(CameraPath::Wobble { radius: f64::NAN }.poses(&view, 3).is_err());
    assert!(CameraPath::Orbit { focus: 0.0, degrees: 90.0 }.poses(&view, 3).is_err());
    assert!(CameraPath::Dolly { distance: 1.0 }.poses(&[], 3).is_err());
    assert!(CameraPath::Dolly { distance: 1.0 }.poses(&view, 0).is_err());
}

#[test]
fn names_are_kebab_case_with_defaults() {
    let parse = |text: &str| serde_json::from_str::<CameraPath>(text);
    assert_eq!(parse(r#"{"path": "wobble"}"#).unwrap(), CameraPath::Wobble { radius: 0.25 });
    let orbit = CameraPath::Orbit { focus: 2.0, degrees: 360.0 };
    assert_eq!(parse(r#"{"path": "orbit"}"#).unwrap(), orbit, "a full circle");
    assert_eq!(parse(r#"{"path": "through-views"}"#).unwrap(), CameraPath::ThroughViews);
    assert!(parse(r#"{"path": "wobble", "raduis": 1}"#).is_err(), "a misspelt parameter is an error");
}
