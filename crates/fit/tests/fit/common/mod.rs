//! A small scene whose images are rendered from known Gaussians.

use std::path::Path;

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_fit::start::in_frustums;
use atsplat_fit::{Fit, FitConfig, Strategy, TrainingView};
use atsplat_numeric::SplitMix64;
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{GaussianParts, Gaussians, RenderOptions, View};
use glam::{DMat3, DVec3};

/// Uniform in [low, high).
pub(crate) fn random(generator: &mut SplitMix64, low: f32, high: f32) -> f32 {
    low + (high - low) * generator.unit_f32()
}

/// A cloud of coloured blobs around the origin.
pub(crate) fn truth() -> Gaussians {
    let mut generator = SplitMix64::new(5);
    let mut parts = GaussianParts::default();
    for _ in 0..60 {
        let mut row = |low, high| std::array::from_fn(|_| random(&mut generator, low, high));
        parts.means.push(row(-1.0, 1.0));
        parts.log_scales.push(row(-2.2, -1.2));
        parts.sh.push(row(-1.5, 1.5));
        let [w, x, y] = row(-1.0, 1.0);
        parts.quaternions.push([w, x, y, 0.3]);
        parts.opacity_logits.push(2.0);
    }
    Gaussians::new(parts).unwrap()
}

/// A camera on a circle around the origin.
pub(crate) fn view(angle: f64, side: u32) -> View {
    let centre = DVec3::new(4.0 * angle.sin(), 0.8 * (2.0 * angle).cos(), -4.0 * angle.cos());
    let forward = -centre.normalize();
    let right = DVec3::Y.cross(forward).normalize();
    let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let pose = CameraFromWorld::new(rotation, -(rotation * centre)).unwrap();
    let intrinsics = NormalizedIntrinsics::new(1.2, 1.2, 0.5, 0.5).unwrap();
    View { camera: Camera::pinhole(pose, intrinsics), size: ImageSize { width: side, height: side } }
}

/// Training views, and two that are held out.
pub(crate) fn views() -> (Vec<TrainingView>, Vec<TrainingView>) {
    views_of(40)
}

/// [`views`] with images of this many pixels a side.
pub(crate) fn views_of(side: u32) -> (Vec<TrainingView>, Vec<TrainingView>) {
    let mut renderer = CpuRenderer::default();
    let image = |number: u32| {
        let view = view(f64::from(number) * 0.4, side);
        let rgb = renderer.render(&truth(), &view, &RenderOptions::default()).unwrap().rgb;
        let rgb = rgb.into_iter().map(|rgb| rgb.map(|value| value.clamp(0.0, 1.0))).collect();
        TrainingView { name: format!("view {number}"), view, rgb }
    };
    (0..16).map(image).partition(|view| !["view 3", "view 9"].contains(&view.name.as_str()))
}

pub(crate) fn config(strategy: Strategy, steps: u64) -> FitConfig {
    FitConfig { sh_degree: 1, max_gaussians: 4000, seed: 11, ..FitConfig::new(strategy, steps) }
}

pub(crate) fn start(strategy: Strategy, count: usize) -> Gaussians {
    in_frustums(&views().0, count, None, 0.01, 1, strategy).unwrap()
}

pub(crate) fn run(fit: &mut Fit, steps: u64) {
    for _ in 0..steps {
        fit.step().unwrap();
    }
}

pub(crate) fn held_out(fit: &mut Fit) -> f64 {
    fit.mean_score(&views().1).unwrap().psnr.unwrap()
}

/// Replaces the first occurrence of a text in a checkpoint by another one of the same length, as if an earlier version had written it,
/// without a hash of the metadata.
pub(crate) fn rewrite_metadata(path: &Path, from: &str, to: &str) {
    let mut bytes = std::fs::read(path).unwrap();
    let position = |bytes: &[u8], text: &str| bytes.windows(text.len()).position(|window| window == text.as_bytes());
    let at = position(&bytes, from).unwrap();
    bytes[at..at + from.len()].copy_from_slice(to.as_bytes());
    let (hash, unknown) = ("atsplat.fit-sha256", "atsplat.fit-sha25x");
    if let Some(at) = position(&bytes, hash) {
        bytes[at..at + hash.len()].copy_from_slice(unknown.as_bytes());
    }
    std::fs::write(path, bytes).unwrap();
}
