use glam::{DMat3, DVec3};

use super::HardCase;
use super::scene::{BACKDROP, SAMPLE, Sample, case, gaussians, inria, off_axis, options_with, view_at};

fn at(mean: [f32; 3]) -> Sample {
    Sample { mean, ..SAMPLE }
}

/// A float and its two neighbours.
fn around(value: f32) -> [f32; 3] {
    [value.next_down(), value, value.next_up()]
}

pub(super) fn cases() -> Vec<HardCase> {
    // Far away, on a grid that f32 still resolves.
    let far = [1e6f32, -1e6, 1e6];
    let far_mean = |n: f32| [far[0] + 0.25 * n - 0.5, far[1] + 0.125 * n, far[2] + 4.0 + n];
    let scaled = |size: f32| {
        let one = |one: Sample| Sample {
            mean: one.mean.map(|value| value * size),
            log_scales: one.log_scales.map(|log| log + size.ln()),
            ..one
        };
        gaussians([SAMPLE, BACKDROP].map(one))
    };
    vec![
        case("inside", "the camera is inside a Gaussian", {
            gaussians([Sample { mean: [0.1, 0.0, 0.3], log_scales: [0.7, 0.5, 0.9], ..SAMPLE }, BACKDROP])
        })
        .with_counts([2, 0, 0, 0, 0]),
        case("inside-huge", "the camera is inside a Gaussian of a thousand units", {
            gaussians([Sample { mean: [1.0, -2.0, 0.02], log_scales: [7.0; 3], ..SAMPLE }, BACKDROP])
        })
        .with_gradient_bound(1e-3),
        case("behind", "everything is behind the camera", gaussians([at([0.0, 0.0, -2.0]), at([0.1, 0.0, -1e-3])]))
            .with_counts([0, 0, 2, 0, 0]),
        case("on-the-camera", "means at the camera centre, with a near plane at zero", {
            gaussians([at([0.0; 3]), at([0.1, 0.1, 0.0]), at([0.0, 0.0, -0.0]), BACKDROP])
        })
        .with_options(options_with(|constants| constants.near = 0.0))
        .with_counts([1, 3, 0, 0, 0]),
        case("near-plane", "on the near plane, and one unit in the last place in front of and behind it", {
            gaussians(around(0.25).map(|z| at([0.01, 0.0, z])).into_iter().chain([BACKDROP]))
        })
        .with_options(options_with(|constants| constants.near = 0.25))
        .with_counts([3, 0, 1, 0, 0]),
        case("near-plane-inria", "the same, with the plane itself culled", {
            gaussians(around(0.25).map(|z| at([0.01, 0.0, z])).into_iter().chain([BACKDROP]))
        })
        .with_options(options_with(|constants| {
            constants.near = 0.25;
            constants.near_is_culled = true;
        }))
        .with_counts([2, 0, 2, 0, 0]),
        case("far-plane", "on the far plane, and one unit in the last place in front of and behind it", {
            gaussians(around(8.0).map(|z| at([0.01, 0.0, z])))
        })
        .with_options(options_with(|constants| constants.far = 8.0))
        .with_counts([2, 0, 1, 0, 0]),
        case("almost-touching", "a hundredth of a unit in front, where a pixel is a ten-thousandth of a unit", {
            gaussians([Sample { mean: [0.0, 0.001, 0.011], log_scales: [-6.0, -7.0, -5.0], ..SAMPLE }, BACKDROP])
        }),
        case("off-axis", "far outside the image but large enough to reach it: the Jacobian is clamped", off_axis()),
        case("off-axis-unclamped", "the same with a Jacobian margin of a hundred half widths", off_axis())
            .with_options(options_with(|constants| constants.jacobian_margin = 100.0))
            .with_gradient_bound(1e-3),
        case("off-axis-inria", "the same with the constants of diff-gaussian-rasterization", off_axis())
            .with_options(inria()),
        case("far-from-origin", "scene and camera a million units away, where f32 resolves a sixteenth", {
            gaussians((0..5).map(|n| Sample { mean: far_mean(n as f32), log_scales: [-0.5, -1.0, 0.0], ..SAMPLE }))
        })
        .with_view(view_at(DMat3::IDENTITY, -DVec3::from_array(far.map(f64::from)), [0.9, 1.2]))
        .with_counts([5, 0, 0, 0, 0]),
        case("scene-of-a-million", "a scene a million times larger", scaled(1e6)).with_counts([2, 0, 0, 0, 0]),
        case("scene-of-a-millionth", "a scene a million times smaller", scaled(1e-6))
            .with_options(options_with(|constants| constants.near = 1e-8))
            .with_counts([2, 0, 0, 0, 0]),
        case("far-away", "a billion units in front, and large enough to be visible", {
            gaussians([Sample { mean: [1e7, -2e7, 1e9], log_scales: [18.5, 18.0, 17.0], ..SAMPLE }])
        })
        .with_counts([1, 0, 0, 0, 0]),
    ]
}
