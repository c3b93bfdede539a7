//! Self-test: renders a small scene and compares it with the reference, and a batch of scenes with its views one by one, to
//! detect broken drivers before use.

use std::ops::Range;

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use glam::{DMat3, DVec3};

use super::self_test_batch::Batch;
use super::{GpuError, GpuRenderer, ProbeStage};
use crate::renderer::saturated;
use crate::{
    Channels, GaussianCounts, GaussianParts, Gaussians, ImageGradients, RenderOptions, Renderer as _,
    RendererConstants, Rendering, SplatError, View, reference,
};

/// Largest allowed difference of a pixel, in images with values of order one.
pub(super) const PIXEL_BOUND: f64 = 1e-4;
/// Largest allowed difference of a gradient, relative to the largest of its field.
pub(super) const GRADIENT_BOUND: f64 = 1e-3;
/// More than one block of work for every kernel.
const COUNT: u16 = 2100;

macro_rules! sources {
    ($($name:literal),+) => { &[$(($name, include_str!($name))),+] };
}

/// Sources other than kernels that determine a result, by name: this file, and the code that drives the kernels.
pub(super) const SOURCES: &[(&str, &str)] = sources!(
    "backward.rs",
    "bounds.rs",
    "context.rs",
    "forward.rs",
    "gaussians.rs",
    "gradients.rs",
    "host.rs",
    "images.rs",
    "job.rs",
    "kernels.rs",
    "layout.rs",
    "lists.rs",
    "mod.rs",
    "options.rs",
    "pending.rs",
    "probe.rs",
    "read.rs",
    "record.rs",
    "render.rs",
    "self_test.rs",
    "self_test_batch.rs",
    "self_test_result.rs",
    "sort.rs",
    "status.rs",
    "uniforms.rs",
    "windows.rs",
    "work.rs"
);

/// Sources of the reference, with which results are compared.
pub(super) const REFERENCE: &[(&str, &str)] = sources!(
    "../constants.rs",
    "../options.rs",
    "../reach.rs",
    "../reference/composite.rs",
    "../reference/composite_backward.rs",
    "../reference/mod.rs",
    "../reference/project.rs",
    "../reference/project_backward.rs",
    "../rendering.rs",
    "../sh.rs",
    "../view.rs"
);

/// Compares an image and its gradients with the reference, and a batch with its views one by one.
pub(super) fn self_test(renderer: &mut GpuRenderer, begins: &dyn Fn(ProbeStage)) -> Result<(), GpuError> {
    let adapter = renderer.context.name.clone();
    compare(renderer, &adapter, begins).map_err(|error| match error {
        SplatError::Gpu(error) => error,
        other => GpuError::Rejected { adapter, reason: other.to_string() },
    })
}

fn compare(renderer: &mut GpuRenderer, adapter: &str, begins: &dyn Fn(ProbeStage)) -> Result<(), SplatError> {
    let (gaussians, options) = (gaussians(0..COUNT)?, options());
    let view = view(0.0, ImageSize { width: 45, height: 35 })?;
    let batch = Batch::new()?;
    begins(ProbeStage::Image);
    let expected = reference::render(&gaussians, &view, &options)?;
    let actual = renderer.render(&gaussians, &view, &options)?.map(f64::from);
    check(adapter, "Gaussian count", miscounted(actual.counts, expected.counts), 0.0)?;
    for ((what, actual), (_, expected)) in images_of(actual).iter().zip(images_of(expected)) {
        check(adapter, what, max_difference(actual, &expected), PIXEL_BOUND)?;
    }
    batch.check_images(renderer)?;
    begins(ProbeStage::Derivative);
    let images = image_gradients(view.pixels());
    let expected = reference::backward(&gaussians, &view, &options, &images)?;
    let actual = renderer.backward(&gaussians, &view, &options, &images.map(saturated))?.map(f64::from);
    for ((field, actual), (_, expected)) in actual.fields().into_iter().zip(expected.fields()) {
        check(adapter, &format!("gradient of {field}"), relative_difference(actual, expected), GRADIENT_BOUND)?;
    }
    batch.check_gradients(renderer)
}

/// Rejects a difference beyond its bound, or of NaN.
pub(super) fn check(adapter: &str, what: &str, difference: f64, bound: f64) -> Result<(), GpuError> {
    let (adapter, what) = (adapter.to_owned(), what.to_owned());
    if difference <= bound { Ok(()) } else { Err(GpuError::SelfTest { adapter, what, difference, bound }) }
}

/// Soft, overlapping Gaussians of these numbers, without thresholds that rounding could cross.
pub(super) fn gaussians(numbers: Range<u16>) -> Result<Gaussians, SplatError> {
    let wave = |n: u16, step: f32, phase: f32| (f32::from(n) * step + phase).sin();
    let mut parts = GaussianParts { sh_degree: 1, scalars: Some(Vec::new()), ..GaussianParts::default() };
    for n in numbers {
        parts.means.push([1.2 * wave(n, 1.37, 0.0), 0.8 * wave(n, 2.11, 1.0), 3.0 + wave(n, 0.73, 2.0)]);
        parts.quaternions.push([1.5, wave(n, 1.1, 3.0), wave(n, 1.3, 4.0), wave(n, 1.7, 5.0)]);
        parts.log_scales.push([-3.0, -2.5, -3.5].map(|log| log + 0.5 * wave(n, 0.9, log)));
        parts.opacity_logits.push(-3.0 + wave(n, 0.6, 6.0));
        parts.scalars.iter_mut().for_each(|scalars| scalars.push(wave(n, 0.4, 7.0)));
        let rgb = |phase: f32| [phase, phase + 0.3, phase + 0.6].map(|phase| 0.3 * wave(n, 0.8, phase));
        parts.sh.extend([0.5, 1.5, 2.5, 3.5].map(rgb));
    }
    Gaussians::new(parts)
}

