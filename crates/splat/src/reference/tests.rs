use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};
use atsplat_numeric::{Extremes as _, Tolerance};
use glam::{DMat3, DQuat, DVec3};

use super::*;
use crate::stress::parameter::{Parameter, moved};
use crate::{Channels, GaussianParts, RasterMode, RendererConstants, StoppedGradients};

/// A few soft Gaussians in front of the camera, using all fields. Every value is a multiple of 2⁻¹², so that adding a
/// step is exact in f32.
fn scene(degree: u8) -> Gaussians {
    let coefficients = crate::sh_coefficients(degree);
    let even = |value: f32| (value * 4096.0).round() / 4096.0;
    let wave = |n: usize, phase: f32| (n as f32 * 1.37 + phase).sin();
    let count = 6;
    Gaussians::new(GaussianParts {
        means: (0..count).map(|n| [0.5 * wave(n, 0.0), 0.4 * wave(n, 1.0), 2.5 + 0.4 * n as f32].map(even)).collect(),
        quaternions: (0..count).map(|n| [1.5, wave(n, 2.0), wave(n, 3.0), wave(n, 4.0)].map(even)).collect(),
        log_scales: (0..count)
            .map(|n| [-1.6 + 0.3 * wave(n, 5.0), -1.3, -2.0 + 0.5 * wave(n, 6.0)].map(even))
            .collect(),
        opacity_logits: (0..count).map(|n| even(-0.3 + wave(n, 7.0))).collect(),
        sh_degree: degree,
        sh: (0..count * coefficients)
            .map(|n| [0.3 + 0.2 * wave(n, 8.0), 0.25 + 0.2 * wave(n, 9.0), 0.3 + 0.1 * wave(n, 10.0)].map(even))
            .collect(),
        scalars: Some((0..count).map(|n| even(1.0 + wave(n, 11.0))).collect()),
        filter_3d: Some((0..count).map(|n| 0.02 + 0.01 * n as f32).collect()),
    })
    .unwrap()
}

fn view(distortion: Distortion) -> View {
    let rotation = DMat3::from_rotation_y(0.1) * DMat3::from_rotation_x(-0.07);
    View {
        camera: Camera {
            camera_from_world: CameraFromWorld::new(rotation, DVec3::new(0.05, -0.02, 0.1)).unwrap(),
            intrinsics: NormalizedIntrinsics::new(0.9, 1.1, 0.47, 0.53).unwrap(),
            distortion,
        },
        size: ImageSize { width: 22, height: 18 },
    }
}

/// No thresholds: the function is smooth, and its gradient can be compared with differences.
fn smooth() -> RenderOptions {
    let constants =
        RendererConstants { min_alpha: 1e-12, min_transmittance: 0.0, max_alpha: 1.0, ..RendererConstants::default() };
    RenderOptions {
        constants,
        background: [0.2, 0.5, 0.1],
        channels: Channels { depth: true, scalar: true, median_depth: false },
        ..RenderOptions::default()
    }
}

/// Image gradients that vary from pixel to pixel.
fn image_gradients(view: &View) -> ImageGradients<f64> {
    let wave = |phase: f64| (0..view.pixels()).map(move |n| (n as f64 * 0.7 + phase).sin()).collect::<Vec<_>>();
    let (red, green, blue) = (wave(0.0), wave(1.0), wave(2.0));
    ImageGradients {
        rgb: red.into_iter().zip(green).zip(blue).map(|((r, g), b)| [r, g, b]).collect(),
        alpha: Some(wave(3.0)),
        depth: Some(wave(4.0)),
        scalar: Some(wave(5.0)),
    }
}

fn loss(gaussians: &Gaussians, view: &View, options: &RenderOptions) -> f64 {
    let rendering = render_unchecked(gaussians, view, options).unwrap();
    let images = image_gradients(view);
    let dot = |a: &[f64], b: &Option<Vec<f64>>| a.iter().zip(b.iter().flatten()).map(|(a, b)| a * b).sum::<f64>();
    let rgb: f64 = rendering.rgb.iter().zip(&images.rgb).flat_map(|(a, b)| a.iter().zip(b)).map(|(a, b)| a * b).sum();
    rgb + dot(&rendering.alpha, &images.alpha)
        + dot(&rendering.depth.unwrap(), &images.depth)
        + dot(&rendering.scalar.unwrap(), &images.scalar)
}

#[expect(clippy::cast_possible_truncation, reason = "a step is a power of two")]
const fn exact_f32(step: f64) -> f32 {
    step as f32
}

