use super::HardCase;
use super::scene::{BACKDROP, SAMPLE, Sample, case, gaussians, options_with};

/// A Gaussian large enough that its centre covers the whole image.
fn sheet(depth: f32, logit: f32) -> Sample {
    Sample { mean: [0.0, 0.0, depth], log_scales: [3.0, 3.0, -1.0], logit, ..SAMPLE }
}

/// The logit of an opacity of 1/255.
const FAINTEST: f32 = -5.537_334_3;

pub(super) fn cases() -> Vec<HardCase> {
    let stack = |count: usize, logit: f32| {
        (0..count).map(move |n| {
            let shade = n as f32 / count as f32;
            Sample { colour: [shade, 1.0 - shade, 0.3], ..sheet(2.0 + 0.01 * n as f32, logit) }
        })
    };
    let endless = || {
        options_with(|constants| {
            constants.max_alpha = f64::from(1f32.next_down());
            constants.min_transmittance = 0.0;
        })
    };
    vec![
        case("opacity-0-and-1", "infinite logits, and logits beyond the range of exp", {
            let logits = [f32::NEG_INFINITY, f32::INFINITY, -104.0, 104.0, -20.0, 20.0, -1e30, 1e30];
            let one = |(n, logit): (usize, f32)| Sample { mean: [0.2 * n as f32 - 0.7, 0.0, 2.0], logit, ..SAMPLE };
            gaussians(logits.into_iter().enumerate().map(one))
        })
        .with_gradient_bound(5e-4)
        .with_counts([4, 0, 0, 4, 0]),
        case("faintest", "opacities of 1/255, and within eight units in the last place of it", {
            let mut logit = FAINTEST;
            (0..8).for_each(|_| logit = logit.next_down());
            let next = || {
                logit = logit.next_up();
                Sample { mean: [0.0, 0.0, 3.0], logit, ..SAMPLE }
            };
            gaussians(std::iter::repeat_with(next).take(16).collect::<Vec<_>>().into_iter().chain([BACKDROP]))
        }),
        case("saturated", "fifty opaque layers: all pixels finish early", gaussians(stack(50, 20.0)))
            .with_gradient_bound(5e-3),
        case("nearly-saturated", "opacities around max-alpha", {
            let logits = [6.9, 6.906, 6.907, 6.908, 7.0, 9.0];
            gaussians(logits.into_iter().enumerate().map(|(n, logit)| sheet(2.0 + n as f32, logit)))
        })
        .with_gradient_bound(3e-3),
        case("one-in-the-way", "an alpha of almost one in front, without an early stop", {
            gaussians([sheet(2.0, 30.0), sheet(3.0, 0.0), BACKDROP])
        })
        .with_options(endless())
        .with_gradient_bound(2e-2),
        case("opaque", "the same with its centre on a pixel's, where alpha is the largest below one", {
            let mean = [-0.52 / 21.6, 0.28 / 21.6, 2.0];
            gaussians([Sample { mean, ..sheet(2.0, 30.0) }, sheet(3.0, 0.0), BACKDROP])
        })
        .with_options(endless())
        .with_counts([3, 0, 0, 0, 0])
        .with_gradient_bound(2e-2),
        case("almost-one-in-the-way", "an opacity 6e-8 below one: its 1/(1 − α) is 2²⁴", {
            gaussians([sheet(2.0, 16.6), sheet(3.0, 0.0), BACKDROP])
        })
        .with_options(endless())
        .with_gradient_bound(2e-2),
        case("gauze", "a thousand layers just above min-alpha", {
            gaussians(stack(1000, -5.4).map(|one| Sample { mean: [0.0, 0.0, one.mean[2] - 1.0], ..one }))
        })
        .with_image_bound(1e-5)
        .with_gradient_bound(1e-3),
        case("half-way", "the transmittance reaches one half exactly", {
            gaussians([sheet(2.0, 0.0), sheet(3.0, 0.0), sheet(4.0, 0.0)])
        }),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Field, Finding, Problem};

    /// Of one case alone, in which the exponentials of four finite logits overflow f32 as well.
    #[test]
    fn infinite_logits_and_those_beyond_the_range_of_exp_are_invalid() {
        let field = Field::OpacityLogits;
        let found = [
            Finding { field, problem: Problem::Infinite, count: 2, first: 0 },
            Finding { field, problem: Problem::OutOfRange, count: 4, first: 2 },
        ];
        for case in cases() {
            let expected: &[Finding] = if case.name == "opacity-0-and-1" { &found } else { &[] };
            assert_eq!(case.gaussians.validate().findings, expected, "{}", case.name);
        }
    }
}
