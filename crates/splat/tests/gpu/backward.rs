use atsplat_camera::Distortion;
use atsplat_numeric::{Extremes as _, Tolerance};
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::gpu::Uploaded;
use atsplat_splat::{
    ClampedGradient, Extent, GaussianParts, Gaussians, GradientField, Gradients, RasterMode, RenderOptions, Renderer,
    RendererConstants, ShAxes, StoppedGradients, View, reference,
};
use proptest::prelude::*;

use crate::extreme::extreme;
use crate::scenes::{cloud, everything, filtered, gpu, image_gradients, narrow, view};

/// Lowers `min_alpha`, so that rounding cannot cross the threshold and only arithmetic is compared.
fn without_thresholds(constants: RendererConstants) -> RendererConstants {
    RendererConstants { min_alpha: 1e-5, ..constants }
}

fn check(gaussians: &Gaussians, view: &View, options: &RenderOptions, what: &str) {
    let Some(mut gpu) = gpu() else { return };
    let images = image_gradients(view);
    let expected = reference::backward(gaussians, view, options, &images).unwrap();
    let actual = gpu.backward(gaussians, view, options, &narrow(&images)).unwrap();
    assert!(gpu.backward(gaussians, view, options, &narrow(&images)).unwrap() == actual, "{what}: not deterministic");
    for ((name, actual), (_, expected)) in actual.map(f64::from).fields().into_iter().zip(expected.fields()) {
        assert_eq!(actual.len(), expected.len(), "{what}: {name}");
        let size = expected.iter().fold(0.0f64, |most, value| most.maximum_of(value.abs()));
        Tolerance::absolute(1e-4 * size).assert(
            actual.iter().copied(),
            expected.iter().copied(),
            &format!("{what}: {name}"),
        );
        // This does not test gradients that are small compared to the largest. Those of the pose are sums with
        // cancellation.
        if name == GradientField::Pose {
            continue;
        }
        let small = || actual.iter().zip(expected).filter(|(_, expected)| expected.abs() <= 0.01 * size);
        let norm = |numbers: &mut dyn Iterator<Item = f64>| numbers.map(|number| number * number).sum::<f64>().sqrt();
        let apart = norm(&mut small().map(|(actual, expected)| actual - expected));
        let whole = norm(&mut small().map(|(_, expected)| *expected));
        Tolerance::absolute(SMALL_GRADIENT_BOUND * whole).assert(
            [apart],
            [0.0],
            &format!("{what}: the small of {name}, {whole}"),
        );
    }
}

/// Largest error of the gradients below a hundredth of the largest, relative to their norm.
const SMALL_GRADIENT_BOUND: f64 = 1e-3;

#[test]
fn gradients_match_for_every_mode_rule_and_filter() {
    let gaussians = cloud(600, 2, 21);
    for mode in [RasterMode::Classic, RasterMode::Antialiased] {
        for gaussians in [&gaussians, &filtered(&gaussians)] {
            let constants = without_thresholds(RendererConstants::default());
            let what = format!("{mode:?}, filter {}", gaussians.parts().filter_3d.is_some());
            check(gaussians, &view(61, 45), &RenderOptions { constants, mode, ..everything() }, &what);
        }
    }
    let inria = RendererConstants {
        sh_axes: ShAxes::E3nn,
        clamped_gradient: ClampedGradient::Inria,
        extent: Extent::Exact,
        ..RendererConstants::named("inria").unwrap()
    };
    check(
        &gaussians,
        &view(61, 45),
        &RenderOptions { constants: without_thresholds(inria), ..everything() },
        "inria's rules",
    );
}

#[test]
fn gradients_match_for_every_degree_and_stop() {
    for degree in 0..=4 {
        let gradients = StoppedGradients { scalar_stops: degree % 2 == 1, directions_stop: degree == 2 };
        let constants = without_thresholds(RendererConstants::default());
        let options = RenderOptions { constants, gradients, max_sh_degree: 3, ..everything() };
        check(&cloud(300, degree, 9), &view(33, 29), &options, &format!("degree {degree}"));
    }
}

