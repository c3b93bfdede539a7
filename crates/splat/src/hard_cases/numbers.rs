use super::HardCase;
use super::scene::{BACKDROP, ONE, One, case, gaussians, of_degree, options, with};
use crate::{Exposure, GaussianParts, Gaussians, RenderOptions, ShAxes};

/// A number in each of a Gaussian's fields, a Gaussian each, before one that is usable.
fn in_each_field(number: f32) -> Gaussians {
    let mut parts: GaussianParts = gaussians(vec![ONE; 6].into_iter().chain([BACKDROP])).into_parts();
    let put = |slot: Option<&mut f32>| slot.into_iter().for_each(|slot| *slot = number);
    put(parts.means.get_mut(0).map(|[x, ..]| x));
    put(parts.quaternions.get_mut(1).map(|[w, ..]| w));
    put(parts.log_scales.get_mut(2).map(|[.., z]| z));
    put(parts.opacity_logits.get_mut(3));
    put(parts.scalars.as_mut().and_then(|scalars| scalars.get_mut(4)));
    put(parts.sh.get_mut(5).map(|[_, g, _]| g));
    Gaussians::new(parts).unwrap_or_default()
}

pub(super) fn cases() -> Vec<HardCase> {
    let quaternion = |quaternion| One { quaternion, ..ONE };
    let spread = |n: usize| One { mean: [0.3 * n as f32 - 0.6, 0.1, 2.0 + 0.5 * n as f32], ..ONE };
    let wave = |size: f32| {
        move |n: usize| [(n as f32).sin(), (1.3 * n as f32).cos(), (0.7 * n as f32).sin()].map(|v| v * size)
    };
    let e3nn = || with(|constants| constants.sh_axes = ShAxes::E3nn);
    vec![
        case("not-a-number", "NaN in each field", in_each_field(f32::NAN)).counted([1, 6, 0, 0, 0]),
        case(
            "infinity",
            "infinity in each field: an opacity of one is none the worse for it",
            in_each_field(f32::INFINITY),
        )
        .counted([2, 5, 0, 0, 0]),
        case("minus-infinity", "minus infinity in each field: a scale of zero is usable, an opacity of zero faint", {
            in_each_field(f32::NEG_INFINITY)
        })
        .counted([2, 4, 0, 1, 0]),
        case("largest", "the largest float in each field", in_each_field(f32::MAX)),
        case("smallest", "the smallest float in each field", in_each_field(f32::from_bits(1))),
        case("zero-quaternions", "no rotation at all is invalid", gaussians([quaternion([0.0; 4]), BACKDROP]))
            .counted([1, 1, 0, 0, 0]),
        case("long-quaternions", "rotations far from unit length", {
            gaussians([quaternion([1e-20, 2e-20, 0.0, 1e-20]), quaternion([3e30, 1e30, -2e30, 0.0]), BACKDROP])
        })
        .counted([3, 0, 0, 0, 0]),
        case("bright", "colours of a billion", gaussians([One { colour: [3e9, 1e9, -3e9], ..ONE }, BACKDROP]))
            .with_gradient_to(1e-3),
        case("too-bright", "colours beyond any meaning are invalid", {
            gaussians([One { colour: [1e13, 0.0, 0.0], ..ONE }, One { scalar: -1e13, ..ONE }, BACKDROP])
        })
        .counted([1, 2, 0, 0, 0]),
        case("every-degree", "harmonics up to degree 4 that change sign across the scene", {
            of_degree(4, (0..5).map(spread), wave(0.6))
        }),
        case("harmonics-of-e3nn", "harmonics of degree 3 on turned axes", of_degree(3, (0..5).map(spread), wave(0.6)))
            .drawn(e3nn()),
        case("huge-harmonics", "harmonics of a million that cancel in some directions", {
            of_degree(3, (0..5).map(spread), wave(1e6))
        }),
        case("harmonics-of-nothing", "degree 3 of which all but degree 0 is zero", {
            of_degree(3, (0..5).map(spread), |_| [0.0; 3])
        }),
        case("exposed", "a strong exposure over a background", of_degree(1, (0..5).map(spread), wave(0.3))).drawn({
            let matrix = [[1.8, -0.4, 0.1], [0.2, 0.7, -0.3], [-0.5, 0.3, 2.5]];
            let exposure = Some(Exposure { matrix, offset: [-0.2, 0.1, 0.05] });
            RenderOptions { exposure, ..options() }
        }),
    ]
}
