use atsplat_camera::Distortion;
use glam::{DMat3, DVec3};

use super::HardCase;
use super::scene::{
    BARREL, SAMPLE, Sample, antialiased, case, fan, filtered, fisheye, gaussians, inria, off_axis, view_at,
    view_through,
};

pub(super) fn cases() -> Vec<HardCase> {
    let barrel = view_through(BARREL);
    // Within the lens's fold.
    let off_axis_fan = || {
        fan(
            [[0.6, 0.0, 0.5], [0.0, 0.4, 0.4], [-0.33, 0.24, 0.3], [0.24, -0.22, 0.25], [2.0, 1.0, 0.02]],
            [0.0, -0.5, -0.25],
        )
    };
    let nearly_behind = [0.02, 0.0101, 0.0099, -0.01].map(|z| Sample { mean: [1.0, 0.0, z], ..SAMPLE });
    let half_round = {
        let mut view = view_at(DMat3::IDENTITY, DVec3::ZERO, [0.2865, 0.382]);
        view.camera.distortion = Distortion::Fisheye { k: [0.0; 4] };
        view
    };
    // Near the edge of a fisheye's image, slopes are large, and f32 resolves them less.
    let wide = |case: HardCase| case.with_view(fisheye()).with_image_bound(1e-5).with_gradient_bound(3e-3);
    vec![
        case("off-axis-barrel", "outside the image of a barrel lens, antialiased", off_axis_fan())
            .with_view(barrel)
            .with_options(antialiased())
            .with_counts([5, 0, 0, 0, 1]),
        case("off-axis-barrel-filter", "the same with a 3D filter", filtered(off_axis_fan(), 0.1))
            .with_view(barrel)
            .with_counts([5, 0, 0, 0, 1]),
        case("off-axis-barrel-inria", "the same with the constants of diff-gaussian-rasterization", off_axis_fan())
            .with_view(barrel)
            .with_options(inria())
            .with_counts([5, 0, 1, 0, 0]),
        wide(case("off-axis-fisheye", "far from the axis of a fisheye, antialiased", off_axis()))
            .with_options(antialiased())
            .with_counts([6, 0, 0, 0, 0]),
        wide(case("off-axis-fisheye-filter", "the same with a 3D filter", filtered(off_axis(), 0.5)))
            .with_counts([6, 0, 0, 0, 0]),
        wide(case("off-axis-fisheye-inria", "the same with the constants of diff-gaussian-rasterization", off_axis()))
            .with_options(inria())
            .with_counts([5, 0, 1, 0, 0]),
        case("fisheye-of-200-degrees", "almost at a right angle to the axis, and beyond it", gaussians(nearly_behind))
            .with_view(half_round)
            .with_image_bound(2e-5)
            .with_gradient_bound(2e-3)
            .with_counts([2, 0, 2, 0, 0]),
    ]
}
