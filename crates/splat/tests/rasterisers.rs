//! Images of published rasterisers: `fixtures/make_rasterisers.py` emulates them in NumPy.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "common/stored.rs"]
mod stored;

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, PixelIntrinsics};
use atsplat_numeric::Tolerance;
use atsplat_splat::cpu::{CpuOptions, CpuRenderer, SimdLevel};
use atsplat_splat::{
    GaussianParts, Gaussians, ReferenceRenderer, RenderOptions, Renderer, RendererConstants, View, reference,
};
use stored::Stored;

fn renderers() -> Vec<Box<dyn Renderer>> {
    let mut all: Vec<Box<dyn Renderer>> = vec![Box::new(ReferenceRenderer)];
    for simd in SimdLevel::available() {
        all.push(Box::new(CpuRenderer::new(CpuOptions { simd, ..CpuOptions::default() })));
    }
    all
}

fn view(size: ImageSize, [fx, fy, cx, cy]: [f64; 4]) -> View {
    let intrinsics = PixelIntrinsics::new(fx, fy, cx, cy).unwrap().normalized_from_pixel(size).unwrap();
    View { camera: Camera::pinhole(CameraFromWorld::IDENTITY, intrinsics), size }
}

fn options(preset: &str) -> RenderOptions {
    RenderOptions { constants: RendererConstants::named(preset).unwrap(), ..RenderOptions::default() }
}

/// 150 Gaussians of degree 3 and a principal point off the centre. Images are stored in steps of 1/65535, of which rounding in
/// f32 changes none by more than a tenth. A pixel at a threshold may change by a grey level of 8 bits with another order of
/// operations; of diff-gaussian-rasterization, whose images protocols publish, none does.
#[test]
fn images_match_published_rasterisers() {
    const LEVEL: f64 = 1.0 / 255.0;
    const ROUNDING: f64 = 0.6 / 65_535.0;
    let stored = Stored::read("rasterisers/scene.safetensors");
    let gaussians = Gaussians::new(GaussianParts {
        means: stored.rows("means"),
        quaternions: stored.rows("quaternions"),
        log_scales: stored.rows("log_scales"),
        opacity_logits: stored.values("opacity_logits"),
        sh_degree: 3,
        sh: stored.rows("sh"),
        ..GaussianParts::default()
    })
    .unwrap();
    let view = view(ImageSize { width: 100, height: 70 }, stored.rows("intrinsics")[0].map(f64::from));
    let background = stored.rows("background")[0].map(f64::from);
    for preset in ["inria", "pixelsplat-family", "gsplat-1.5", "gsplat-1.6"] {
        let bytes = stored.bytes(preset).as_chunks().0;
        let expected: Vec<f64> = bytes.iter().map(|two| f64::from(u16::from_le_bytes(*two)) / 65_535.0).collect();
        for mut renderer in renderers() {
            let what = format!("{preset}, {}", renderer.name());
            let options = RenderOptions { background, ..options(preset) };
            let rendering = renderer.render(&gaussians, &view, &options).unwrap();
            let found = rendering.rgb.as_flattened().iter().map(|channel| f64::from(*channel).clamp(0.0, 1.0));
            assert_eq!(found.len(), expected.len(), "{what}");
            let pairs: Vec<_> = found.zip(expected.iter().copied()).collect();
            let beyond =
                |bound| pairs.iter().filter(|pair| !Tolerance::absolute(bound).accepts(pair.0, pair.1)).count();
            let allowed = if preset.starts_with("gsplat") { expected.len() / 10_000 } else { 0 };
            let (others, far) = (beyond(ROUNDING), beyond(LEVEL));
            assert!(others <= allowed && far == 0, "{what}: {others} samples differ, {far} by more than a grey level");
        }
    }
}

/// A black layer in front of a white one, both of the largest alpha. In f32, the second would leave `(1 − 0.99)²`, less than
/// 1e-4, and the pixel stops before it; with 0.01², which is more in f64, it would be drawn.
#[test]
fn a_pixel_stops_at_two_saturated_gaussians() {
    let gaussians = Gaussians::new(GaussianParts {
        means: vec![[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]],
        quaternions: vec![[1.0, 0.0, 0.0, 0.0]; 2],
        log_scales: vec![[3.0, 3.0, -3.0]; 2],
        opacity_logits: vec![12.0; 2],
        sh: vec![[-1.8; 3], [1.8; 3]],
        ..GaussianParts::default()
    })
    .unwrap();
    let view = view(ImageSize { width: 3, height: 2 }, [3.0, 3.0, 1.5, 1.0]);
    for preset in ["inria", "pixelsplat-family", "gsplat-1.6"] {
        let options = options(preset);
        for mut renderer in renderers() {
            let what = format!("{preset}, {}", renderer.name());
            let rendering = renderer.render(&gaussians, &view, &options).unwrap();
            Tolerance::EXACT.assert(rendering.rgb.as_flattened().iter().map(|one| f64::from(*one)), [0.0; 18], &what);
            let alphas = rendering.alpha.iter().map(|alpha| f64::from(*alpha));
            Tolerance::absolute(1e-6).assert(alphas, [0.99; 6], &what);
        }
        // Where an error may let the second through is known, too.
        let jumps = reference::jumps(&gaussians, &view, &options, 1e-12).unwrap();
        assert!(jumps.iter().all(|jump| jump.share <= 0.0), "{preset}: {jumps:?}");
        let jumps = reference::jumps(&gaussians, &view, &options, 1e-6).unwrap();
        assert!(jumps.iter().all(|jump| jump.share > 0.0), "{preset}: {jumps:?}");
    }
}