/// A view of them, after so many steps along a path around them.
pub(super) fn view(steps: f64, size: ImageSize) -> Result<View, SplatError> {
    let turn = DMat3::from_rotation_y(0.1 - 0.06 * steps);
    let pose = CameraFromWorld::new(turn, DVec3::new(0.1 + 0.15 * steps, -0.05 - 0.04 * steps, 0.2 + 0.1 * steps))?;
    let camera = Camera::pinhole(pose, NormalizedIntrinsics::new(0.9, 1.2, 0.48, 0.53)?);
    Ok(View { camera, size })
}

pub(super) fn options() -> RenderOptions {
    let constants = RendererConstants { min_alpha: 1e-5, min_transmittance: 1e-9, ..RendererConstants::default() };
    RenderOptions {
        constants,
        background: [0.2, 0.5, 0.1],
        channels: Channels { depth: true, scalar: true, median_depth: false },
        ..RenderOptions::default()
    }
}

/// Gradients that vary from pixel to pixel.
pub(super) fn image_gradients(pixels: usize) -> ImageGradients<f64> {
    let wave_image = |phase: f64| (0..pixels).map(move |n| (n as f64 * 0.37 + phase).sin()).collect::<Vec<_>>();
    ImageGradients {
        rgb: wave_image(0.0).into_iter().map(|value| [value, 0.5 - value, value * value]).collect(),
        alpha: Some(wave_image(1.0)),
        depth: Some(wave_image(2.0)),
        scalar: Some(wave_image(3.0)),
    }
}

#[expect(clippy::expect_used, reason = "the self-test requests both images")]
pub(super) fn images_of(rendering: Rendering<f64>) -> Vec<(&'static str, Vec<f64>)> {
    vec![
        ("colour", rendering.rgb.as_flattened().to_vec()),
        ("alpha", rendering.alpha),
        ("depth", rendering.depth.expect("the self-test requests depth")),
        ("scalar", rendering.scalar.expect("the self-test requests the scalar")),
    ]
}

/// By how many Gaussians these counts differ.
pub(super) fn miscounted(actual: GaussianCounts, expected: GaussianCounts) -> f64 {
    let [actual, expected] =
        [actual, expected].map(|c| [c.drawn, c.invalid, c.outside_depth, c.faint, c.outside_image]);
    actual.iter().zip(expected).map(|(a, b)| a.abs_diff(b)).sum::<u64>() as f64
}

/// The largest difference; NaN if any is NaN, infinite if the lengths differ.
pub(super) fn max_difference(actual: &[f64], expected: &[f64]) -> f64 {
    if actual.len() != expected.len() {
        return f64::INFINITY;
    }
    let differences = actual.iter().zip(expected).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, atsplat_numeric::Extremes::maximum_of)
}

/// The largest difference, relative to the largest expected number.
pub(super) fn relative_difference(actual: &[f64], expected: &[f64]) -> f64 {
    max_difference(actual, expected) / max_difference(expected, &vec![0.0; expected.len()])
}

#[cfg(test)]
mod tests {
    use super::{REFERENCE, SOURCES};

    /// They choose adapters, count, describe errors, cache results, or serve what the self-test does not call.
    const OTHERS: [&str; 7] =
        ["adapters.rs", "counts.rs", "error.rs", "panics.rs", "image.rs", "self_test_cache.rs", "tests.rs"];

    /// What the self-test does not call.
    const OTHERS_OF_REFERENCE: [&str; 2] = ["jumps.rs", "tests.rs"];

    fn files_in(folder: &str) -> Vec<String> {
        let folder = std::fs::read_dir(format!("{}/src/{folder}", env!("CARGO_MANIFEST_DIR"))).unwrap();
        let paths = folder.map(|entry| entry.unwrap().path()).filter(|path| path.is_file());
        let mut found: Vec<String> = paths.map(|path| path.file_name().unwrap().to_str().unwrap().to_owned()).collect();
        found.sort();
        found
    }

    /// A cached result would outlive changes of a file that is in neither list.
    #[test]
    fn every_file_determines_results_or_is_known_not_to() {
        let mut known: Vec<&str> = SOURCES.iter().map(|(name, _)| *name).chain(OTHERS).collect();
        known.sort_unstable();
        assert_eq!(files_in("gpu"), known);
        let of_folder = REFERENCE.iter().filter_map(|(name, _)| name.strip_prefix("../reference/"));
        let mut known: Vec<&str> = of_folder.chain(OTHERS_OF_REFERENCE).collect();
        known.sort_unstable();
        assert_eq!(files_in("reference"), known);
    }
}
