use super::*;
use crate::{Distortion, WorldFromCamera};
use atsplat_numeric::Tolerance;
use glam::{DMat3, DVec3};

fn keys() -> Vec<Camera> {
    let key = |(turn, x, y, z, fx): (f64, f64, f64, f64, f64)| {
        let pose = WorldFromCamera::new(DMat3::from_rotation_y(turn), DVec3::new(x, y, z)).unwrap();
        Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(fx, 1.7 * fx, 0.5, 0.4 + 0.1 * fx).unwrap())
    };
    [(0.0, 0.0, 0.0, 0.0, 0.5), (0.4, 1.0, 0.2, 0.1, 0.6), (0.5, 1.2, 0.1, 0.9, 1.9), (1.2, 0.1, 0.0, 1.4, 0.7)]
        .map(key)
        .to_vec()
}

#[test]
fn keys_are_reproduced_bit_for_bit() {
    let (open, closed) = (CameraSpline::open(keys()).unwrap(), CameraSpline::closed(keys()).unwrap());
    for (time, key) in keys().into_iter().enumerate() {
        assert_eq!(open.at(time as f64).unwrap(), key);
        assert_eq!(closed.at(time as f64).unwrap(), key);
    }
    assert_eq!(closed.at(4.0).unwrap(), keys()[0], "around");
    assert!(open.at(3.001).is_err() && open.at(-0.001).is_err() && closed.at(4.001).is_err());
    let samples = open.resampled(9, Spacing::ArcLength).unwrap();
    assert_eq!((samples[0], samples[8]), (keys()[0], keys()[3]));
}

/// Pose and intrinsics at a time.
fn state(spline: &CameraSpline, time: f64) -> Vec<f64> {
    let camera = spline.at(time).unwrap();
    let mut state = camera.camera_from_world.inverse().to_rows().to_vec();
    state.extend(numbers(&camera.intrinsics));
    state
}

/// Compares the derivatives from the left and from the right of each key, including the seam of a closed spline.
#[test]
fn velocity_is_continuous_at_the_keys() {
    const STEP: f64 = 1e-6;
    let (open, closed) = (CameraSpline::open(keys()).unwrap(), CameraSpline::closed(keys()).unwrap());
    let slope = |spline: &CameraSpline, from: f64, to: f64| -> Vec<f64> {
        state(spline, to).into_iter().zip(state(spline, from)).map(|(to, from)| (to - from) / STEP).collect()
    };
    let slack = Tolerance::absolute(5e-5);
    for (spline, before, after) in
        [(&open, 1.0, 1.0), (&open, 2.0, 2.0), (&closed, 3.0, 3.0), (&closed, 1.0, 1.0), (&closed, 4.0, 0.0)]
    {
        let (left, right) = (slope(spline, before - STEP, before), slope(spline, after, after + STEP));
        slack.assert(left, right, "equal on both sides");
    }
    let moving = slope(&closed, 4.0 - STEP, 4.0).iter().fold(0.0f64, |most, value| most.maximum_of(value.abs()));
    assert!(moving > 0.1, "the camera does not stop at the seam: {moving}");
}

#[test]
fn steps_along_the_path_are_even() {
    let closed = CameraSpline::closed(keys()).unwrap();
    let samples = closed.resampled(400, Spacing::ArcLength).unwrap();
    let centres: Vec<DVec3> = samples.iter().map(|camera| camera.camera_from_world.inverse().centre()).collect();
    let around = centres.iter().zip(centres.iter().cycle().skip(1));
    let steps: Vec<f64> = around.map(|(a, b)| a.distance(*b)).collect();
    let mean = steps.iter().sum::<f64>() / steps.len() as f64;
    Tolerance::relative(2e-3).assert(steps, std::iter::repeat_n(mean, 400), "constant speed, also across the seam");
    let timed = closed.resampled(8, Spacing::Time).unwrap();
    assert_eq!([timed[0], timed[2], timed[4], timed[6]].to_vec(), keys());
}

