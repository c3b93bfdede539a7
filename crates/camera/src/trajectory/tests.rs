use std::f64::consts::PI;

use atsplat_numeric::{Extremes, Tolerance};
use glam::{DMat3, DQuat, DVec3, EulerRot};
use proptest::prelude::*;

use super::*;

fn pose(turn: DMat3, centre: [f64; 3]) -> WorldFromCamera {
    WorldFromCamera::new(turn, DVec3::from_array(centre)).unwrap()
}

fn any_pose() -> impl Strategy<Value = WorldFromCamera> {
    (prop::array::uniform3(-PI..PI), prop::array::uniform3(-3.0..3.0))
        .prop_map(|([y, x, z], centre)| pose(DMat3::from_euler(EulerRot::YXZ, y, x, z), centre))
}

/// Successive rotations by less than 90°, like those of a real camera.
fn any_trajectory() -> impl Strategy<Value = Trajectory> {
    let step = (0.1..2.0f64, prop::array::uniform3(-0.8..0.8), prop::array::uniform3(-1.0..1.0));
    (any_pose(), prop::collection::vec(step, 1..6)).prop_map(|(start, steps)| {
        let (mut times, mut poses) = (vec![-1.5], vec![start]);
        for (wait, [y, x, z], move_by) in steps {
            let last = poses[poses.len() - 1];
            let turn = last.rotation() * DMat3::from_euler(EulerRot::YXZ, y, x, z);
            times.push(times[times.len() - 1] + wait);
            poses.push(WorldFromCamera::from_parts(turn, last.centre() + DVec3::from_array(move_by)));
        }
        Trajectory::new(times, poses).unwrap()
    })
}

fn assert_close(found: &WorldFromCamera, expected: &WorldFromCamera, slack: f64, what: &str) {
    Tolerance::absolute(slack).assert(found.to_rows(), expected.to_rows(), what);
}

proptest! {
    #[test]
    fn stored_poses_are_reproduced_bit_for_bit_and_continuous(trajectory in any_trajectory()) {
        for (time, stored) in trajectory.times().iter().zip(trajectory.poses()) {
            prop_assert_eq!(&trajectory.at(*time).unwrap(), stored);
            for adjacent in [time - 1e-9, time + 1e-9] {
                if let Ok(near) = trajectory.at(adjacent) {
                    assert_close(&near, stored, 1e-6, "continuous");
                }
            }
        }
    }

    #[test]
    fn interpolated_rotations_are_orthonormal(trajectory in any_trajectory(), share in 0.0..1.0f64) {
        let (start, end) = (trajectory.times()[0], trajectory.times()[trajectory.times().len() - 1]);
        let between = trajectory.at(start + share * (end - start)).unwrap();
        prop_assert!(between.orthonormality_residual() < 1e-14);
        Tolerance::ORTHONORMAL.assert([between.determinant()], [1.0], "no reflection");
    }

    #[test]
    fn interpolation_is_equivariant_to_rigid_motions(trajectory in any_trajectory(), motion in any_pose(), share in 0.0..1.0f64) {
        let moved_poses = trajectory.poses().iter().map(|pose| pose.moved_by(&motion)).collect();
        let moved = Trajectory::new(trajectory.times().to_vec(), moved_poses).unwrap();
        let (start, end) = (trajectory.times()[0], trajectory.times()[trajectory.times().len() - 1]);
        let time = start + share * (end - start);
        let expected = trajectory.at(time).unwrap().moved_by(&motion);
        assert_close(&moved.at(time).unwrap(), &expected, 1e-11, "equivariant");
    }

    #[test]
    fn interpolation_is_symmetric_in_time(trajectory in any_trajectory(), share in 0.0..1.0f64) {
        let times = trajectory.times().iter().rev().map(|time| -time).collect();
        let poses = trajectory.poses().iter().rev().copied().collect();
        let reversed = Trajectory::new(times, poses).unwrap();
        let (start, end) = (trajectory.times()[0], trajectory.times()[trajectory.times().len() - 1]);
        let time = start + share * (end - start);
        let (there, back) = (trajectory.at(time), reversed.at(-time));
        assert_close(&there.unwrap(), &back.unwrap(), 1e-10, "reversed");
    }

    #[test]
    fn splines_have_continuous_velocity_and_spin(trajectory in any_trajectory()) {
        let step = 1e-6;
        for time in trajectory.times().iter().skip(1).rev().skip(1) {
            let at = |offset: f64| trajectory.at(time + offset).unwrap();
            let (before, here, after) = (at(-step), at(0.0), at(step));
            let slope = |a: &WorldFromCamera, b: &WorldFromCamera| {
                let difference = |(from, to): (f64, f64)| (to - from) / step;
                a.to_rows().into_iter().zip(b.to_rows()).map(difference).collect::<Vec<_>>()
            };
            // At most the acceleration over one step; a kink would be of order one.
            let slack = Tolerance::absolute(1e-2);
            prop_assert!(slack.check(slope(&before, &here), slope(&here, &after)).is_ok(), "kink at {time}");
        }
    }
}

