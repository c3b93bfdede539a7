//! Lens models compared with OpenCV (`fixtures/make_fixtures.py lens`).

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]

use atsplat_camera::{CameraError, Distortion, Lens};
use atsplat_numeric::Tolerance;
use glam::DVec2;
use serde::Deserialize;

#[derive(Deserialize)]
struct Fixture {
    opencv: Vec<Perspective>,
    fisheye: Vec<Fisheye>,
}

#[derive(Deserialize)]
struct Perspective {
    k: [f64; 3],
    p: [f64; 2],
    undistorted: Vec<[f64; 2]>,
    distorted: Vec<[f64; 2]>,
    inverse: Vec<[f64; 2]>,
    jacobian_rows: Vec<[f64; 4]>,
    fold_radius: Option<f64>,
}

#[derive(Deserialize)]
struct Fisheye {
    k: [f64; 4],
    undistorted: Vec<[f64; 2]>,
    distorted: Vec<[f64; 2]>,
    inverse: Vec<[f64; 2]>,
    fold_angle: Option<f64>,
}

/// The error of OpenCV's iterations, which stop at 1e-15 squared or after a hundred steps.
const OPENCV_INVERSE: Tolerance = Tolerance::absolute(1e-9);
/// The step of the dense sampling in the script.
const SAMPLING: Tolerance = Tolerance::absolute(3e-5);

fn fixture() -> Fixture {
    serde_json::from_str(include_str!("fixtures/lens.json")).expect("the fixture is JSON of this shape")
}

impl Perspective {
    fn is_radial(&self) -> bool {
        self.p.iter().all(|p| *p == 0.0)
    }

    fn lens(&self) -> Lens {
        let ([k1, k2, k3], [p1, p2]) = (self.k, self.p);
        Distortion::OpenCv { k1, k2, k3, p1, p2 }.lens().unwrap()
    }
}

#[test]
fn perspective_lenses_agree_with_project_points_and_undistort_points() {
    for case in fixture().opencv {
        let lens = case.lens();
        for (index, point) in case.undistorted.iter().enumerate() {
            let point = DVec2::from_array(*point);
            let distorted = lens.distorted_from_undistorted(point).unwrap();
            Tolerance::F64.assert(distorted.to_array(), case.distorted[index], "projectPoints");
            let rows = lens.jacobian(point).unwrap().transpose().to_cols_array();
            Tolerance::F64.assert(rows, case.jacobian_rows[index], "projectPoints' Jacobian");
            let back = lens.undistorted_from_distorted(DVec2::from_array(case.distorted[index])).unwrap();
            Tolerance::F64.assert(back.to_array(), point.to_array(), "the point itself");
            OPENCV_INVERSE.assert(back.to_array(), case.inverse[index], "undistortPoints");
        }
    }
}

#[test]
fn fisheye_lenses_agree_with_opencv() {
    for case in fixture().fisheye {
        let lens = Distortion::Fisheye { k: case.k }.lens().unwrap();
        for (index, point) in case.undistorted.iter().enumerate() {
            let distorted = lens.distorted_from_undistorted(DVec2::from_array(*point)).unwrap();
            Tolerance::F64.assert(distorted.to_array(), case.distorted[index], "fisheye.distortPoints");
            let back = lens.undistorted_from_distorted(DVec2::from_array(case.distorted[index])).unwrap();
            Tolerance::absolute(1e-11).assert(back.to_array(), *point, "the point itself");
            OPENCV_INVERSE.assert(back.to_array(), case.inverse[index], "fisheye.undistortPoints");
        }
    }
}

#[test]
fn folds_match_dense_sampling() {
    for case in fixture().opencv {
        let limit = case.lens().angle_limit();
        match case.fold_radius {
            Some(radius) if case.is_radial() => SAMPLING.assert([limit.tan()], [radius], "fold"),
            // Tangential terms move the fold inwards in proportion to them.
            Some(radius) => assert!(limit.tan() < radius && limit.tan() > 0.85 * radius, "{} {radius}", limit.tan()),
            None => assert!(limit > 1.0, "{limit}"),
        }
    }
    for case in fixture().fisheye {
        let limit = Distortion::Fisheye { k: case.k }.lens().unwrap().angle_limit();
        SAMPLING.assert([limit], [case.fold_angle.unwrap_or(std::f64::consts::PI)], "fold angle");
    }
}

#[test]
fn points_beyond_the_fold_are_errors_unlike_in_opencv() {
    let folding = fixture().opencv.into_iter().find(|case| case.is_radial() && case.fold_radius.is_some()).unwrap();
    let beyond = DVec2::new(1.01 * folding.fold_radius.unwrap(), 0.0);
    assert!(matches!(folding.lens().distorted_from_undistorted(beyond), Err(CameraError::OutsideLens { .. })));
}
