//! Replays the inputs of the fuzz targets without a fuzzer: malformed input gives a typed error, everything else finite
//! results, and nothing panics.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "../../../fuzz/scene_of_bytes.rs"]
mod scene_of_bytes;

use std::hint::black_box;
use std::path::{Path, PathBuf};

use atsplat_splat::files::parse;
use atsplat_splat::{Cleaning, ImageGradients, stress};

fn inputs(target: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(target);
    let mut inputs: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    inputs.sort();
    inputs
}

fn accepts(path: &Path) -> bool {
    let bytes = std::fs::read(path).unwrap();
    let Ok((gaussians, import)) = parse(&bytes, Path::new("fuzz.splat")) else { return false };
    assert_eq!(gaussians.len() + import.validation.rejected, import.validation.total, "{}", path.display());
    let (clean, _) = gaussians.cleaned(Cleaning::Repair);
    assert!(clean.validate().is_clean(), "{}", path.display());
    black_box(clean.bounds_of_means());
    true
}

#[test]
fn splat_files() {
    let seeds = inputs("splat_files");
    let accepted = seeds.iter().filter(|path| accepts(path)).count();
    let rejected = seeds.len() - accepted;
    assert!(accepted >= 15 && rejected >= 8, "{accepted} accepted, {rejected} rejected");
}

/// Whether the bytes are a scene that can be rendered.
fn renders(path: &Path) -> bool {
    let bytes = std::fs::read(path).unwrap();
    let Some((gaussians, view, options)) = scene_of_bytes::scene_of_bytes(&bytes) else { return false };
    let ones = vec![1.0; view.pixels()];
    let images = ImageGradients {
        rgb: vec![[1.0; 3]; view.pixels()],
        alpha: Some(ones.clone()),
        depth: Some(ones.clone()),
        scalar: Some(ones),
    };
    for stress::RendererUnderTest { mut renderer, .. } in stress::cpu_under_test() {
        let what = format!("{} by {}", path.display(), renderer.name());
        let Ok(rendering) = renderer.render(&gaussians, &view, &options) else { return false };
        assert_eq!(rendering.non_finite(), 0, "{what}");
        assert!(rendering.alpha.iter().all(|alpha| (0.0..=1.0).contains(alpha)), "{what}");
        assert_eq!(rendering.counts.total(), gaussians.len() as u64, "{what}");
        assert_eq!(renderer.backward(&gaussians, &view, &options, &images).unwrap().non_finite(), 0, "{what}");
    }
    true
}

#[test]
fn scenes() {
    let seeds = inputs("scenes");
    let rendered = seeds.iter().filter(|path| renders(path)).count();
    assert!(rendered >= 60 && rendered < seeds.len(), "{rendered} of {} rendered", seeds.len());
}
