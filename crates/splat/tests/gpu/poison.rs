//! Whatever stands in a field, pixels and gradients of finite images are finite.

use atsplat_splat::gpu::GpuRenderer;
use atsplat_splat::{RasterMode, RenderOptions, Renderer};
use proptest::prelude::*;

use crate::common::{NUMBERS, POISON, SLOTS, assert_finite, ones, scene, view};
use crate::scenes::{everything, gpu};

fn check(gpu: &mut GpuRenderer, poisoned: &[(usize, f32)], mode: RasterMode) {
    let (gaussians, view) = (scene(poisoned), view());
    let options = RenderOptions { mode, ..everything() };
    let rendering = gpu.render(&gaussians, &view, &options).unwrap();
    let found: u64 = {
        let census = rendering.census;
        census.drawn + census.invalid + census.outside_depth + census.faint + census.outside_picture
    };
    assert_eq!(found, gaussians.len() as u64, "{poisoned:?}");
    let gradients = gpu.backward(&gaussians, &view, &options, &ones(1.0)).unwrap();
    assert_finite(&rendering, &gradients, &format!("{poisoned:?} {mode:?}"));
}

#[test]
fn every_number_in_every_slot() {
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
    fn several_at_once(
        poisoned in prop::collection::vec((0..NUMBERS, prop::sample::select(&POISON[..])), 1..12),
        antialiased in any::<bool>(),
    ) {
        let Some(mut gpu) = gpu() else { return Ok(()) };
        check(&mut gpu, &poisoned, if antialiased { RasterMode::Antialiased } else { RasterMode::Classic });
    }

    #[test]
    fn any_bits(poisoned in prop::collection::vec((0..NUMBERS, any::<u32>().prop_map(f32::from_bits)), 1..12)) {
        let Some(mut gpu) = gpu() else { return Ok(()) };
        check(&mut gpu, &poisoned, RasterMode::Classic);
    }
}