proptest! {
    // Each case measures the path by thousands of chords.
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn samples_are_evenly_spaced_along_the_path(trajectory in any_trajectory(), count in 2usize..9) {
        let samples = trajectory.resampled(count, Spacing::ArcLength).unwrap();
        prop_assert_eq!(samples.times().len(), count);
        prop_assert_eq!(&samples.poses()[0], &trajectory.poses()[0]);
        prop_assert_eq!(&samples.poses()[count - 1], &trajectory.poses()[trajectory.poses().len() - 1]);
        let even = trajectory.arc_length() / (count - 1) as f64;
        for pair in samples.times().windows(2) {
            let (length, longest_chord) = chord_length(&trajectory, pair[0], pair[1]);
            // At a point where the path reverses, the error is at most one chord.
            let slack = Tolerance { absolute: 2.0 * longest_chord, relative: 1e-4 };
            prop_assert!(slack.accepts(length, even), "{length} {even}");
        }
    }
}

/// Length of the path by many short chords, and the longest of them.
fn chord_length(trajectory: &Trajectory, start: f64, end: f64) -> (f64, f64) {
    let steps = 2000;
    let centre = |step: u32| {
        let time = start + (end - start) * f64::from(step) / f64::from(steps);
        trajectory.at(if step == steps { end } else { time }).unwrap().centre()
    };
    let chords = (0..steps).map(|step| centre(step).distance(centre(step + 1)));
    chords.fold((0.0, 0.0f64), |(sum, longest), chord| (sum + chord, longest.maximum_of(chord)))
}

#[test]
fn two_poses_are_interpolated_at_constant_rate() {
    let poses = vec![pose(DMat3::IDENTITY, [0.0; 3]), pose(DMat3::from_rotation_y(1.2), [2.0, 0.0, 4.0])];
    let trajectory = Trajectory::evenly_timed(poses).unwrap();
    let quarter = trajectory.at(0.25).unwrap();
    assert_close(&quarter, &pose(DMat3::from_rotation_y(0.3), [0.5, 0.0, 1.0]), 1e-12, "a quarter of the way");
}

#[test]
fn constant_motion_is_reproduced_at_uneven_times() {
    let at = |t: f64| pose(DMat3::from_rotation_x(0.4 * t), [t, -2.0 * t, 0.5]);
    let times = vec![0.0, 0.1, 1.0, 1.5, 4.0];
    let trajectory = Trajectory::new(times.clone(), times.into_iter().map(at).collect()).unwrap();
    for t in [0.05, 0.7, 1.2, 3.9] {
        assert_close(&trajectory.at(t).unwrap(), &at(t), 1e-12, "constant motion");
    }
}

#[test]
fn parabolas_are_reproduced_between_inner_poses() {
    let at = |t: f64| DVec3::new(t, t * t, -0.5 * t * t + t);
    let times = vec![0.0, 0.5, 2.0, 3.0];
    let poses = times.iter().map(|t| pose(DMat3::IDENTITY, at(*t).to_array())).collect();
    let trajectory = Trajectory::new(times, poses).unwrap();
    let found = trajectory.at(1.3).unwrap().centre();
    Tolerance::F64.assert(found.to_array(), at(1.3).to_array(), "Bessel tangents are exact for parabolas");
}

