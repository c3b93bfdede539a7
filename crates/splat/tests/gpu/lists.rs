//! Tile lists that need several dispatches.

use atsplat_numeric::Tolerance;
use atsplat_splat::gpu::{GpuOverrides, Threads};
use atsplat_splat::{RenderOptions, Renderer, reference};

use crate::scenes::{
    assert_bound, assert_identical, beside, cloud, everything, gpu, image_gradients, narrow, needles, overriding,
    specks, straight, view,
};

/// Lists are split over many dispatches, as required by drivers that limit loop iterations.
#[test]
fn splitting_lists_gives_identical_results() {
    let few = GpuOverrides { entries_limit: 37, ..GpuOverrides::default() };
    let Some(mut gpu) = gpu() else { return };
    let mut limited = beside(&gpu, overriding(few));
    let (gaussians, view) = (cloud(3000, 1, 7), view(97, 71));
    for options in [everything(), RenderOptions::default()] {
        assert_identical(&mut limited, &mut gpu, &gaussians, &view, &options);
    }
}

/// Software Vulkan aborts loops after 65 535 iterations: more Gaussians than that in one tile, without occlusion.
#[test]
fn renders_more_gaussians_per_tile_than_a_loop_allows() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (specks(200_000), view(16, 16));
    let expected = reference::render(&gaussians, &view, &everything()).unwrap();
    assert!(expected.counts.drawn > 65_535, "{:?}", expected.counts);
    assert_bound(&gpu.render(&gaussians, &view, &everything()).unwrap(), &expected, "specks");
    let images = image_gradients(&view);
    let expected = reference::backward(&gaussians, &view, &everything(), &images).unwrap();
    let actual = gpu.backward(&gaussians, &view, &everything(), &narrow(&images)).unwrap();
    let actual: Vec<f64> = actual.opacity_logits.iter().map(|value| f64::from(*value)).collect();
    let expected = || expected.opacity_logits.iter().copied();
    Tolerance::of_largest(1e-3, expected()).assert(actual, expected(), "specks");
}

/// The most loop iterations per entry: every thread processes every needle, and no pixel finishes early.
#[test]
fn renders_needles_across_a_whole_tile() {
    let (gaussians, view) = (needles(4000), straight(16, 16));
    let images = image_gradients(&view);
    let expected = reference::render(&gaussians, &view, &everything()).unwrap();
    assert_eq!(expected.counts.drawn, 4000);
    assert!(expected.alpha.iter().all(|alpha| *alpha < 0.999), "{:?}", expected.alpha);
    let gradients = reference::backward(&gaussians, &view, &everything(), &images).unwrap();
    let Some(shared) = gpu() else { return };
    for threads in [Threads::Few, Threads::Many] {
        let mut gpu = beside(&shared, overriding(GpuOverrides { threads, ..GpuOverrides::default() }));
        assert_bound(&gpu.render(&gaussians, &view, &everything()).unwrap(), &expected, &format!("{threads:?}"));
        let actual = gpu.backward(&gaussians, &view, &everything(), &narrow(&images)).unwrap().map(f64::from);
        for ((name, actual), (_, expected)) in actual.fields().into_iter().zip(gradients.fields()) {
            // The rotation of so thin a needle is ill-conditioned in f32, but a lost sum would be far outside the
            // tolerance.
            Tolerance::of_largest(1e-2, expected.iter().copied()).assert(
                actual.iter().copied(),
                expected.iter().copied(),
                &format!("{threads:?}: {name}"),
            );
        }
    }
}
