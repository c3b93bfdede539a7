//! Scenes that break renderers: each has a name, its data, and the error bounds that a renderer must meet.
//!
//! Invalid Gaussians are culled and counted; extreme but valid ones are drawn. Sources: the issue trackers of
//! gaussian-splatting, diff-gaussian-rasterization, gsplat, brush, fvdb-core, supersplat and others.

mod crowds;
mod lenses;
mod needles;
mod numbers;
mod opacities;
mod places;
mod scene;
mod shapes;
mod views;

use crate::{GaussianCounts, Gaussians, RenderOptions, View};

/// A scene that is hard to render.
#[derive(Clone, Debug)]
pub struct HardCase {
    /// Name, as in `--case`.
    pub name: &'static str,
    /// What makes it hard.
    pub description: &'static str,
    /// The scene.
    pub gaussians: Gaussians,
    /// The view.
    pub view: View,
    /// The render options.
    pub options: RenderOptions,
    /// Expected counts; `None` if they depend on rounding near a threshold.
    pub counts: Option<GaussianCounts>,
    /// Error bounds for a renderer in f32.
    pub bounds: ErrorBounds,
    /// Whether accurate gradients need geometry in f64; of other renderers only finite gradients are required.
    pub derivatives_need_f64: bool,
    /// Error bound of images of renderers with geometry in f32, where that of `bounds` needs f64; infinite if images have only to
    /// be finite.
    pub image_in_f32: Option<f64>,
}

/// Error bounds of a renderer against the f64 reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorBounds {
    /// For a sample of an image, apart from jumps at thresholds: relative to the image's largest magnitude, or to 1 if
    /// that is larger.
    pub image: f64,
    /// For a gradient, relative to the largest of its field or, for log-scales, logits, SH coefficients and scalars, to a
    /// thousandth of the largest of these fields if that is larger.
    pub gradient: f64,
    /// Relative error of an alpha: pixels where such an error may cross a threshold are allowed to jump accordingly
    /// (see [`crate::reference::jumps`]).
    pub band: f64,
}

impl ErrorBounds {
    /// Scales every bound, for a renderer of lower or higher precision.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        let Self { image, gradient, band } = self;
        Self { image: image * factor, gradient: gradient * factor, band: band * factor }
    }
}

impl Default for ErrorBounds {
    /// The bounds for geometry in f64 and pixels in f32.
    fn default() -> Self {
        Self { image: 1e-6, gradient: 2e-4, band: 1e-4 }
    }
}

/// Every hard case.
pub fn catalogue() -> Vec<HardCase> {
    let groups = [
        shapes::cases(),
        needles::cases(),
        places::cases(),
        opacities::cases(),
        numbers::cases(),
        crowds::cases(),
        views::cases(),
        lenses::cases(),
    ];
    groups.into_iter().flatten().collect()
}
