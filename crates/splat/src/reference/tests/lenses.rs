//! Covariances through lenses, against points of the Gaussians projected individually.

use super::*;
use glam::{DMat2, DVec2};

/// Step of the central differences, in scene units.
const STEP: f64 = 1e-5;

/// Projects a point with the lens's own formula.
fn projected(view: &View, point: DVec3) -> DVec2 {
    let k = view.camera.intrinsics.pixel_from_normalized(view.size);
    let distorted = view.camera.distortion.lens().unwrap().distorted_from_direction(point).unwrap();
    distorted * DVec2::new(k.fx, k.fy) + DVec2::new(k.cx, k.cy)
}

/// Checks the covariances of small Gaussians from the image centre to its border.
fn check_up_to_the_border(distortion: Distortion, focal: f64, expected_drawn: usize) {
    let size = ImageSize { width: 200, height: 150 };
    let intrinsics = NormalizedIntrinsics::new(focal, focal * 200.0 / 150.0, 0.5, 0.5).unwrap();
    let view = View { camera: Camera { camera_from_world: CameraFromWorld::IDENTITY, intrinsics, distortion }, size };
    let lens = distortion.lens().unwrap();
    let k = intrinsics.pixel_from_normalized(size);
    let mut drawn = 0;
    for (column, row) in
        [(100.0, 75.0), (150.0, 75.0), (198.0, 75.0), (100.0, 2.0), (2.0, 75.0), (20.0, 15.0), (180.0, 135.0)]
    {
        let pixel = (DVec2::new(column, row) - DVec2::new(k.cx, k.cy)) / DVec2::new(k.fx, k.fy);
        let Ok(direction) = lens.direction_from_distorted(pixel) else { continue };
        let mean = (direction * 3.0).to_array().map(crate::renderer::saturated);
        let scales = [-6.0f32, -5.5, -5.0];
        let gaussians = Gaussians::new(GaussianParts {
            means: vec![mean],
            quaternions: vec![[0.9, 0.3, -0.2, 0.4]],
            log_scales: vec![scales],
            opacity_logits: vec![3.0],
            sh: vec![[0.5; 3]],
            ..GaussianParts::default()
        })
        .unwrap();
        let projection = project(&gaussians, &view, &RenderOptions::default()).unwrap()[0].expect("it is in the image");
        let rotation = DMat3::from_quat(DQuat::from_xyzw(0.3, -0.2, 0.4, 0.9).normalize());
        let middle = DVec3::from_array(mean.map(f64::from));
        let mut covariance = DMat2::ZERO;
        for (axis, scale) in [rotation.x_axis, rotation.y_axis, rotation.z_axis].into_iter().zip(scales) {
            let slope =
                (projected(&view, middle + axis * STEP) - projected(&view, middle - axis * STEP)) / (2.0 * STEP);
            let along = slope * f64::from(scale).exp();
            covariance += DMat2::from_cols(along * along.x, along * along.y);
        }
        let [a, b, c] = projection.conic;
        let found = DMat2::from_cols(DVec2::new(a, b), DVec2::new(b, c)).inverse();
        let blur = DMat2::from_diagonal(DVec2::splat(RenderOptions::default().constants.blur));
        let what = format!("{distortion:?} at {column}, {row}");
        Tolerance::absolute(1e-6).assert((found - blur).to_cols_array(), covariance.to_cols_array(), &what);
        drawn += 1;
    }
    assert_eq!(drawn, expected_drawn);
}

#[test]
fn covariances_match_with_a_wide_fisheye() {
    // Half the image width is 1.05 and 1.4 radians.
    for focal in [0.48, 0.357] {
        check_up_to_the_border(Distortion::Fisheye { k: [0.0; 4] }, focal, 7);
        check_up_to_the_border(Distortion::Fisheye { k: [0.01, -0.004, 0.0, 0.0] }, focal, 7);
    }
}

#[test]
fn covariances_match_with_a_strong_barrel_lens() {
    check_up_to_the_border(Distortion::OpenCv { k1: -0.3, k2: 0.05, k3: 0.0, p1: 0.002, p2: -0.003 }, 0.75, 7);
}

#[test]
fn covariances_match_with_a_pincushion_lens_and_without() {
    check_up_to_the_border(Distortion::OpenCv { k1: 0.2, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 }, 0.7, 7);
    check_up_to_the_border(Distortion::None, 0.5, 7);
}

/// Within a step of the fold, where no central difference can be taken.
#[test]
fn the_limit_of_a_folding_lens_has_a_gradient() {
    let lens = Distortion::OpenCv { k1: -0.3, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 }.lens().unwrap();
    let rim = lens.angle_limit().tan();
    let by = |inside: f64| {
        let slope = DVec2::new(rim - inside, 0.0);
        project_backward::through_lens(&lens, slope, DVec2::ONE, [DVec2::new(1.0, 0.3), DVec2::new(-0.2, 0.7)])
    };
    Tolerance::relative(1e-3).assert(by(2e-6).to_array(), by(3e-5).to_array(), "slope of the Jacobian");
    assert!(by(2e-6).x.abs() > 0.1);
}
