use atsplat_numeric::{Extremes as _, Tolerance};
use atsplat_splat::cpu::CpuOptions;
use atsplat_splat::gpu::{AdapterChoice, GpuError, GpuOptions, GpuRenderer, Threads, with_fallback};
use atsplat_splat::{RenderOptions, Renderer, RendererConstants, SplatError, reference};

use crate::scenes::{assert_bound, cloud, everything, gpu, narrow, open, ripples, specks, view};

/// Parts of 600 Gaussians, strips of two rows of tiles, windows of few tiles, dispatches in two dimensions.
#[test]
fn small_limits_give_the_same_bits() {
    let small = GpuOptions { binding_limit: 128 << 10, groups_limit: 25, ..GpuOptions::default() };
    let (Some(mut gpu), Some(mut cut)) = (gpu(), open(small)) else { return };
    let (gaussians, view) = (cloud(3000, 3, 7), view(97, 71));
    assert!(cut.strips(&view).unwrap().len() > 1 && gpu.strips(&view).unwrap().len() == 1);
    let whole = gpu.render(&gaussians, &view, &everything()).unwrap();
    assert!(cut.render(&gaussians, &view, &everything()).unwrap() == whole);
    let images = narrow(&ripples(&view));
    let whole = gpu.backward(&gaussians, &view, &everything(), &images).unwrap();
    assert!(cut.backward(&gaussians, &view, &everything(), &images).unwrap() == whole);
}

/// Lists are passed over in many dispatches, as drivers need that end a kernel's loops early.
#[test]
fn lists_in_parts_give_the_same_bits() {
    let few = GpuOptions { entries_limit: 37, ..GpuOptions::default() };
    let (Some(mut gpu), Some(mut cut)) = (gpu(), open(few)) else { return };
    let (gaussians, view) = (cloud(3000, 1, 7), view(97, 71));
    let images = narrow(&ripples(&view));
    for options in [everything(), RenderOptions::default()] {
        let whole = gpu.render(&gaussians, &view, &options).unwrap();
        assert!(cut.render(&gaussians, &view, &options).unwrap() == whole);
        let whole = gpu.backward(&gaussians, &view, &options, &images).unwrap();
        assert!(cut.backward(&gaussians, &view, &options, &images).unwrap() == whole);
    }
}

/// Software Vulkan ends loops after 65 535 turns: so many Gaussians of one tile, none of which hides the others.
#[test]
fn more_of_one_tile_than_a_loop_takes() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (specks(200_000), view(16, 16));
    let expected = reference::render(&gaussians, &view, &everything()).unwrap();
    assert!(expected.census.drawn > 65_535, "{:?}", expected.census);
    assert_bound(&gpu.render(&gaussians, &view, &everything()).unwrap(), &expected, "specks");
    let images = ripples(&view);
    let expected = reference::backward(&gaussians, &view, &everything(), &images).unwrap();
    let actual = gpu.backward(&gaussians, &view, &everything(), &narrow(&images)).unwrap();
    let last = actual.opacity_logits.iter().rev().take(1000).map(|value| f64::from(*value));
    let largest = expected.opacity_logits.iter().fold(0.0f64, |largest, value| largest.maximum_of(value.abs()));
    Tolerance::absolute(1e-3 * largest).assert(last, expected.opacity_logits.iter().rev().take(1000).copied(), "last");
}

/// How the work is divided changes no pixel; sums over pixels round otherwise (the self-test bounds that).
#[test]
fn many_and_few_threads_give_the_same_pixels() {
    let renderers = [Threads::Many, Threads::Few].map(|threads| open(GpuOptions { threads, ..GpuOptions::default() }));
    let [Some(mut many), Some(mut few)] = renderers else { return };
    let (gaussians, view) = (cloud(3000, 1, 7), view(97, 71));
    for preset in ["exact", "inria"] {
        let constants = RendererConstants::named(preset).unwrap();
        let options = RenderOptions { constants, ..everything() };
        let pixels = many.render(&gaussians, &view, &options).unwrap();
        assert!(few.render(&gaussians, &view, &options).unwrap() == pixels, "{preset}");
    }
}

/// OpenGL, where there is an adapter for it and `ATSPLAT_TEST_OPENGL=1`, as Mesa's software OpenGL compiles the kernels
/// for a minute: it passes the self-test, and pixels are within the bound.
#[test]
fn opengl_too() {
    if std::env::var("ATSPLAT_TEST_OPENGL").as_deref() != Ok("1") {
        eprintln!("SKIPPED, ATSPLAT_TEST_OPENGL is not 1");
        return;
    }
    let Ok(mut gl) = GpuRenderer::new(&AdapterChoice::Name("(gl)".to_owned()), GpuOptions::default()) else {
        eprintln!("SKIPPED, no OpenGL adapter with compute shaders");
        return;
    };
    let (gaussians, view) = (cloud(2000, 3, 7), view(70, 50));
    let expected = reference::render(&gaussians, &view, &everything()).unwrap();
    assert_bound(&gl.render(&gaussians, &view, &everything()).unwrap(), &expected, "OpenGL");
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let Some(mut gpu) = gpu() else { return };
    let tiny = GpuOptions { memory_limit: 100_000, ..GpuOptions::default() };
    let outcome = GpuRenderer::with_device(gpu.device().clone(), gpu.queue().clone(), tiny);
    let outcome = outcome.unwrap().render(&cloud(2000, 0, 1), &view(64, 64), &everything());
    assert!(matches!(outcome, Err(SplatError::Memory { limit: 100_000, .. })), "{outcome:?}");
    let narrow = GpuOptions { binding_limit: 16 << 10, ..GpuOptions::default() };
    let outcome = GpuRenderer::with_device(gpu.device().clone(), gpu.queue().clone(), narrow);
    let outcome = outcome.unwrap().render(&cloud(2000, 0, 1), &view(64, 64), &everything());
    assert!(matches!(outcome, Err(SplatError::Gpu(GpuError::TooLarge { .. }))), "{outcome:?}");
    // And the device is as good as before.
    gpu.render(&cloud(100, 0, 1), &view(8, 8), &everything()).unwrap();
}

#[test]
fn the_processor_takes_over_and_says_why() {
    let choice = AdapterChoice::Name("no adapter has this name".to_owned());
    let mut fallback = with_fallback(&choice, GpuOptions::default(), CpuOptions::default());
    assert!(fallback.renderer.name().starts_with("cpu"));
    assert!(matches!(&fallback.reason, Some(GpuError::NoAdapter { .. })), "{:?}", fallback.reason);
    fallback.renderer.render(&cloud(10, 0, 1), &view(8, 8), &everything()).unwrap();
}

/// A destroyed device is an error, not a panic.
#[test]
fn a_lost_device_is_a_typed_error() {
    let Some(mut gpu) = open(GpuOptions::default()) else { return };
    gpu.device().destroy();
    let outcome = gpu.render(&cloud(10, 0, 1), &view(8, 8), &everything());
    assert!(matches!(outcome, Err(SplatError::Gpu(_))), "{outcome:?}");
}
