use atsplat_camera::ImageSize;
use glam::{DMat3, DVec3};

use super::HardCase;
use super::scene::{BACKDROP, SAMPLE, Sample, case, gaussians, view_at};
use crate::{Gaussians, View};

/// A needle through the image whose centre is a hundred thousand pixels outside of it, times `distance`, and [`BACKDROP`].
fn from_outside(distance: f32) -> Gaussians {
    let needle = Sample {
        mean: [-42.031_13 * distance, -28.755_07 * distance, 0.011],
        quaternion: [0.955_336, 0.0, 0.0, 0.295_52],
        log_scales: [3.574_388 + distance.ln(), -7.583, -7.583],
        logit: 3.0,
        ..SAMPLE
    };
    gaussians([needle, BACKDROP])
}

pub(super) fn cases() -> Vec<HardCase> {
    let across = Sample {
        quaternion: [0.923_879_5, 0.0, 0.0, 0.382_683_43],
        log_scales: [1.0, -7.0, -7.0],
        logit: 0.5,
        ..SAMPLE
    };
    let large =
        View { size: ImageSize { width: 300, height: 225 }, ..view_at(DMat3::IDENTITY, DVec3::ZERO, [1.0, 4.0 / 3.0]) };
    // In f32, a centre a hundred thousand pixels away is exact to a hundredth of a pixel, and the needle's direction to as much.
    let outside = |name, description, distance, gradient, image_in_f32| {
        case(name, description, from_outside(distance))
            .with_gradient_bound(gradient)
            .with_image_bound_in_f32(image_in_f32)
            .with_counts([2, 0, 0, 0, 0])
    };
    vec![
        case(
            "needle-across-an-image",
            "half a pixel wide, from corner to corner of a large image",
            gaussians([across]),
        )
        .with_view(large)
        .with_image_bound(2e-5)
        .with_gradient_bound(2e-3)
        .with_counts([1, 0, 0, 0, 0]),
        outside("centre-at-1e5-pixels", "a needle whose centre is far outside the image", 1.0, 1e-3, 2e-2),
        outside("centre-at-3e5-pixels", "three times as far", 3.0, 1e-3, 1e-1),
        outside("centre-at-3e6-pixels", "thirty times as far", 30.0, 2e-3, f64::INFINITY),
    ]
}
