use atsplat_camera::Distortion;
use glam::{DMat3, DVec3};

use super::HardCase;
use super::scene::{
    BACKDROP, BARREL, SAMPLE, Sample, case, fisheye, gaussians, view, view_at, view_of_size, view_through,
};
use crate::View;

/// Gaussians along a diagonal of the view and beyond it.
fn row() -> Vec<Sample> {
    let one =
        |n: i8| Sample { mean: [0.45 * f32::from(n), 0.3 * f32::from(n), 2.0 + 0.2 * f32::from(n).abs()], ..SAMPLE };
    (-3..=3).map(one).chain([BACKDROP]).collect()
}

pub(super) fn cases() -> Vec<HardCase> {
    let folding = Distortion::OpenCv { k1: -0.9, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
    let all_round = DMat3::from_rotation_y(std::f64::consts::FRAC_PI_2);
    let wide = |fx, fy| view_at(DMat3::IDENTITY, DVec3::ZERO, [fx, fy]);
    let row_to_the_sides = (-6..=6).map(|n: i8| Sample { mean: [f32::from(n), 0.5, 1.5], ..SAMPLE });
    vec![
        case("one-pixel", "an image of one pixel", gaussians(row())).with_view(view_of_size(1, 1)),
        case("one-row", "an image one pixel high", gaussians(row())).with_view(view_of_size(67, 1)),
        case("one-column", "an image one pixel wide", gaussians(row())).with_view(view_of_size(1, 67)),
        case("no-whole-tile", "an image one pixel wider and higher than a tile", gaussians(row()))
            .with_view(view_of_size(33, 17)),
        case("barrel-lens", "a strong barrel lens", gaussians(row())).with_view(view_through(BARREL)),
        case("folding-lens", "a lens that folds inside the image", gaussians(row())).with_view(view_through(folding)),
        case("fisheye", "a fisheye of 120 degrees", gaussians(row_to_the_sides.clone())).with_view(fisheye()),
        case("telephoto", "a focal length of a thousand image widths", {
            let near =
                |n: i8| Sample { mean: [0.0003 * f32::from(n), 0.0, 2.0], log_scales: [-9.0, -8.5, -8.0], ..SAMPLE };
            gaussians((-2..=2).map(near).chain([BACKDROP]))
        })
        .with_view(wide(1000.0, 1300.0)),
        case("wide-angle", "a focal length of a twentieth of the image width", gaussians(row_to_the_sides))
            .with_view(wide(0.05, 0.07)),
        case("from-the-side", "a view at a right angle", gaussians(row())).with_view(view_at(
            all_round,
            DVec3::new(-2.0, 0.1, 2.5),
            [0.9, 1.2],
        )),
        case("from-behind", "the opposite view: the depth order is reversed", gaussians(row())).with_view(view_at(
            all_round * all_round,
            DVec3::new(0.0, 0.0, 8.0),
            [0.9, 1.2],
        )),
        case("away", "a camera that looks the other way", gaussians(row()))
            .with_view(view_at(all_round * all_round, DVec3::ZERO, [0.9, 1.2]))
            .with_counts([0, 0, 8, 0, 0]),
        case("beside-the-image", "everything projects outside the image", {
            gaussians([Sample { mean: [40.0, 0.0, 2.0], ..SAMPLE }, Sample { mean: [0.0, -1e6, 2.0], ..SAMPLE }])
        })
        .with_view(View { ..view() })
        .with_counts([0, 0, 0, 0, 2]),
    ]
}
