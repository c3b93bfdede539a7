//! Properties of metrics on any pair of images: bounds, symmetry, independence of threads.

#![expect(clippy::unwrap_used, reason = "test images are valid")]

mod common;

use atsplat_metrics::ssim::Border;
use atsplat_metrics::{
    MetricError, NonFinite, Pair, Score, Ssim, Values, l1, mean_squared_error, psnr, ssim, ssim_map,
};
use atsplat_numeric::Tolerance;
use atsplat_pixels::{Image, Rounding};
use atsplat_tests::on_threads;
use common::seeded;
use proptest::prelude::*;

const CONVENTIONS: [Ssim; 5] =
    [Ssim::SKIMAGE_GAUSSIAN, Ssim::SKIMAGE_UNIFORM, Ssim::INRIA, Ssim::VALID, Ssim::TORCHMETRICS];
const VALUES: [Values; 4] =
    [Values::AsRendered, Values::Clipped, Values::EightBit(Rounding::Truncate), Values::EightBit(Rounding::Nearest)];

fn all(pair: &Pair<'_>, values: Values) -> Vec<f64> {
    let mut numbers = vec![mean_squared_error(pair, values), l1(pair, values)];
    numbers.extend(CONVENTIONS.map(|convention| ssim(pair, values, convention).unwrap()));
    numbers
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn metrics_are_bounded_symmetric_and_independent_of_threads(
        width in 11u32..60, height in 11u32..90, seeds: (u64, u64), values in prop::sample::select(VALUES.to_vec()),
    ) {
        let (a, b) = (seeded(width, height, seeds.0), seeded(width, height, seeds.1));
        let pair = Pair::new(&a, &b).unwrap();
        let found = on_threads(1, || all(&pair, values));
        prop_assert!(found[..2].iter().all(|error| (0.0..=1.0).contains(error)), "{found:?}");
        prop_assert!(found[2..].iter().all(|similarity| (-1.0..=1.0).contains(similarity)), "{found:?}");
        let swapped = on_threads(3, || all(&Pair::new(&b, &a).unwrap(), values));
        prop_assert!(Tolerance::EXACT.check(swapped, found).is_ok());
    }

    #[test]
    fn maps_average_to_the_metric(width in 11u32..40, height in 11u32..40, seed: u64) {
        let (a, b) = (seeded(width, height, seed), seeded(width, height, seed ^ 1));
        let pair = Pair::new(&a, &b).unwrap();
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        for convention in CONVENTIONS {
            let map = ssim_map(&pair, Values::AsRendered, convention).unwrap();
            let expected = ssim(&pair, Values::AsRendered, convention).ok();
            prop_assert!(Tolerance::F64.check([mean(&map)], expected).is_ok());
            let margin = if convention.border == Border::Inside { 2 * convention.window.radius() } else { 0 };
            prop_assert_eq!(map.len(), ((width - margin) * (height - margin)) as usize);
        }
    }

    #[test]
    fn every_non_finite_sample_is_counted(
        width in 1u32..20, height in 1u32..20, at in prop::collection::btree_set(0usize..1200, 1..9), seed: u64,
    ) {
        let clean = seeded(width, height, seed);
        let count = clean.samples().len();
        let broken: Vec<usize> = at.into_iter().filter(|at| *at < count).collect();
        prop_assume!(!broken.is_empty());
        let mut samples = clean.samples().to_vec();
        for (turn, at) in broken.iter().enumerate() {
            samples[*at] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][turn % 3];
        }
        let damaged = Image::new(width, height, samples).unwrap();
        let first = u32::try_from(broken[0]).unwrap();
        let position = Some([first / 3 % width, first / 3 / width, first % 3]);
        let number = broken.len() as u64;
        let counted = |outcome: Result<Pair<'_>, MetricError>| match outcome {
            Err(MetricError::NonFinite(counted)) => Some(counted),
            _ => None,
        };
        prop_assert_eq!(counted(Pair::new(&damaged, &clean)), Some(NonFinite { render: number, truth: 0, first: position }));
        prop_assert_eq!(counted(Pair::new(&clean, &damaged)), Some(NonFinite { render: 0, truth: number, first: position }));
    }
}

#[test]
fn identical_images_are_recognised() {
    for image in
        [seeded(20, 13, 5), Image::new(20, 13, vec![0.25; 780]).unwrap(), Image::new(20, 13, vec![0.0; 780]).unwrap()]
    {
        let pair = Pair::new(&image, &image).unwrap();
        assert!(pair.is_identical());
        for values in VALUES {
            assert_eq!(psnr(&pair, values), Score::Identical, "{values:?}");
            let ones = CONVENTIONS.map(|convention| ssim(&pair, values, convention).unwrap());
            Tolerance::EXACT.assert(ones, [1.0; 5], "similarity to itself");
        }
    }
    let (a, b) = (Image::new(1, 1, vec![0.5; 3]).unwrap(), Image::new(1, 1, vec![0.5001; 3]).unwrap());
    let pair = Pair::new(&a, &b).unwrap();
    assert!(!pair.is_identical(), "though 8 bits hide the difference");
    assert_eq!(psnr(&pair, Values::EightBit(Rounding::Truncate)), Score::Identical);
    assert!(psnr(&pair, Values::Clipped).value().is_some());
}

#[test]
fn invalid_pairs_are_typed_errors() {
    let image = |width, height| seeded(width, height, 1);
    let (one, ten, wide) = (image(1, 1), image(10, 10), image(12, 6));
    assert!(matches!(Pair::new(&ten, &wide), Err(MetricError::SizeMismatch { expected: [10, 10], found: [12, 6] })));
    let error = Pair::new(&wide, &image(6, 12)).unwrap_err();
    assert_eq!(error.to_string(), "truth: expected 12×6 pixels like the render, found 6×12");
    let empty = Image::new(0, 5, vec![]).unwrap();
    assert!(matches!(Pair::new(&empty, &empty), Err(MetricError::Empty { size: [0, 5] })));
    for (image, convention, smallest) in [
        (&ten, Ssim::SKIMAGE_GAUSSIAN, Some(11)),
        (&one, Ssim::VALID, Some(11)),
        (&wide, Ssim::SKIMAGE_UNIFORM, Some(7)),
        (&ten, Ssim::SKIMAGE_UNIFORM, None),
        (&one, Ssim::INRIA, None),
        (&ten, Ssim::TORCHMETRICS, None),
        (&one, Ssim::TORCHMETRICS, Some(6)),
    ] {
        let pair = Pair::new(image, image).unwrap();
        let found = match ssim(&pair, Values::Clipped, convention) {
            Err(MetricError::TooSmall { smallest, .. }) => Some(smallest),
            Err(_) => Some(0),
            Ok(_) => None,
        };
        assert_eq!(found, smallest, "{convention:?}");
        assert_eq!(ssim_map(&pair, Values::Clipped, convention).is_err(), smallest.is_some());
    }
}

#[test]
fn psnr_of_uniform_noise_is_its_variance() {
    let truth = Image::new(256, 256, vec![0.5; 256 * 256 * 3]).unwrap();
    let noise = common::uniform(3, truth.samples().len(), 0.1);
    let render = Image::new(256, 256, noise.iter().map(|noise| 0.5 + noise).collect()).unwrap();
    let found = psnr(&Pair::new(&render, &truth).unwrap(), Values::Clipped).value();
    // Variance of a uniform number of half-width b: b² / 3.
    Tolerance::absolute(0.01).assert(found, [-10.0 * (0.01f64 / 3.0).log10()], "PSNR");
}