/// Compares every gradient with extrapolated central differences.
fn check(gaussians: &Gaussians, view: &View, options: &RenderOptions, what: &str) {
    let gradients = backward_unchecked(gaussians, view, options, &image_gradients(view)).unwrap();
    let scale = gradients.means.iter().flatten().fold(0.0f64, |most, g| most.maximum_of(g.abs()));
    let others = (0..gaussians.len()).flat_map(|position| Parameter::of_gaussian(gaussians, position));
    let others = others.filter(|parameter| !matches!(parameter, Parameter::Sh(..)));
    let sh = (0..gaussians.parts().sh.len()).flat_map(|at| [0, 1, 2].map(|channel| Parameter::Sh(at, channel)));
    for parameter in others.chain(sh).chain((0..6).map(Parameter::Pose)) {
        let analytic = parameter.gradient_in(&gradients).unwrap();
        let numeric = differences(|step| {
            if let Parameter::Pose(axis) = parameter {
                loss(gaussians, &moved(view, axis, step).unwrap(), options)
            } else {
                let mut parts = gaussians.parts().clone();
                *parameter.slot(&mut parts).unwrap() += exact_f32(step);
                loss(&Gaussians::new(parts).unwrap(), view, options)
            }
        });
        let floor = if matches!(parameter, Parameter::Pose(_)) { 1e-3 } else { 1e-3 * scale };
        let error = (numeric - analytic).abs() / (analytic.abs() + floor);
        assert!(
            error < 1e-6,
            "{what}, {parameter:?}: analytic {analytic}, numeric {numeric}, relative error {error:.2e}"
        );
    }
}

/// Richardson extrapolation of central differences with three step sizes.
fn differences(loss_at: impl Fn(f64) -> f64) -> f64 {
    let central = |step: f64| (loss_at(step) - loss_at(-step)) / (2.0 * step);
    let [wide, middle, narrow] = [1.0 / 512.0, 1.0 / 1024.0, 1.0 / 2048.0].map(central);
    let (coarse, fine) = ((4.0 * middle - wide) / 3.0, (4.0 * narrow - middle) / 3.0);
    (16.0 * fine - coarse) / 15.0
}

#[test]
fn gradients_match_central_differences() {
    for degree in [0, 3, 4] {
        check(&scene(degree), &view(Distortion::None), &smooth(), &format!("degree {degree}"));
    }
}

#[test]
fn gradients_match_with_antialiasing() {
    let options = RenderOptions { mode: RasterMode::Antialiased, ..smooth() };
    check(&scene(1), &view(Distortion::None), &options, "antialiased");
}

#[test]
fn gradients_match_through_a_lens() {
    let lens = Distortion::OpenCv { k1: -0.12, k2: 0.03, k3: 0.002, p1: 0.004, p2: -0.003 };
    check(&scene(1), &view(lens), &smooth(), "lens");
}

#[test]
fn gradients_match_in_e3nn_axes() {
    let constants = RendererConstants { sh_axes: crate::ShAxes::E3nn, ..smooth().constants };
    check(&scene(3), &view(Distortion::None), &RenderOptions { constants, ..smooth() }, "e3nn");
}

#[test]
fn a_stopped_scalar_has_a_gradient_with_respect_to_scalars_only() {
    let (gaussians, view) = (scene(0), view(Distortion::None));
    let all = image_gradients(&view);
    let without = ImageGradients { scalar: None, ..all.clone() };
    let stopped =
        RenderOptions { gradients: StoppedGradients { scalar_stops: true, directions_stop: false }, ..smooth() };
    let with_stop = backward_unchecked(&gaussians, &view, &stopped, &all).unwrap();
    let not_rendered = backward_unchecked(&gaussians, &view, &smooth(), &without).unwrap();
    assert_eq!(Gradients { scalars: not_rendered.scalars.clone(), ..with_stop.clone() }, not_rendered);
    let free = backward_unchecked(&gaussians, &view, &smooth(), &all).unwrap();
    assert_eq!(with_stop.scalars, free.scalars);
}

/// Three opaque layers at one pixel: the third would reduce the transmittance to 1e-5 and is not drawn.
#[test]
fn a_pixel_stops_before_the_gaussian_that_would_finish_it() {
    let layer = |depth: f32, logit: f32, sh: f32| (depth, logit, sh);
    let layers = [layer(1.0, 4.595_12, 1.0), layer(2.0, 4.595_12, 0.5), layer(3.0, 2.197_225, -1.0)];
    let gaussians = Gaussians::new(GaussianParts {
        means: layers.map(|(depth, ..)| [0.0, 0.0, depth]).to_vec(),
        quaternions: vec![[1.0, 0.0, 0.0, 0.0]; 3],
        log_scales: vec![[3.0; 3]; 3],
        opacity_logits: layers.map(|(_, logit, _)| logit).to_vec(),
        sh: layers.map(|(.., sh)| [sh; 3]).to_vec(),
        ..GaussianParts::default()
    })
    .unwrap();
    let camera = Camera::pinhole(CameraFromWorld::IDENTITY, NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap());
    let view = View { camera, size: ImageSize { width: 1, height: 1 } };
    // Opacities 0.99, 0.99, 0.9: transmittance 1, 1e-2, 1e-4 — at the limit, so the second is not drawn.
    let constants = RendererConstants { min_transmittance: 1.001e-4, ..RendererConstants::default() };
    let rendering = render(&gaussians, &view, &RenderOptions { constants, ..RenderOptions::default() }).unwrap();
    Tolerance::absolute(1e-5).assert(rendering.alpha.clone(), [0.99], "the second would leave 1e-4");
    let constants = RendererConstants { min_transmittance: 0.999e-4, ..RendererConstants::default() };
    let rendering = render(&gaussians, &view, &RenderOptions { constants, ..RenderOptions::default() }).unwrap();
    Tolerance::absolute(1e-6).assert(rendering.alpha, [0.9999], "the third would leave 1e-5");
    assert_eq!(rendering.counts.drawn, 3);
}

mod lenses;
