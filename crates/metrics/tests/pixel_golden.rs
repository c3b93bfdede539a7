//! PSNR, L1 and SSIM against skimage, torchmetrics, pytorch-msssim and Inria's formula (`oracle/make_pixel_golden.py`).

mod common;

use atsplat_metrics::{
    Definition, Measure, Networks, Pair, Ssim, Suite, Values, definition, definitions, l1, psnr, ssim,
};
use atsplat_numeric::Tolerance;
use atsplat_pixels::Rounding;

const PSNR: Tolerance = Tolerance::absolute(1e-9);
const SSIM: Tolerance = Tolerance::absolute(1e-9);
/// torchmetrics divides by a logarithm in f32.
const PSNR_TORCHMETRICS: Tolerance = Tolerance::absolute(1e-5);
/// skimage's own rounding errors on the f32 images that papers use.
const SSIM_SKIMAGE_F32: Tolerance = Tolerance::absolute(5e-6);

/// Conversions of samples, by their names in the fixture.
const VALUES: [(&str, Values); 4] = [
    ("as-rendered", Values::AsRendered),
    ("clipped", Values::Clipped),
    ("truncated", Values::EightBit(Rounding::Truncate)),
    ("rounded", Values::EightBit(Rounding::Nearest)),
];
/// Conventions of SSIM, by their names in the fixture.
const SSIMS: [(&str, Ssim); 5] = [
    ("ssim_skimage_gaussian", Ssim::SKIMAGE_GAUSSIAN),
    ("ssim_skimage_uniform", Ssim::SKIMAGE_UNIFORM),
    ("ssim_inria", Ssim::INRIA),
    ("ssim_torchmetrics", Ssim::TORCHMETRICS),
    ("ssim_pytorch_msssim", Ssim::VALID),
];

/// Learned metrics are compared in `learned_golden.rs`.
#[test]
fn every_metric_is_compared() {
    for Definition { id, measure, .. } in definitions() {
        let (values, formula) = match *measure {
            Measure::Psnr { values } | Measure::L1 { values } | Measure::Lpips { values, .. } => (values, None),
            Measure::Ssim { values, ssim } => (values, Some(ssim)),
        };
        assert!(VALUES.iter().any(|(_, known)| *known == values), "{id}");
        assert!(formula.is_none_or(|ssim| SSIMS.iter().any(|(_, known)| *known == ssim)), "{id}");
    }
}

#[test]
fn metrics_agree_with_other_implementations() {
    let golden = common::fixture("pixel_golden.json");
    let cases = golden.as_array().unwrap();
    assert_eq!(cases.len(), 5, "cases of the fixture");
    for (seed, case) in cases.iter().enumerate() {
        let truth = common::truth(case);
        let render = common::render(&truth, seed as u64);
        let pair = Pair::new(&render, &truth).unwrap();
        let name = case["image"].as_str().unwrap();
        for (key, values) in VALUES {
            let expected = |metric: &str| [case["values"][key][metric].as_f64().unwrap()];
            let what = |metric: &str| format!("{metric} of {name}, {key}");
            let found = psnr(&pair, values).value();
            PSNR.assert(found, expected("psnr"), &what("psnr"));
            PSNR_TORCHMETRICS.assert(found, expected("psnr_torchmetrics"), &what("psnr, torchmetrics"));
            PSNR.assert([l1(&pair, values)], expected("l1"), &what("l1"));
            for (metric, convention) in SSIMS {
                SSIM.assert(ssim(&pair, values, convention).ok(), expected(metric), &what(metric));
            }
        }
        let found = ssim(&pair, Values::AsRendered, Ssim::SKIMAGE_GAUSSIAN).ok();
        SSIM_SKIMAGE_F32.assert(found, case["ssim_skimage_f32"].as_f64(), &format!("f32 ssim of {name}"));
    }
}

/// metrics.py of gaussian-splatting reads both images from PNG.
#[test]
fn metrics_of_gaussian_splatting_agree_with_its_formulas() {
    let golden = common::fixture("pixel_golden.json");
    let metrics = ["psnr-8bit-rounded", "ssim-inria-8bit-rounded"].map(|id| definition(id).unwrap());
    let suite = Suite::new(metrics.to_vec(), Networks::default(), 0);
    for (seed, case) in golden.as_array().unwrap().iter().enumerate() {
        let truth = common::truth(case);
        let scores = suite.score(&common::render(&truth, seed as u64), &truth).scores;
        let found = scores.iter().filter_map(|(_, score)| score.value());
        let expected = ["psnr", "ssim_inria"].map(|metric| case["values"]["rounded"][metric].as_f64().unwrap());
        SSIM.assert(found, expected, case["image"].as_str().unwrap());
    }
}
