//! Images and gradients of four Gaussians against gsplat's (`fixtures/gsplat/README.md`).

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "common/stored.rs"]
mod stored;

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_numeric::Tolerance;
use atsplat_splat::cpu::{CpuOptions, CpuRenderer, SimdLevel};
use atsplat_splat::gpu::{AdapterChoice, GpuOptions, GpuRenderer};
use atsplat_splat::{
    GaussianParts, Gaussians, Gradients, ImageGradients, RenderOptions, Renderer, RendererConstants, StoppedGradients,
    View, reference,
};
use atsplat_tests::skip_without_graphics;
use glam::{DMat3, DVec3};
use stored::Stored;

fn tiny_case() -> Stored {
    Stored::read("gsplat/tiny_case.safetensors")
}

fn gaussians(stored: &Stored) -> Gaussians {
    Gaussians::new(GaussianParts {
        means: stored.rows("means"),
        quaternions: stored.rows("quats"),
        log_scales: stored.rows("scales"),
        opacity_logits: stored.values("opacities"),
        sh_degree: 3,
        sh: stored.rows("coeffs"),
        ..GaussianParts::default()
    })
    .unwrap()
}

fn view() -> View {
    const SIZE: ImageSize = ImageSize { width: 123, height: 82 };
    let pose = CameraFromWorld::new(DMat3::IDENTITY, -DVec3::new(0.123, 0.456, -8.0)).unwrap();
    let fx = 0.5 * f64::from(SIZE.width);
    let intrinsics =
        NormalizedIntrinsics::new(fx / f64::from(SIZE.width), fx / f64::from(SIZE.height), 0.5, 0.5).unwrap();
    View { camera: Camera::pinhole(pose, intrinsics), size: SIZE }
}

fn options() -> RenderOptions {
    RenderOptions {
        constants: RendererConstants::named("gsplat-1.5").unwrap(),
        gradients: StoppedGradients { directions_stop: true, scalar_stops: false },
        ..RenderOptions::default()
    }
}

/// Largest difference, and that relative to the largest expected value.
fn max_difference(actual: impl IntoIterator<Item = f64>, expected: &[f32]) -> (f64, f64) {
    let (mut difference, mut largest, mut count) = (0.0f64, 0.0f64, 0);
    for (actual, expected) in actual.into_iter().zip(expected.iter().map(|value| f64::from(*value))) {
        let apart = (actual - expected).abs();
        assert!(apart.is_finite());
        if apart > difference {
            difference = apart;
        }
        if expected.abs() > largest {
            largest = expected.abs();
        }
        count += 1;
    }
    assert_eq!(count, expected.len());
    (difference, difference / largest)
}

#[test]
fn reference_images_match_gsplat() {
    let stored = tiny_case();
    let rendering = reference::render(&gaussians(&stored), &view(), &options()).unwrap();
    let rgba = rendering.rgb.iter().zip(&rendering.alpha).flat_map(|(rgb, alpha)| [rgb[0], rgb[1], rgb[2], *alpha]);
    let (difference, _) = max_difference(rgba, &stored.values("out_img"));
    Tolerance::absolute(2e-6).assert([difference], [0.0], "image");
}

#[test]
fn reference_projections_match_gsplat() {
    let stored = tiny_case();
    let projected = reference::project(&gaussians(&stored), &view(), &options()).unwrap();
    let drawn: Vec<_> = projected.into_iter().map(Option::unwrap).collect();
    let (centres, _) = max_difference(drawn.iter().flat_map(|splat| splat.centre), &stored.values("xys"));
    Tolerance::absolute(1e-5).assert([centres], [0.0], "centres in pixels");
    let (conics, _) = max_difference(drawn.iter().flat_map(|splat| splat.conic), &stored.values("conics"));
    Tolerance::absolute(1e-6).assert([conics], [0.0], "conics");
    let (depths, _) = max_difference(drawn.iter().map(|splat| splat.depth), &stored.values("depths"));
    Tolerance::absolute(1e-6).assert([depths], [0.0], "depths");
}

fn image_gradients(stored: &Stored) -> ImageGradients<f32> {
    let d_image = stored.rows::<4>("v_out_img");
    ImageGradients {
        rgb: d_image.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect(),
        alpha: Some(d_image.iter().map(|[.., alpha]| *alpha).collect()),
        depth: None,
        scalar: None,
    }
}

fn assert_gradients<T: Copy + Into<f64>>(gradients: &Gradients<T>, stored: &Stored, bound: f64, what: &str) {
    let cases = [
        ("v_means", gradients.means.as_flattened()),
        ("v_quats", gradients.quaternions.as_flattened()),
        ("v_scales", gradients.log_scales.as_flattened()),
        ("v_opacities", &gradients.opacity_logits),
        ("v_coeffs", gradients.sh.as_flattened()),
        ("v_xy", gradients.means_2d.as_flattened()),
        ("v_conics", gradients.conics.as_flattened()),
    ];
    for (name, actual) in cases {
        let (_, relative) = max_difference(actual.iter().map(|value| (*value).into()), &stored.values(name));
        Tolerance::absolute(bound).assert([relative], [0.0], &format!("{what}: {name}"));
    }
}

#[test]
fn reference_gradients_match_gsplat() {
    let stored = tiny_case();
    let images = image_gradients(&stored).map(f64::from);
    let gradients = reference::backward(&gaussians(&stored), &view(), &options(), &images).unwrap();
    assert_gradients(&gradients, &stored, 1e-4, "reference");
}

/// f32 pixels and gradients, with every instruction set and on the GPU.
#[test]
fn cpu_and_gpu_match_gsplat() {
    let stored = tiny_case();
    let mut renderers: Vec<Box<dyn Renderer>> = Vec::new();
    for simd in SimdLevel::available() {
        renderers.push(Box::new(CpuRenderer::new(CpuOptions { simd, ..CpuOptions::default() })));
    }
    match GpuRenderer::new(&AdapterChoice::Automatic, GpuOptions::default()) {
        Ok(gpu) => renderers.push(Box::new(gpu)),
        Err(error) => {
            skip_without_graphics("gsplat_case", error);
        }
    }
    for mut renderer in renderers {
        let rendering = renderer.render(&gaussians(&stored), &view(), &options()).unwrap();
        let rgba = rendering.rgb.iter().zip(&rendering.alpha).flat_map(|([r, g, b], alpha)| [*r, *g, *b, *alpha]);
        let (difference, _) = max_difference(rgba.map(f64::from), &stored.values("out_img"));
        Tolerance::absolute(1e-5).assert([difference], [0.0], "image");
        let gradients = renderer.backward(&gaussians(&stored), &view(), &options(), &image_gradients(&stored)).unwrap();
        assert_gradients(&gradients, &stored, 1e-3, &renderer.name());
    }
}
