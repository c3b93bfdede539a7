//! Exposure in the reference renderer, and its gradients.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use atsplat_numeric::Tolerance;
use atsplat_splat::hard_cases::{HardCase, catalogue};
use atsplat_splat::{Exposure, ImageGradients, RenderOptions, Rendering, SplatError, reference};

/// Tolerance for finite differences in f64.
const DIFFERENCES: Tolerance = Tolerance { absolute: 1e-7, relative: 1e-6 };

fn exposed() -> HardCase {
    catalogue().into_iter().find(|case| case.name == "exposed").unwrap()
}

fn loss(rendering: &Rendering<f64>, images: &ImageGradients<f64>) -> f64 {
    let (rgb, d_rgb) = (rendering.rgb.as_flattened(), images.rgb.as_flattened());
    rgb.iter().zip(d_rgb).map(|(value, by)| value * by).sum()
}

fn images(case: &HardCase) -> ImageGradients<f64> {
    let wave = |n: usize| (n as f64 * 0.7).sin();
    let rgb = (0..case.view.pixels()).map(|pixel| [wave(3 * pixel), wave(3 * pixel + 1), wave(3 * pixel + 2)]);
    ImageGradients { rgb: rgb.collect(), alpha: None, depth: None, scalar: None }
}

#[test]
fn exposure_applies_after_compositing_to_colour_only() {
    let case = exposed();
    let exposure = case.options.exposure.unwrap();
    let options = RenderOptions { exposure: None, ..case.options.clone() };
    let before = reference::render(&case.gaussians, &case.view, &options).unwrap();
    let after = reference::render(&case.gaussians, &case.view, &case.options).unwrap();
    let expected: Vec<[f64; 3]> = before.rgb.iter().map(|rgb| exposure.apply(*rgb)).collect();
    Tolerance::F64.assert(after.rgb.iter().flatten().copied(), expected.into_iter().flatten(), "rgb");
    assert_eq!(Rendering { rgb: before.rgb.clone(), ..after }, before);
}

#[test]
fn exposure_gradient_matches_differences() {
    let case = exposed();
    let exposure = case.options.exposure.unwrap();
    let images = images(&case);
    let composited =
        reference::render(&case.gaussians, &case.view, &RenderOptions { exposure: None, ..case.options.clone() });
    let gradient = Exposure::gradient(&composited.unwrap().rgb, &images.rgb).unwrap();
    let numbers =
        |exposure: &Exposure| -> Vec<f64> { exposure.matrix.into_iter().flatten().chain(exposure.offset).collect() };
    let of_numbers = |numbers: &[f64]| Exposure {
        matrix: [0, 3, 6].map(|row| [numbers[row], numbers[row + 1], numbers[row + 2]]),
        offset: [numbers[9], numbers[10], numbers[11]],
    };
    let at = |numbers: &[f64]| {
        let options = RenderOptions { exposure: Some(of_numbers(numbers)), ..case.options.clone() };
        loss(&reference::render(&case.gaussians, &case.view, &options).unwrap(), &images)
    };
    for (entry, analytic) in numbers(&gradient).into_iter().enumerate() {
        let moved = |step: f64| {
            let mut numbers = numbers(&exposure);
            numbers[entry] += step;
            at(&numbers)
        };
        // The loss is linear in every entry.
        DIFFERENCES.assert([analytic], [(moved(0.5) - moved(-0.5)) / 1.0], &format!("entry {entry}"));
    }
    assert!(matches!(Exposure::gradient(&[[0.0f64; 3]; 2], &images.rgb), Err(SplatError::Length { .. })));
}

/// The gradient of the background passes through the exposure.
#[test]
fn background_gradient_passes_through_exposure() {
    let case = exposed();
    let images = images(&case);
    let gradient = reference::backward(&case.gaussians, &case.view, &case.options, &images).unwrap();
    for channel in 0..3 {
        let moved = |step: f64| {
            let mut options = case.options.clone();
            options.background[channel] += step;
            loss(&reference::render(&case.gaussians, &case.view, &options).unwrap(), &images)
        };
        DIFFERENCES.assert([gradient.background[channel]], [moved(0.5) - moved(-0.5)], "background");
    }
}