#[test]
fn gradients_match_for_every_lens() {
    let mut view = view(61, 45);
    for distortion in [
        Distortion::OpenCv { k1: -0.1, k2: 0.02, k3: -0.003, p1: 0.003, p2: -0.002 },
        Distortion::Fisheye { k: [0.02, -0.01, 0.003, -0.001] },
    ] {
        view.camera.distortion = distortion;
        let constants = without_thresholds(RendererConstants::default());
        let options = RenderOptions { constants, ..everything() };
        check(&cloud(500, 1, 23), &view, &options, &format!("{distortion:?}"));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    /// As on the CPU: image gradients near the limits of f32, bright Gaussians, a strong exposure.
    #[test]
    fn gradients_never_overflow(magnitude in prop_oneof![Just(3e38f32), Just(1e-38), 1e-30f32..3e38], bright: bool, gain: bool) {
        let Some(mut gpu) = gpu() else { return Ok(()) };
        let (gaussians, view, options, images) = extreme(magnitude, bright, gain);
        let gradients = gpu.backward(&gaussians, &view, &options, &images).unwrap();
        prop_assert_eq!(gradients.non_finite(), 0);
        prop_assert!(gradients.means.as_flattened().iter().any(|value| value.abs() > 0.0));
    }
}

/// What density control needs, against the CPU's, which is tested pixel by pixel: culled Gaussians are not drawn, and the two
/// directions differ.
#[test]
fn absolute_gradients_and_drawn_gaussians_match_the_cpu() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (cloud(600, 1, 5), view(61, 45));
    let constants = without_thresholds(RendererConstants::default());
    let options = RenderOptions { constants, background: [0.1, 0.6, 0.3], ..RenderOptions::default() };
    let mut images = narrow(&image_gradients(&view));
    let device = gpu.upload(&gaussians).unwrap();
    let uploaded = Uploaded { host: &gaussians, device: &device };
    assert!(gpu.backward_with_screen(uploaded, &view, &options, &images, true).is_err(), "with depth");
    (images.depth, images.scalar) = (None, None);
    let mut recording = CpuRenderer::default().record(&gaussians, &view, &options).unwrap();
    let (mut of_cpu, mut expected) = (Gradients::default(), Vec::new());
    recording.backward_with_absolute(&images, &mut of_cpu, &mut expected).unwrap();
    let drawn: Vec<u32> = recording.drawn().collect();
    assert!(drawn.len() > 100 && drawn.len() < 600, "{}", drawn.len());

    assert_eq!(
        gpu.render_uploaded(&device, &view, &options).unwrap().rgb,
        gpu.render(&gaussians, &view, &options).unwrap().rgb
    );
    let others = Uploaded { host: &cloud(599, 1, 5), device: &device };
    assert!(gpu.backward_with_screen(others, &view, &options, &images, true).is_err(), "a copy of other Gaussians");
    let signed = gpu.backward(&gaussians, &view, &options, &images).unwrap();
    for (absolute, expected) in [(true, expected), (false, vec![[0.0; 2]; 600])] {
        let (gradients, screen) = gpu.backward_with_screen(uploaded, &view, &options, &images, absolute).unwrap();
        assert!(gradients == signed, "{absolute}: the signed gradients change");
        assert_eq!(screen.drawn, drawn, "{absolute}");
        let expected: Vec<f64> = expected.as_flattened().iter().copied().map(f64::from).collect();
        let of_largest = Tolerance::of_largest(1e-6, expected.iter().copied());
        let found = screen.absolute_2d.as_flattened().iter().copied().map(f64::from);
        Tolerance { relative: 1e-4, ..of_largest }.assert(found, expected, "absolute gradients");
    }
}

/// Without scalars, with a colour gradient only, without Gaussians; a culled Gaussian has zero gradients.
#[test]
fn absent_inputs_have_no_gradient() {
    let Some(mut gpu) = gpu() else { return };
    let view = view(20, 30);
    let mut parts = cloud(50, 0, 3).into_parts();
    parts.scalars = None;
    parts.means[7] = [0.0, 0.0, -5.0];
    let gaussians = Gaussians::new(parts).unwrap();
    let mut images = narrow(&image_gradients(&view));
    (images.alpha, images.depth, images.scalar) = (None, None, None);
    let gradients = gpu.backward(&gaussians, &view, &everything(), &images).unwrap();
    assert!(gradients.scalars.is_empty());
    assert!(
        gradients.means[7].iter().chain(&gradients.quaternions[7]).chain(&gradients.sh[7]).all(|v| v.to_bits() == 0)
    );
    assert!(gradients.means.iter().flatten().any(|value| *value != 0.0));
    let none = Gaussians::new(GaussianParts::default()).unwrap();
    let gradients = gpu.backward(&none, &view, &everything(), &images).unwrap();
    let sum: f32 = images.rgb.iter().map(|rgb| rgb[0]).sum();
    assert!(gradients.means.is_empty());
    Tolerance::absolute(1e-3).assert([f64::from(gradients.background[0])], [f64::from(sum)], "background");
}
