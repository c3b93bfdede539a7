use atsplat_camera::{Camera, CameraFromWorld, Distortion};
use atsplat_numeric::Tolerance;
use atsplat_tests::on_threads;
use glam::{DMat3, DVec3};

use super::*;
use crate::{Channels, Gradients, ImageGradients, RasterMode, RendererConstants, reference};
use cloud::{cloud, everything, image_gradients, narrow, view};

fn rendered(gaussians: &Gaussians, view: &View, options: &RenderOptions, cpu: CpuOptions) -> Rendering<f32> {
    CpuRenderer::new(cpu).render(gaussians, view, options).unwrap()
}

/// Sides of tiles in pixels.
const TILES: [u32; 3] = [16, 32, 64];

fn with_tiles(cpu: CpuOptions, tile: u32) -> CpuRenderer {
    CpuRenderer { tile, ..CpuRenderer::new(cpu) }
}

/// One Gaussian, with the colour and scalar of the cloud of a seed.
fn single(seed: u32, mean: [f32; 3], quaternion: [f32; 4], log_scales: [f32; 3], logit: f32) -> Gaussians {
    let mut parts = cloud(1, 0, seed).into_parts();
    parts.means = vec![mean];
    parts.quaternions = vec![quaternion];
    parts.log_scales = vec![log_scales];
    parts.opacity_logits = vec![logit];
    Gaussians::new(parts).unwrap()
}

/// Number of values that differ by more than `bound`, and the largest difference.
fn beyond(actual: &[f32], expected: &[f64], bound: f64) -> (usize, f64) {
    assert_eq!(actual.len(), expected.len());
    let mut largest = 0.0f64;
    let mut count = 0;
    for (actual, expected) in actual.iter().zip(expected) {
        let difference = (f64::from(*actual) - expected).abs();
        assert!(difference.is_finite());
        count += usize::from(difference > bound);
        if difference > largest {
            largest = difference;
        }
    }
    (count, largest)
}

/// A few pixels may fall on the other side of a threshold, and change by 1/255 of a Gaussian.
fn assert_close(actual: &Rendering<f32>, expected: &Rendering<f64>, what: &str) {
    assert_eq!(actual.counts, expected.counts, "{what}");
    let flat32: Vec<f32> = actual.rgb.iter().flatten().copied().collect();
    let flat64: Vec<f64> = expected.rgb.iter().flatten().copied().collect();
    let (count, largest) = beyond(&flat32, &flat64, 1e-5);
    assert!(
        count * 1000 <= flat32.len() && largest < 0.01,
        "{what}: {count} of {} samples, {largest:.2e}",
        flat32.len()
    );
    let (count, largest) = beyond(&actual.alpha, &expected.alpha, 1e-5);
    assert!(count * 1000 <= actual.alpha.len() && largest < 0.01, "{what}: alpha {count}, {largest:.2e}");
    assert_eq!(actual.median_depth.is_some(), expected.median_depth.is_some(), "{what}");
    for (actual, expected) in [(&actual.depth, &expected.depth), (&actual.scalar, &expected.scalar)] {
        assert_eq!(actual.is_some(), expected.is_some(), "{what}");
        if let (Some(actual), Some(expected)) = (actual, expected) {
            let (count, largest) = beyond(actual, expected, 1e-4);
            assert!(count * 1000 <= actual.len() && largest < 0.1, "{what}: channel {count}, {largest:.2e}");
        }
    }
    if let (Some(actual), Some(expected)) = (&actual.median_depth, &expected.median_depth) {
        let (count, _) = beyond(actual, expected, 1e-4);
        assert!(count * 1000 <= actual.len(), "{what}: median {count}");
    }
}

#[test]
fn pixels_match_the_reference() {
    let (gaussians, view) = (cloud(3000, 3, 7), view(97, 61));
    for preset in RendererConstants::preset_names() {
        for mode in [RasterMode::Classic, RasterMode::Antialiased] {
            let constants = RendererConstants::named(preset).unwrap();
            let options = RenderOptions { constants, mode, ..everything() };
            let expected = reference::render(&gaussians, &view, &options).unwrap();
            for simd in SimdLevel::available() {
                let cpu = CpuOptions { simd, ..CpuOptions::default() };
                let actual = rendered(&gaussians, &view, &options, cpu);
                assert_close(&actual, &expected, &format!("{preset} {mode:?} {simd:?}"));
            }
        }
    }
}

#[test]
fn a_lens_matches_the_reference() {
    let (gaussians, mut view) = (cloud(1000, 1, 3), view(64, 48));
    view.camera.distortion = Distortion::OpenCv { k1: -0.1, k2: 0.02, k3: 0.0, p1: 0.003, p2: -0.002 };
    let expected = reference::render(&gaussians, &view, &everything()).unwrap();
    let actual = rendered(&gaussians, &view, &everything(), CpuOptions::default());
    assert_close(&actual, &expected, "lens");
}