#[test]
fn antipodal_quaternions_are_one_rotation() {
    // A rotation by 350° equals one by −10°; the midpoint of the shorter way is −5°.
    let q = DQuat::from_rotation_z(350f64.to_radians());
    for sign in [q, -q] {
        let poses = vec![pose(DMat3::IDENTITY, [0.0; 3]), pose(DMat3::from_quat(sign), [0.0; 3])];
        let middle = Trajectory::evenly_timed(poses).unwrap().at(0.5).unwrap();
        assert_close(&middle, &pose(DMat3::from_rotation_z((-5f64).to_radians()), [0.0; 3]), 1e-12, "shorter way");
    }
}

#[test]
fn rotations_by_180_degrees_do_not_depend_on_rounding() {
    for noise in [-1e-15, 0.0, 1e-15] {
        let poses = vec![pose(DMat3::IDENTITY, [0.0; 3]), pose(DMat3::from_rotation_y(PI + noise), [1.0, 0.0, 0.0])];
        let trajectory = Trajectory::evenly_timed(poses).unwrap();
        let middle = trajectory.at(0.5).unwrap();
        assert_close(&middle, &pose(DMat3::from_rotation_y(PI / 2.0), [0.5, 0.0, 0.0]), 1e-12, "quarter turn");
    }
}

#[test]
fn equal_poses_give_a_constant_trajectory() {
    let still = pose(DMat3::from_euler(EulerRot::YXZ, 0.3, -0.4, 2.0), [1.0, 2.0, 3.0]);
    let trajectory = Trajectory::evenly_timed(vec![still; 4]).unwrap();
    Tolerance::EXACT.assert([trajectory.arc_length()], [0.0], "length");
    let samples = trajectory.resampled(7, Spacing::ArcLength).unwrap();
    Tolerance::F64.assert(samples.times().iter().copied(), (0..7).map(|i| f64::from(i) * 0.5), "even in time");
    for sample in samples.poses() {
        assert_close(sample, &still, 1e-14, "still");
    }
}

#[test]
fn samples_in_time_do_not_depend_on_the_speed() {
    let at = |x: f64| pose(DMat3::IDENTITY, [x, 0.0, 0.0]);
    let trajectory = Trajectory::new(vec![-1.5, 0.5, 4.5], vec![at(0.0), at(10.0), at(11.0)]).unwrap();
    let samples = trajectory.resampled(4, Spacing::Time).unwrap();
    Tolerance::F64.assert(samples.times().iter().copied(), [-1.5, 0.5, 2.5, 4.5], "even in time");
    Tolerance::F64.assert(samples.poses().iter().map(|pose| pose.centre().x), [0.0, 10.0, 10.75, 11.0], "positions");
}

#[test]
fn a_spline_does_not_move_during_a_pause() {
    let at = |x: f64| pose(DMat3::from_rotation_y(x), [x, 0.0, 0.0]);
    let trajectory = Trajectory::evenly_timed(vec![at(0.0), at(1.0), at(1.0), at(2.0)]).unwrap();
    for time in [1.2, 1.5, 1.9] {
        assert_close(&trajectory.at(time).unwrap(), &at(1.0), 1e-14, "pause");
    }
}

#[test]
fn a_pause_gets_no_samples_along_the_path() {
    let at = |x: f64| pose(DMat3::IDENTITY, [x, 0.0, 0.0]);
    let trajectory = Trajectory::evenly_timed(vec![at(0.0), at(1.0), at(1.0), at(1.0), at(2.0)]).unwrap();
    let samples = trajectory.resampled(5, Spacing::ArcLength).unwrap();
    let x = samples.poses().iter().map(|pose| pose.centre().x);
    Tolerance::F64.assert(x, [0.0, 0.5, 1.0, 1.5, 2.0], "evenly along the line");
}

