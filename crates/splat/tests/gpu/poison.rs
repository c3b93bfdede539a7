//! Pixels and gradients are finite for any input values.

use atsplat_numeric::{Extremes as _, Tolerance};
use atsplat_splat::gpu::GpuRenderer;
use atsplat_splat::{RasterMode, RenderOptions, Renderer, reference};
use proptest::prelude::*;

use crate::common::{NUMBERS, POISON, SLOTS, assert_finite, ones, scene, view};
use crate::scenes::{everything, gpu};

/// Largest difference of a pixel, relative to the largest: a threshold crossing and f32 rounding.
const PIXEL_BOUND: f64 = 0.01;

/// Whether a value may force geometry in f32 to cull a Gaussian that the f64 reference draws.
fn is_beyond_f32((slot, value): (usize, f32)) -> bool {
    let is_log_scale = (7..10).contains(&(slot % SLOTS));
    let magnitude = value.abs();
    value.is_finite() && (magnitude > 1e15 || (magnitude > 0.0 && magnitude < 1e-15) || (is_log_scale && value > 40.0))
}

fn check(gpu: &mut GpuRenderer, poisoned: &[(usize, f32)], mode: RasterMode) {
    let (gaussians, view) = (scene(poisoned), view());
    let options = RenderOptions { mode, ..everything() };
    let rendering = gpu.render(&gaussians, &view, &options).unwrap();
    let expected = reference::render(&gaussians, &view, &options).unwrap();
    let what = format!("{poisoned:?} {mode:?}");
    let culled_in_f32 = poisoned.iter().filter(|poison| is_beyond_f32(**poison)).count();
    if culled_in_f32 > 0 {
        assert!(rendering.counts.drawn.abs_diff(expected.counts.drawn) <= culled_in_f32 as u64, "{what}");
    } else {
        assert_eq!(rendering.counts.drawn, expected.counts.drawn, "{what}");
        // If several reasons to cull a Gaussian apply, any may be counted.
        assert!(poisoned.len() > 1 || rendering.counts == expected.counts, "{what}: {:?}", rendering.counts);
        let expected = expected.rgb.as_flattened();
        let size = expected.iter().fold(1.0f64, |most, value| most.maximum_of(value.abs()));
        let actual = rendering.rgb.iter().flatten().map(|value| f64::from(*value));
        Tolerance::absolute(PIXEL_BOUND * size).assert(actual, expected.iter().copied(), &what);
    }
    let gradients = gpu.backward(&gaussians, &view, &options, &ones(1.0)).unwrap();
    assert_finite(&rendering, &gradients, &what);
}

#[test]
fn survives_every_value_in_every_slot() {
    let Some(mut gpu) = gpu() else { return };
    for slot in 0..SLOTS {
        for (n, value) in POISON.into_iter().enumerate() {
            let mode = if (slot + n) % 2 == 0 { RasterMode::Classic } else { RasterMode::Antialiased };
            check(&mut gpu, &[(slot, value)], mode);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn survives_several_values_at_once(
        poisoned in prop::collection::vec((0..NUMBERS, prop::sample::select(&POISON[..])), 1..12),
        antialiased in any::<bool>(),
    ) {
        let Some(mut gpu) = gpu() else { return Ok(()) };
        check(&mut gpu, &poisoned, if antialiased { RasterMode::Antialiased } else { RasterMode::Classic });
    }

    #[test]
    fn survives_arbitrary_bits(poisoned in prop::collection::vec((0..NUMBERS, any::<u32>().prop_map(f32::from_bits)), 1..12)) {
        let Some(mut gpu) = gpu() else { return Ok(()) };
        check(&mut gpu, &poisoned, RasterMode::Classic);
    }
}