/// The keys are 2, 100 and 410 units of time apart.
#[test]
fn given_times_decide_where_the_camera_is() {
    const STEP: f64 = 1e-6;
    let times = [3.0, 5.0, 105.0, 515.0];
    let spline = CameraSpline::timed(times.to_vec(), keys()).unwrap();
    for (time, key) in times.into_iter().zip(keys()) {
        assert_eq!(spline.at(time).unwrap(), key);
    }
    assert!(spline.at(2.9).is_err() && spline.at(515.1).is_err() && spline.at(f64::NAN).is_err());
    let samples = spline.resampled(513, Spacing::Time).unwrap();
    assert_eq!([samples[0], samples[2], samples[102], samples[512]].to_vec(), keys());
    let focal = |time: f64| spline.at(time).unwrap().intrinsics.fx;
    for at in 1..600 {
        let time = 5.0 + f64::from(at) / 6.0;
        assert!((0.6..=1.9).contains(&focal(time)), "{time}: {}", focal(time));
    }
    let slope = |from: f64, to: f64| -> Vec<f64> {
        state(&spline, to).into_iter().zip(state(&spline, from)).map(|(to, from)| (to - from) / STEP).collect()
    };
    for time in [5.0, 105.0] {
        let (left, right) = (slope(time - STEP, time), slope(time, time + STEP));
        Tolerance::absolute(5e-5).assert(left, right, "equal on both sides");
    }
    // By hand, at the second key: rates 0.05 and 0.013, weights 100 and 2 of 102, at most three times the smaller.
    let rate = (focal(5.0 + STEP) - focal(5.0)) / STEP;
    Tolerance::absolute(1e-6).assert([rate], [0.039], "the slope at a key");
    let even = CameraSpline::timed(vec![0.0, 1.0, 2.0, 3.0], keys()).unwrap();
    assert_eq!(even, CameraSpline::open(keys()).unwrap());
    let back = CameraSpline::timed(vec![0.0, 2.0, 1.0, 3.0], keys());
    assert!(matches!(back, Err(CameraError::TimesNotIncreasing { index: 2, .. })), "{back:?}");
}

#[test]
fn intrinsics_stay_between_adjacent_keys() {
    let spline = CameraSpline::closed(keys()).unwrap();
    let focal = |camera: &Camera| camera.intrinsics.fx;
    for step in 0..400 {
        let time = step as f64 / 100.0;
        let (from, to) = (focal(&keys()[step / 100]), focal(&keys()[(step / 100 + 1) % 4]));
        let found = focal(&spline.at(time).unwrap());
        let (low, high) = (from.minimum_of(to), from.maximum_of(to));
        assert!((low - 1e-12..=high + 1e-12).contains(&found), "{time}: {found} outside {low}..{high}");
    }
}

#[test]
fn too_few_keys_and_different_lenses_are_errors() {
    assert!(CameraSpline::open(vec![]).is_err() && CameraSpline::closed(keys()[..1].to_vec()).is_err());
    let one = CameraSpline::open(keys()[..1].to_vec()).unwrap();
    assert_eq!(one.resampled(1, Spacing::Time).unwrap(), keys()[..1]);
    assert!(one.resampled(2, Spacing::Time).is_err() && one.resampled(0, Spacing::Time).is_err());
    let mut mixed = keys();
    mixed[2].distortion = FISHEYE;
    assert_eq!(CameraSpline::open(mixed.clone()), Err(CameraError::DifferentLens { position: 2 }));
    for key in &mut mixed {
        key.distortion = FISHEYE;
    }
    assert_eq!(CameraSpline::open(mixed).unwrap().at(0.5).unwrap().distortion, FISHEYE);
}

const FISHEYE: Distortion = Distortion::Fisheye { k: [0.1, 0.0, 0.0, 0.0] };
