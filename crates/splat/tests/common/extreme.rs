//! Inputs near the limits of f32, for the tests of the CPU and the GPU renderer.

use atsplat_splat::{Exposure, Gaussians, ImageGradients, RenderOptions, View};

use super::cloud::{cloud, everything, view};

/// A backward pass near the limits of f32: image gradients of a magnitude, bright Gaussians, a strong exposure.
pub(crate) fn extreme(
    magnitude: f32,
    bright: bool,
    gain: bool,
) -> (Gaussians, View, RenderOptions, ImageGradients<f32>) {
    let mut parts = cloud(60, 1, 92).into_parts();
    if bright {
        parts.sh.iter_mut().for_each(|rgb| *rgb = rgb.map(|value| value * 1e11));
    }
    let view = view(33, 21);
    let exposure = Exposure { matrix: [[1e12; 3]; 3], offset: [0.0; 3] };
    let options = RenderOptions { exposure: gain.then_some(exposure), ..everything() };
    let images = ImageGradients {
        rgb: vec![[magnitude, -magnitude, magnitude]; view.pixels()],
        alpha: Some(vec![magnitude; view.pixels()]),
        depth: Some(vec![-magnitude; view.pixels()]),
        scalar: Some(vec![magnitude; view.pixels()]),
    };
    (Gaussians::new(parts).unwrap(), view, options, images)
}
