use super::HardCase;
use super::scene::{BACKDROP, SAMPLE, Sample, case, gaussians, of_degree, options, options_with, valid};
use crate::{Exposure, GaussianParts, Gaussians, RenderOptions, ShAxes};

/// Six Gaussians with a number in one field each, and a valid one behind them.
fn in_each_field(number: f32) -> Gaussians {
    let mut parts: GaussianParts = gaussians(vec![SAMPLE; 6].into_iter().chain([BACKDROP])).into_parts();
    let set = |slot: Option<&mut f32>| slot.into_iter().for_each(|slot| *slot = number);
    set(parts.means.get_mut(0).map(|[x, ..]| x));
    set(parts.quaternions.get_mut(1).map(|[w, ..]| w));
    set(parts.log_scales.get_mut(2).map(|[.., z]| z));
    set(parts.opacity_logits.get_mut(3));
    set(parts.scalars.as_mut().and_then(|scalars| scalars.get_mut(4)));
    set(parts.sh.get_mut(5).map(|[_, g, _]| g));
    valid(parts)
}

pub(super) fn cases() -> Vec<HardCase> {
    let quaternion = |quaternion| Sample { quaternion, ..SAMPLE };
    let spread = |n: usize| Sample { mean: [0.3 * n as f32 - 0.6, 0.1, 2.0 + 0.5 * n as f32], ..SAMPLE };
    let wave = |size: f32| {
        move |n: usize| [(n as f32).sin(), (1.3 * n as f32).cos(), (0.7 * n as f32).sin()].map(|v| v * size)
    };
    let e3nn = || options_with(|constants| constants.sh_axes = ShAxes::E3nn);
    vec![
        case("not-a-number", "NaN in each field", in_each_field(f32::NAN)).with_counts([1, 6, 0, 0, 0]),
        case("infinity", "infinity in each field; as an opacity logit it is valid", in_each_field(f32::INFINITY))
            .with_counts([2, 5, 0, 0, 0]),
        case("minus-infinity", "minus infinity in each field: a scale of zero is valid, an opacity of zero faint", {
            in_each_field(f32::NEG_INFINITY)
        })
        .with_counts([2, 4, 0, 1, 0]),
        case("largest", "the largest float in each field", in_each_field(f32::MAX)),
        case("smallest", "the smallest float in each field", in_each_field(f32::from_bits(1))),
        case("zero-quaternions", "zero quaternions are invalid", gaussians([quaternion([0.0; 4]), BACKDROP]))
            .with_counts([1, 1, 0, 0, 0]),
        case("long-quaternions", "quaternions far from unit norm", {
            gaussians([quaternion([1e-20, 2e-20, 0.0, 1e-20]), quaternion([3e30, 1e30, -2e30, 0.0]), BACKDROP])
        })
        .with_counts([3, 0, 0, 0, 0]),
        case("bright", "colours of a billion", gaussians([Sample { colour: [3e9, 1e9, -3e9], ..SAMPLE }, BACKDROP]))
            .with_gradient_bound(1e-3),
        case("too-bright", "colours beyond the largest channel are invalid", {
            gaussians([Sample { colour: [1e13, 0.0, 0.0], ..SAMPLE }, Sample { scalar: -1e13, ..SAMPLE }, BACKDROP])
        })
        .with_counts([1, 2, 0, 0, 0]),
        case("every-degree", "spherical harmonics of degree 4 that change sign across the scene", {
            of_degree(4, (0..5).map(spread), wave(0.6))
        }),
        case(
            "harmonics-of-e3nn",
            "spherical harmonics of degree 3 in e3nn's axis order",
            of_degree(3, (0..5).map(spread), wave(0.6)),
        )
        .with_options(e3nn()),
        case("huge-harmonics", "SH coefficients of a million that cancel in some directions", {
            of_degree(3, (0..5).map(spread), wave(1e6))
        }),
        case("harmonics-of-nothing", "degree 3 with zero coefficients above degree 0", {
            of_degree(3, (0..5).map(spread), |_| [0.0; 3])
        }),
        case("exposed", "a strong exposure over a background", of_degree(1, (0..5).map(spread), wave(0.3)))
            .with_options({
                let matrix = [[1.8, -0.4, 0.1], [0.2, 0.7, -0.3], [-0.5, 0.3, 2.5]];
                let exposure = Some(Exposure { matrix, offset: [-0.2, 0.1, 0.05] });
                RenderOptions { exposure, ..options() }
            }),
    ]
}
