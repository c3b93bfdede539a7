//! Tile lists that are longer than one dispatch passes over.

use atsplat_numeric::{Extremes as _, Tolerance};
use atsplat_splat::gpu::{GpuOptions, Threads};
use atsplat_splat::{RenderOptions, Renderer, reference};

use crate::backward::fields;
use crate::scenes::{assert_bound, cloud, everything, gpu, narrow, needles, open, ripples, specks, straight, view};

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
    let actual: Vec<f64> = actual.opacity_logits.iter().map(|value| f64::from(*value)).collect();
    let largest = expected.opacity_logits.iter().fold(0.0f64, |largest, value| largest.maximum_of(value.abs()));
    Tolerance::absolute(1e-3 * largest).assert(actual, expected.opacity_logits.iter().copied(), "specks");
}

/// The most turns that an entry can take: every thread has every needle, at no pixel the transmittance ends.
#[test]
fn needles_through_all_of_a_tile() {
    let (gaussians, view) = (needles(4000), straight(16, 16));
    let images = ripples(&view);
    let expected = reference::render(&gaussians, &view, &everything()).unwrap();
    assert_eq!(expected.census.drawn, 4000);
    let most = expected.alpha.iter().fold(0.0f64, |most, alpha| most.maximum_of(*alpha));
    assert!(most < 0.999, "{most}");
    let derivative = reference::backward(&gaussians, &view, &everything(), &images).unwrap();
    for threads in [Threads::Few, Threads::Many] {
        let Some(mut gpu) = open(GpuOptions { threads, ..GpuOptions::default() }) else { return };
        assert_bound(&gpu.render(&gaussians, &view, &everything()).unwrap(), &expected, &format!("{threads:?}"));
        let actual = gpu.backward(&gaussians, &view, &everything(), &narrow(&images)).unwrap().map(f64::from);
        for ((name, actual), (_, expected)) in fields(&actual).into_iter().zip(fields(&derivative)) {
            let largest = expected.iter().fold(0.0f64, |largest, value| largest.maximum_of(value.abs()));
            // So thin a needle's turn is ill-conditioned in f32; a sum that is lost is lost wholly.
            Tolerance::absolute(1e-2 * largest).assert(actual, expected, &format!("{threads:?}: {name}"));
        }
    }
}
