//! Image gradients of any magnitude.

use super::extreme::extreme;
use super::*;
use atsplat_camera::{ImageSize, NormalizedIntrinsics};
use atsplat_numeric::{Extremes as _, Tolerance};
use proptest::prelude::*;

fn times(images: &ImageGradients<f32>, factor: f32) -> ImageGradients<f32> {
    images.map(|value| value * factor)
}

/// Compares values well within f32's range; others may have been clamped.
fn assert_scaled(scaled: &Gradients<f32>, plain: &Gradients<f32>, factor: f64) {
    for ((name, scaled), (_, plain)) in scaled.fields().into_iter().zip(plain.fields()) {
        for (scaled, plain) in scaled.iter().zip(plain) {
            let expected = f64::from(*plain) * factor;
            if expected.abs() > 1e-32 && expected.abs() < 1e34 {
                Tolerance::EXACT.assert([f64::from(*scaled)], [expected], name.name());
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Scaling the image gradients by a power of two scales all gradients, bit for bit.
    #[test]
    fn scaling_by_powers_of_two_is_exact(exponent in -100i32..126) {
        let (gaussians, view) = (cloud(200, 1, 91), view(33, 21));
        let images = narrow(&image_gradients(&view));
        let factor = f64::from(exponent).exp2();
        let plain = CpuRenderer::default().backward(&gaussians, &view, &everything(), &images).unwrap();
        let scaled = times(&images, to_f32(factor));
        let scaled = CpuRenderer::default().backward(&gaussians, &view, &everything(), &scaled).unwrap();
        prop_assert_eq!(scaled.non_finite(), 0);
        assert_scaled(&scaled, &plain, factor);
    }

    #[test]
    fn gradients_never_overflow(magnitude in prop_oneof![Just(3e38f32), Just(2e38), Just(1e-38), 1e-30f32..3e38], bright: bool, gain: bool) {
        let (gaussians, view, options, images) = extreme(magnitude, bright, gain);
        let gradients = CpuRenderer::default().backward(&gaussians, &view, &options, &images).unwrap();
        prop_assert_eq!(gradients.non_finite(), 0);
        let most = gradients.means.as_flattened().iter().fold(0.0f32, |most, value| most.maximum_of(value.abs()));
        prop_assert!(most > 0.0);
    }
}

#[test]
fn rejects_non_finite_image_gradients() {
    let (gaussians, view) = (cloud(20, 0, 93), view(9, 7));
    for (pixel, value) in [(0, f32::NAN), (13, f32::INFINITY), (62, f32::NEG_INFINITY)] {
        let mut images = narrow(&image_gradients(&view));
        images.rgb[pixel][2] = value;
        let outcome = CpuRenderer::default().backward(&gaussians, &view, &everything(), &images);
        let found =
            matches!(outcome, Err(SplatError::NonFinite { image: "rgb gradient", pixel: at, .. }) if at == pixel);
        assert!(found, "{outcome:?}");
        let wide = images.map(f64::from);
        let outcome = reference::backward(&gaussians, &view, &everything(), &wide);
        assert!(matches!(outcome, Err(SplatError::NonFinite { .. })));
    }
    let mut images = narrow(&image_gradients(&view));
    images.depth.iter_mut().flatten().for_each(|value| *value = f32::INFINITY);
    let outcome = CpuRenderer::default().backward(&gaussians, &view, &everything(), &images);
    assert!(matches!(outcome, Err(SplatError::NonFinite { image: "depth gradient", pixel: 0, .. })), "{outcome:?}");
}

/// Half a pixel wide and across a large image: sums of squares of columns and rows do not tell, in f32, how far pixels are from its
/// axis.
#[test]
fn gradients_of_a_needle_across_a_large_image_match_the_reference() {
    let gaussians = single(96, [0.0, 0.0, 2.0], [0.92388, 0.0, 0.0, 0.38268], [1.36, -7.04, -7.04], 0.5);
    let camera = Camera::pinhole(CameraFromWorld::IDENTITY, NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap());
    let view = View { camera, size: ImageSize { width: 512, height: 512 } };
    let constants = RendererConstants { min_alpha: 1e-5, ..RendererConstants::default() };
    let options = RenderOptions { constants, ..RenderOptions::default() };
    let rgb = (0..view.pixels()).map(|pixel| [(0.7 * pixel as f64).sin(); 3]).collect();
    let images = ImageGradients { rgb, alpha: None, depth: None, scalar: None };
    let expected = reference::backward(&gaussians, &view, &options, &images).unwrap();
    for simd in SimdLevel::available().into_iter().chain([SimdLevel::Lanes4, SimdLevel::Lanes16]) {
        let mut renderer = CpuRenderer::new(CpuOptions { simd, ..CpuOptions::default() });
        let actual = renderer.backward(&gaussians, &view, &options, &narrow(&images)).unwrap();
        assert_gradients_close(&actual, &expected, &format!("{simd:?}"));
    }
}

/// An opacity that f64 rounds to 1 still has a gradient with respect to its logit, if clamps let it pass.
#[test]
fn saturated_opacities_have_a_gradient() {
    let mut parts = cloud(1, 0, 94).into_parts();
    parts.means = vec![[0.0, 0.0, 3.0]];
    parts.opacity_logits = vec![40.0];
    let (gaussians, view) = (Gaussians::new(parts).unwrap(), view(33, 21));
    let options = RenderOptions { constants: RendererConstants::named("inria").unwrap(), ..everything() };
    let images = image_gradients(&view);
    let expected = reference::backward(&gaussians, &view, &options, &images).unwrap().opacity_logits[0];
    let actual = CpuRenderer::default().backward(&gaussians, &view, &options, &narrow(&images)).unwrap();
    assert!(expected.abs() > 1e-20);
    Tolerance::relative(1e-3).assert([f64::from(actual.opacity_logits[0])], [expected], "logit");
}
