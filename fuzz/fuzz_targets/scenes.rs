//! Any bytes as a scene: pixels and derivatives that are all finite, or a typed error.
#![no_main]

#[path = "../scene_of_bytes.rs"]
mod scene_of_bytes;

use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{ImageGradients, ReferenceRenderer, Renderer};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some((gaussians, view, options)) = scene_of_bytes::scene_of_bytes(bytes) else { return };
    let ones = vec![1.0; view.pixels()];
    let images = ImageGradients {
        rgb: vec![[1.0; 3]; view.pixels()],
        alpha: Some(ones.clone()),
        depth: Some(ones.clone()),
        scalar: Some(ones),
    };
    let renderers: [Box<dyn Renderer>; 2] = [Box::new(ReferenceRenderer), Box::<CpuRenderer>::default()];
    for mut renderer in renderers {
        let Ok(rendering) = renderer.render(&gaussians, &view, &options) else { return };
        assert_eq!(rendering.non_finite(), 0, "pixels of {}", renderer.name());
        assert!(rendering.alpha.iter().all(|alpha| (0.0..=1.0).contains(alpha)), "opacity of {}", renderer.name());
        assert_eq!(rendering.counts.total(), gaussians.len() as u64, "counts of {}", renderer.name());
        let gradients = renderer.backward(&gaussians, &view, &options, &images).expect("what renders differentiates");
        assert_eq!(gradients.non_finite(), 0, "derivatives of {}", renderer.name());
    }
});
