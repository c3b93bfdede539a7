//! Pixels and gradients are finite for any input values: invalid Gaussians are culled and counted, extreme but valid
//! ones are drawn.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "common/poison.rs"]
mod common;

use atsplat_splat::cpu::{CpuOptions, CpuRenderer, SimdLevel};
use atsplat_splat::{Channels, GaussianParts, Gaussians, RasterMode, RenderOptions, reference};
use common::{NUMBERS, POISON, SLOTS, assert_finite, ones, scene, view};
use proptest::prelude::*;

fn options(mode: RasterMode) -> RenderOptions {
    let channels = Channels { depth: true, scalar: true, median_depth: true };
    RenderOptions { mode, channels, background: [0.2, 0.3, 0.4], ..RenderOptions::default() }
}

fn check(poisoned: &[(usize, f32)]) {
    let filtered = scene(poisoned);
    let unfiltered = Gaussians::new(GaussianParts { filter_3d: None, ..filtered.parts().clone() }).unwrap();
    for mode in [RasterMode::Classic, RasterMode::Antialiased] {
        check_in(&filtered, mode, &format!("{poisoned:?} {mode:?} filtered"));
        check_in(&unfiltered, mode, &format!("{poisoned:?} {mode:?}"));
    }
}

fn check_in(gaussians: &Gaussians, mode: RasterMode, what: &str) {
    let (view, options) = (view(), options(mode));
    let rendering = reference::render(gaussians, &view, &options).unwrap();
    let gradients = reference::backward(gaussians, &view, &options, &ones(1.0)).unwrap();
    assert_finite(&rendering, &gradients, &format!("{what} reference"));
    for simd in SimdLevel::available() {
        let mut renderer = CpuRenderer::new(CpuOptions { simd, ..CpuOptions::default() });
        let rendering = renderer.render(gaussians, &view, &options).unwrap();
        let gradients = renderer.backward(gaussians, &view, &options, &ones(1.0f32)).unwrap();
        assert_finite(&rendering, &gradients, &format!("{what} {simd:?}"));
    }
}

#[test]
fn survives_every_value_in_every_slot() {
    for slot in 0..SLOTS {
        for value in POISON {
            check(&[(slot, value)]);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn survives_several_values_at_once(poisoned in prop::collection::vec((0..NUMBERS, prop::sample::select(&POISON[..])), 1..12)) {
        check(&poisoned);
    }

    #[test]
    fn survives_arbitrary_bits(poisoned in prop::collection::vec((0..NUMBERS, any::<u32>().prop_map(f32::from_bits)), 1..12)) {
        check(&poisoned);
    }
}