/// The square of the needle's slope overflows f32.
#[test]
fn an_endless_oblique_needle_has_no_holes() {
    let (view, options) = (view(200, 150), RenderOptions::default());
    for sine in [0.382_683_43, -0.382_683_43] {
        let gaussians = single(95, [0.0, 0.0, 2.0], [0.923_879_5, 0.0, 0.0, sine], [43.0, -5.0, -5.0], 3.0);
        let expected = reference::render(&gaussians, &view, &options).unwrap();
        let opaque = expected.alpha.iter().filter(|alpha| **alpha > 0.5).count();
        assert!(opaque > 150, "across the image: {opaque} pixels");
        for simd in SimdLevel::available() {
            for tile in TILES {
                let mut renderer = with_tiles(CpuOptions { simd, ..CpuOptions::default() }, tile);
                let actual = renderer.render(&gaussians, &view, &options).unwrap();
                let (_, largest) = beyond(&actual.alpha, &expected.alpha, 0.0);
                assert!(largest < 0.01, "{sine}, {simd:?}, tiles of {tile}: {largest}");
            }
        }
    }
}

#[test]
fn tiles_threads_and_instruction_sets_do_not_change_images() {
    let (gaussians, view) = (cloud(4000, 2, 11), view(131, 77));
    let expected = rendered(&gaussians, &view, &everything(), CpuOptions::default());
    for tile in TILES {
        for threads in [1, 3] {
            for simd in SimdLevel::with_fma() {
                let mut renderer = with_tiles(CpuOptions { simd, ..CpuOptions::default() }, tile);
                let actual = on_threads(threads, || renderer.render(&gaussians, &view, &everything()).unwrap());
                assert!(actual == expected, "tiles of {tile}, {threads} threads, {simd:?}");
            }
        }
    }
}

/// Invisible Gaussians have no effect, wherever they are in the list; and reused buffers carry nothing over.
#[test]
fn culled_gaussians_change_nothing() {
    let (gaussians, view) = (cloud(800, 0, 5), view(70, 50));
    let mut hidden = cloud(300, 0, 6).into_parts();
    for (at, mean) in hidden.means.iter_mut().enumerate() {
        match at % 4 {
            0 => mean[2] = -5.0,
            1 => mean[0] = f32::NAN,
            2 => hidden.opacity_logits[at] = -20.0,
            _ => hidden.log_scales[at] = [f32::INFINITY; 3],
        }
    }
    let hidden = Gaussians::new(hidden).unwrap();
    let mut renderer = CpuRenderer::default();
    let alone = renderer.render(&gaussians, &view, &everything()).unwrap();
    for both in [hidden.clone().merge(gaussians.clone()), gaussians.merge(hidden)] {
        let mut rendering = renderer.render(&both, &view, &everything()).unwrap();
        assert!(rendering.counts.invalid >= 150, "{:?}", rendering.counts);
        rendering.counts = alone.counts;
        assert!(rendering == alone);
    }
}

#[test]
fn an_empty_scene_gives_the_background() {
    let rendering = rendered(&Gaussians::default(), &view(33, 17), &everything(), CpuOptions::default());
    assert!(rendering.rgb.iter().all(|rgb| rgb.map(f32::to_bits) == [0.1f32, 0.6, 0.3].map(f32::to_bits)));
    assert!(rendering.alpha.iter().all(|alpha| alpha.to_bits() == 0));
}

#[test]
fn rejects_jobs_beyond_the_memory_limit() {
    let cpu = CpuOptions { memory_limit: 10_000, ..CpuOptions::default() };
    let outcome = CpuRenderer::new(cpu).render(&cloud(1000, 0, 1), &view(64, 64), &everything());
    assert!(matches!(outcome, Err(SplatError::Memory { limit: 10_000, .. })));
}

/// With a `min_alpha` so low that rounding cannot cross it, only arithmetic is compared.
#[test]
fn gradients_match_the_reference() {
    let (gaussians, view) = (cloud(600, 2, 21), view(61, 45));
    for mode in [RasterMode::Classic, RasterMode::Antialiased] {
        let constants = RendererConstants { min_alpha: 1e-5, ..RendererConstants::default() };
        let options = RenderOptions { constants, mode, ..everything() };
        let images = image_gradients(&view);
        let expected = reference::backward(&gaussians, &view, &options, &images).unwrap();
        for simd in SimdLevel::available() {
            let mut renderer = CpuRenderer::new(CpuOptions { simd, ..CpuOptions::default() });
            let actual = renderer.backward(&gaussians, &view, &options, &narrow(&images)).unwrap();
            assert_gradients_close(&actual, &expected, &format!("{mode:?} {simd:?}"));
        }
    }
}

fn assert_gradients_close(actual: &Gradients<f32>, expected: &Gradients<f64>, what: &str) {
    for ((name, actual), (_, expected)) in actual.fields().into_iter().zip(expected.fields()) {
        let (actual, expected) = (actual.iter().copied().map(f64::from), || expected.iter().copied());
        Tolerance::of_largest(1e-3, expected()).assert(actual, expected(), &format!("{what} {name}"));
    }
}

#[test]
fn threads_and_tiles_do_not_change_gradients() {
    let (gaussians, view) = (cloud(2000, 1, 23), view(90, 70));
    let images = narrow(&image_gradients(&view));
    let of = |threads: usize, tile| {
        let mut renderer = with_tiles(CpuOptions::default(), tile);
        on_threads(threads, || renderer.backward(&gaussians, &view, &everything(), &images).unwrap())
    };
    let expected = of(1, 32);
    assert!(of(3, 16) == expected && of(2, 64) == expected);
}

#[path = "../../tests/common/cloud.rs"]
mod cloud;
#[path = "../../tests/common/extreme.rs"]
mod extreme;
mod invariance;
mod limits;
mod magnitudes;
