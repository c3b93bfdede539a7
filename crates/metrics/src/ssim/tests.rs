use super::similarity::rows_at;
use super::{Ssim, ssim};
use crate::{Pair, Values};
use atsplat_numeric::Tolerance;
use atsplat_pixels::Image;
use pulp::Arch;

fn images() -> [Image; 2] {
    [0, 1].map(|seed| {
        let samples = crate::learned::uniform(seed, 33 * 41 * 3, 0.6).into_iter().map(|v| v + 0.5).collect();
        Image::new(33, 41, samples).unwrap()
    })
}

#[test]
fn scalar_and_simd_results_are_bit_identical() {
    let [a, b] = images();
    let pair = Pair::new(&a, &b).unwrap();
    for convention in [Ssim::SKIMAGE_GAUSSIAN, Ssim::SKIMAGE_UNIFORM, Ssim::INRIA, Ssim::TORCHMETRICS] {
        let similarities =
            |arch| rows_at(arch, &pair.rows(Values::AsRendered), pair.size(), convention, <[f64]>::to_vec).concat();
        Tolerance::EXACT.assert(similarities(Arch::Scalar), similarities(Arch::new()), "similarities");
    }
}

#[test]
fn a_single_window_agrees_with_the_definition() {
    let samples = |values: fn(usize) -> f32| Image::new(7, 7, (0..147).map(|i| values(i / 3)).collect()).unwrap();
    let (a, b) = (samples(|i| if i % 2 == 0 { 0.2 } else { 0.6 }), samples(|i| if i < 24 { 0.1 } else { 0.9 }));
    let [x, y] = [&a, &b].map(|p| p.samples().iter().step_by(3).map(|v| f64::from(*v)).collect::<Vec<_>>());
    let mean = |v: &[f64]| v.iter().sum::<f64>() / 49.0;
    let (mx, my) = (mean(&x), mean(&y));
    let product =
        |v: &[f64], mv: f64, w: &[f64], mw: f64| v.iter().zip(w).map(|(v, w)| (v - mv) * (w - mw)).sum::<f64>() / 48.0;
    let (vx, vy, cross) = (product(&x, mx, &x, mx), product(&y, my, &y, my), product(&x, mx, &y, my));
    let expected = (2.0 * mx * my + 1e-4) * (2.0 * cross + 9e-4) / ((mx * mx + my * my + 1e-4) * (vx + vy + 9e-4));
    let found = ssim(&Pair::new(&a, &b).unwrap(), Values::AsRendered, Ssim::SKIMAGE_UNIFORM).ok();
    Tolerance::F64.assert(found, [expected], "similarity");
}
