use atsplat_camera::Distortion;
use glam::{DMat3, DVec3};

use super::HardCase;
use super::scene::{BACKDROP, ONE, One, case, gaussians, looking, sized, through, view};
use crate::View;

/// From a corner of the view to the opposite one, and to the side.
fn row() -> Vec<One> {
    let one = |n: i8| One { mean: [0.45 * f32::from(n), 0.3 * f32::from(n), 2.0 + 0.2 * f32::from(n).abs()], ..ONE };
    (-3..=3).map(one).chain([BACKDROP]).collect()
}

pub(super) fn cases() -> Vec<HardCase> {
    let barrel = Distortion::OpenCv { k1: -0.28, k2: 0.07, k3: -0.01, p1: 0.004, p2: -0.003 };
    let folding = Distortion::OpenCv { k1: -0.9, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
    let all_round = DMat3::from_rotation_y(std::f64::consts::FRAC_PI_2);
    let wide = |fx, fy| looking(DMat3::IDENTITY, DVec3::ZERO, [fx, fy]);
    let fisheye = {
        let mut view = wide(0.3, 0.4);
        view.camera.distortion = Distortion::Fisheye { k: [0.05, -0.02, 0.004, -0.0004] };
        view
    };
    let beside = (-6..=6).map(|n: i8| One { mean: [f32::from(n), 0.5, 1.5], ..ONE });
    vec![
        case("one-pixel", "a picture of one pixel", gaussians(row())).seen(sized(1, 1)),
        case("one-row", "a picture one pixel high", gaussians(row())).seen(sized(67, 1)),
        case("one-column", "a picture one pixel wide", gaussians(row())).seen(sized(1, 67)),
        case("no-whole-tile", "a picture one pixel wider and higher than a tile", gaussians(row())).seen(sized(33, 17)),
        case("barrel-lens", "a strong barrel lens", gaussians(row())).seen(through(barrel)),
        case("folding-lens", "a lens that folds inside the picture", gaussians(row())).seen(through(folding)),
        case("fisheye", "a fisheye of 120 degrees", gaussians(beside.clone())).seen(fisheye),
        case("telephoto", "a focal length of a thousand widths", {
            let near = |n: i8| One { mean: [0.0003 * f32::from(n), 0.0, 2.0], log_scales: [-9.0, -8.5, -8.0], ..ONE };
            gaussians((-2..=2).map(near).chain([BACKDROP]))
        })
        .seen(wide(1000.0, 1300.0)),
        case("wide-angle", "a focal length of a twentieth of the width", gaussians(beside)).seen(wide(0.05, 0.07)),
        case("from-the-side", "a right angle away from where the Gaussians were seen", gaussians(row())).seen(looking(
            all_round,
            DVec3::new(-2.0, 0.1, 2.5),
            [0.9, 1.2],
        )),
        case("from-behind", "the opposite view: what was last is first", gaussians(row())).seen(looking(
            all_round * all_round,
            DVec3::new(0.0, 0.0, 8.0),
            [0.9, 1.2],
        )),
        case("away", "a camera that looks the other way", gaussians(row()))
            .seen(looking(all_round * all_round, DVec3::ZERO, [0.9, 1.2]))
            .counted([0, 0, 8, 0, 0]),
        case("beside-the-picture", "all drawn beside the picture", {
            gaussians([One { mean: [40.0, 0.0, 2.0], ..ONE }, One { mean: [0.0, -1e6, 2.0], ..ONE }])
        })
        .seen(View { ..view() })
        .counted([0, 0, 0, 0, 2]),
    ]
}
