use super::HardCase;
use super::scene::{BACKDROP, SAMPLE, Sample, antialiased, case, filtered, gaussians, options_with};
use crate::Gaussians;

/// Rotations by 0, 45, 90 and 135 degrees about the optical axis, and two others.
const ROTATIONS: [[f32; 4]; 6] = [
    [1.0, 0.0, 0.0, 0.0],
    [0.923_879_5, 0.0, 0.0, 0.382_683_43],
    [0.707_106_77, 0.0, 0.0, 0.707_106_77],
    [0.382_683_43, 0.0, 0.0, 0.923_879_5],
    [0.9, 0.3, -0.2, 0.1],
    [0.6, -0.5, 0.4, 0.3],
];

fn rotated(log_scales: [f32; 3]) -> impl Iterator<Item = Sample> {
    ROTATIONS.into_iter().enumerate().map(move |(n, quaternion)| {
        let n = n as f32;
        Sample { mean: [0.15 * n - 0.4, 0.3 - 0.1 * n, 2.0 + 0.25 * n], quaternion, log_scales, ..SAMPLE }
    })
}

/// Hundreds of Gaussians, one per pixel.
fn dust(log_scales: [f32; 3]) -> Gaussians {
    gaussians((0..400).map(|n| {
        let (column, row) = (n % 20, n / 20);
        let mean = [0.1 * (column as f32 - 9.5), 0.075 * (row as f32 - 9.5), 2.0 + 0.001 * n as f32];
        Sample { mean, log_scales, ..SAMPLE }
    }))
}

pub(super) fn cases() -> Vec<HardCase> {
    let end_on = Sample { log_scales: [-9.0, -9.0, 1.0], quaternion: [1.0, 0.0, 0.0, 0.0], ..SAMPLE };
    let fine = || dust([-7.0, -7.5, -6.5]);
    let with_end_on = |filter: f32| filtered(gaussians([SAMPLE, end_on, BACKDROP]), filter);
    let little_blur = || {
        let mut options = antialiased();
        options.constants.blur = 0.1;
        options
    };
    vec![
        case("needles", "a thousand times longer than wide, in every direction", gaussians(rotated([0.0, -7.0, -7.0])))
            .with_counts([6, 0, 0, 0, 0]),
        case("long-needles", "a hundred million times longer than wide", gaussians(rotated([8.0, -11.0, -11.0])))
            .with_gradient_bound(1e-3)
            .with_gradients_in_f64_only(),
        case("needle-end-on", "a needle along the optical axis", gaussians([end_on, BACKDROP]))
            .with_counts([2, 0, 0, 0, 0]),
        case(
            "flat-discs",
            "one scale is almost zero, seen from the front and edge-on",
            gaussians(rotated([-1.0, -1.0, -60.0])),
        )
        .with_counts([6, 0, 0, 0, 0]),
        case("points", "all scales are almost zero: only the blur is drawn", gaussians(rotated([-100.0; 3])))
            .with_counts([6, 0, 0, 0, 0]),
        case("denormal-scales", "scales that are denormal in f32, or zero", {
            let scales = [-87.0, -88.0, -100.0, -103.0, -104.0, -200.0];
            gaussians(rotated([0.0; 3]).zip(scales).map(|(one, log)| Sample { log_scales: [log, -1.5, log], ..one }))
        }),
        case("tiny", "scales of 1e-6, in classic mode", gaussians(rotated([-13.8, -14.3, -13.5])))
            .with_counts([6, 0, 0, 0, 0]),
        case("tiny-antialiased", "scales of 1e-6, antialiased to nothing", gaussians(rotated([-13.8, -14.3, -13.5])))
            .with_options(antialiased())
            .with_counts([0, 0, 0, 6, 0]),
        case("huge", "scales of 1e6", gaussians(rotated([13.8, 14.3, 13.5]))).with_gradient_bound(1e-3),
        case("dust", "hundreds of Gaussians a hundredth of a pixel wide", fine()),
        case("dust-antialiased", "the same, antialiased, all of it too faint", fine())
            .with_options(antialiased())
            .with_counts([0, 0, 0, 400, 0]),
        case("dust-compensated", "the same with a minimum compensation, as in gsplat 1.6", fine()).with_options({
            let mut options = antialiased();
            options.constants.min_compensation = 0.02;
            options
        }),
        case("dust-filtered", "a tenth of a pixel wide, with a 3D filter, antialiased", {
            filtered(dust([-5.0, -5.5, -4.5]), 0.005)
        })
        .with_options(little_blur())
        .with_counts([400, 0, 0, 0, 0]),
        case("needles-filtered", "needles with a 3D filter as wide as they are, antialiased", {
            filtered(gaussians(rotated([0.0, -7.0, -7.0])), 0.001)
        })
        .with_options(little_blur())
        .with_counts([6, 0, 0, 0, 0]),
        case(
            "antialiased",
            "needles and a backdrop, antialiased",
            gaussians(rotated([-1.0, -4.0, -4.0]).chain([BACKDROP])),
        )
        .with_options(antialiased()),
        case("no-blur", "no screen-space blur at all", gaussians(rotated([-1.0, -2.0, -2.5])))
            .with_options(options_with(|constants| constants.blur = 0.0)),
        case("no-blur-disc-edge-on", "without blur a disc seen edge-on has no area", {
            let disc =
                Sample { quaternion: [1.0, 0.0, 0.0, 0.0], log_scales: [-1.0, f32::NEG_INFINITY, -1.0], ..SAMPLE };
            gaussians([Sample { mean: [0.0, 0.0, 2.0], ..disc }, BACKDROP])
        })
        .with_options(options_with(|constants| constants.blur = 0.0))
        .with_counts([1, 1, 0, 0, 0]),
        case("filter-none", "a 3D filter of zero", with_end_on(0.0)),
        case("filter-thin", "a 3D filter wider than a needle", with_end_on(0.05)),
        case("filter-thin-antialiased", "the same, antialiased", with_end_on(0.05))
            .with_options(little_blur())
            .with_counts([2, 0, 0, 1, 0]),
        case("filter-huge", "a 3D filter that reduces opacity to nothing", with_end_on(1e6))
            .with_counts([0, 0, 0, 3, 0]),
    ]
}
