use glam::{DMat3, DVec3};

use super::HardCase;
use super::scene::{BACKDROP, ONE, One, case, gaussians, looking, options, with};
use crate::RendererConstants;

fn at(mean: [f32; 3]) -> One {
    One { mean, ..ONE }
}

/// The floats around one.
fn around(value: f32) -> [f32; 3] {
    [value.next_down(), value, value.next_up()]
}

pub(super) fn cases() -> Vec<HardCase> {
    let wide = [1.5, 1.0, 1.25];
    let fan = [[6.0f32, 0.0, 0.5], [0.0, 12.0, 0.4], [-9.0, 3.0, 0.3], [30.0, -30.0, 0.25], [2.0, 1.0, 0.02]];
    // Far away, on a grid that f32 still resolves there.
    let far = [1e6f32, -1e6, 1e6];
    let far_mean = |n: f32| [far[0] + 0.25 * n - 0.5, far[1] + 0.125 * n, far[2] + 4.0 + n];
    let scaled = |size: f32| {
        let one = |one: One| One {
            mean: one.mean.map(|value| value * size),
            log_scales: one.log_scales.map(|log| log + size.ln()),
            ..one
        };
        gaussians([ONE, BACKDROP].map(one))
    };
    vec![
        case("inside", "the camera stands inside a Gaussian", {
            gaussians([One { mean: [0.1, 0.0, 0.3], log_scales: [0.7, 0.5, 0.9], ..ONE }, BACKDROP])
        })
        .counted([2, 0, 0, 0, 0]),
        case("inside-huge", "the camera stands inside a Gaussian of a thousand units", {
            gaussians([One { mean: [1.0, -2.0, 0.02], log_scales: [7.0; 3], ..ONE }, BACKDROP])
        })
        .with_gradient_to(1e-3),
        case("behind", "everything lies behind the camera", gaussians([at([0.0, 0.0, -2.0]), at([0.1, 0.0, -1e-3])]))
            .counted([0, 0, 2, 0, 0]),
        case("on-the-camera", "centres at the camera's own, with a near plane at zero", {
            gaussians([at([0.0; 3]), at([0.1, 0.1, 0.0]), at([0.0, 0.0, -0.0]), BACKDROP])
        })
        .drawn(with(|constants| constants.near = 0.0))
        .counted([1, 3, 0, 0, 0]),
        case("near-plane", "on the near plane and one unit in the last place before and behind it", {
            gaussians(around(0.25).map(|z| at([0.01, 0.0, z])).into_iter().chain([BACKDROP]))
        })
        .drawn(with(|constants| constants.near = 0.25))
        .counted([3, 0, 1, 0, 0]),
        case("near-plane-inria", "the same, where the plane itself is culled", {
            gaussians(around(0.25).map(|z| at([0.01, 0.0, z])).into_iter().chain([BACKDROP]))
        })
        .drawn(with(|constants| {
            constants.near = 0.25;
            constants.near_is_culled = true;
        }))
        .counted([2, 0, 2, 0, 0]),
        case("far-plane", "on the far plane and one unit in the last place before and behind it", {
            gaussians(around(8.0).map(|z| at([0.01, 0.0, z])))
        })
        .drawn(with(|constants| constants.far = 8.0))
        .counted([2, 0, 1, 0, 0]),
        case("almost-touching", "a hundredth of a unit ahead, so that a pixel is a ten-thousandth", {
            gaussians([One { mean: [0.0, 0.001, 0.011], log_scales: [-6.0, -7.0, -5.0], ..ONE }, BACKDROP])
        }),
        case("off-axis", "far beside the picture and wide enough to reach it: the Jacobian is clamped", {
            gaussians(fan.map(|mean| One { mean, log_scales: wide, ..ONE }).into_iter().chain([BACKDROP]))
        }),
        case("off-axis-unclamped", "the same with a Jacobian that follows a hundred half widths", {
            gaussians(fan.map(|mean| One { mean, log_scales: wide, ..ONE }).into_iter().chain([BACKDROP]))
        })
        .drawn(with(|constants| constants.jacobian_margin = 100.0))
        .with_gradient_to(1e-3),
        case("off-axis-inria", "the same under the rules of diff-gaussian-rasterization", {
            gaussians(fan.map(|mean| One { mean, log_scales: wide, ..ONE }).into_iter().chain([BACKDROP]))
        })
        .drawn({
            let constants = RendererConstants::named("inria").unwrap_or_default();
            crate::RenderOptions { constants, ..options() }
        }),
        case("far-from-origin", "scene and camera a million units away, where f32 resolves a sixteenth", {
            gaussians((0..5).map(|n| One { mean: far_mean(n as f32), log_scales: [-0.5, -1.0, 0.0], ..ONE }))
        })
        .seen(looking(DMat3::IDENTITY, -DVec3::from_array(far.map(f64::from)), [0.9, 1.2]))
        .counted([5, 0, 0, 0, 0]),
        case("scene-of-a-million", "a scene a million times larger", scaled(1e6)).counted([2, 0, 0, 0, 0]),
        case("scene-of-a-millionth", "a scene a million times smaller", scaled(1e-6))
            .drawn(with(|constants| constants.near = 1e-8))
            .counted([2, 0, 0, 0, 0]),
        case("far-away", "a billion units ahead, and large enough to be seen", {
            gaussians([One { mean: [1e7, -2e7, 1e9], log_scales: [18.5, 18.0, 17.0], ..ONE }])
        })
        .counted([1, 0, 0, 0, 0]),
    ]
}