/// 0.3 + (0.9 − 0.3) is after 0.9, and 0.2 + (0.9 − 0.2) before it.
#[test]
fn the_last_sample_along_the_path_is_the_last_pose() {
    let at = |x: f64| pose(DMat3::from_rotation_y(x), [x, 0.0, 0.0]);
    for start in [0.3, 0.2] {
        let trajectory = Trajectory::new(vec![start, 0.9], vec![at(1.0), at(2.0)]).unwrap();
        let samples = trajectory.resampled(3, Spacing::ArcLength).unwrap();
        Tolerance::EXACT.assert([samples.times()[0], samples.times()[2]], [start, 0.9], "first and last time");
        assert_eq!((samples.poses()[0], samples.poses()[2]), (at(1.0), at(2.0)), "from {start}");
    }
}

#[test]
fn the_length_of_a_circle_is_its_circumference() {
    let count = 65;
    let poses = (0..count).map(|i| {
        let angle = f64::from(i) * 2.0 * PI / f64::from(count - 1);
        pose(DMat3::from_rotation_y(angle), [angle.sin(), 0.0, angle.cos()])
    });
    let length = Trajectory::evenly_timed(poses.collect()).unwrap().arc_length();
    Tolerance::relative(1e-4).assert([length], [2.0 * PI], "circumference");
}

/// Squares of such distances overflow. Halving every segment to the end would take hours.
#[test]
fn a_path_without_a_finite_length_has_no_samples_along_it() {
    let at = |x: f64| pose(DMat3::IDENTITY, [x, 0.0, 0.0]);
    let far = vec![at(-1e160), at(1e160), at(0.0), at(1e160), at(2.0)];
    let unknown = vec![at(0.0), crate::CameraFromWorld::UNKNOWN.inverse(), at(1.0), at(2.0)];
    for (poses, length) in [(far, f64::INFINITY), (unknown, f64::NAN)] {
        let trajectory = Trajectory::evenly_timed(poses).unwrap();
        let found = trajectory.arc_length();
        assert_eq!((found.is_nan(), found > 0.0), (length.is_nan(), length > 0.0), "{found}");
        let error = trajectory.resampled(5, Spacing::ArcLength).unwrap_err();
        assert!(matches!(error, CameraError::NonFinite { field: "length of the path", .. }), "{error}");
    }
}

#[test]
fn times_and_counts_are_checked() {
    let still = WorldFromCamera::IDENTITY;
    assert!(matches!(Trajectory::new(vec![], vec![]), Err(CameraError::TooFewPoses { .. })));
    assert!(matches!(Trajectory::new(vec![0.0], vec![still; 2]), Err(CameraError::TimesMismatch { .. })));
    for second in [0.0, -1.0, 1e-320] {
        let error = Trajectory::new(vec![0.0, second], vec![still; 2]).unwrap_err();
        assert!(matches!(error, CameraError::TimesNotIncreasing { index: 1, .. }), "{second}: {error}");
    }
    for infinite in [vec![f64::NAN], vec![-1e308, 1.7e308], vec![-1e308, 0.0, 1e308]] {
        let error = Trajectory::new(infinite.clone(), vec![still; infinite.len()]).unwrap_err();
        assert!(matches!(error, CameraError::NonFinite { .. }), "{infinite:?}: {error}");
    }
    let trajectory = Trajectory::new(vec![-0.0, 1.0], vec![still; 2]).unwrap();
    for outside in [-1e-9, 1.000_001, f64::NAN, -f64::NAN, f64::INFINITY] {
        assert!(matches!(trajectory.at(outside), Err(CameraError::OutsideTrajectory { .. })));
    }
    for zero in [0.0, -0.0] {
        assert_eq!(trajectory.at(zero).unwrap(), still);
    }
    assert!(trajectory.resampled(0, Spacing::Time).is_err());
    let single = Trajectory::evenly_timed(vec![still]).unwrap();
    assert!(single.resampled(2, Spacing::Time).is_err());
    assert_eq!(single.resampled(1, Spacing::ArcLength).unwrap().poses(), [still]);
}
