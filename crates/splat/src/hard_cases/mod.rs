//! Scenes at which renderers break: each a name, the data, and the error that a renderer may make on it.
//!
//! What is invalid is culled and counted, what is extreme but valid survives. Sources: the issue trackers of
//! gaussian-splatting, diff-gaussian-rasterization, gsplat, brush, fvdb-core, supersplat and others.

mod crowds;
mod numbers;
mod opacities;
mod places;
mod scene;
mod shapes;
mod views;

use crate::{Census, Gaussians, RenderOptions, View};

/// A scene that is hard to render.
#[derive(Clone, Debug)]
pub struct HardCase {
    /// As in `--case`.
    pub name: &'static str,
    /// What is hard about it.
    pub description: &'static str,
    /// What is rendered.
    pub gaussians: Gaussians,
    /// From where.
    pub view: View,
    /// And how.
    pub options: RenderOptions,
    /// What has to become of the Gaussians; `None` where a cut-off decides and rounding with it.
    pub census: Option<Census>,
    /// What a renderer in f32 may get wrong.
    pub bounds: ErrorBounds,
    /// Whether derivatives take geometry in f64: a renderer with less has to give finite ones, and no more.
    pub derivatives_need_f64: bool,
}

/// Errors that a renderer may make, against the reference in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorBounds {
    /// Of a sample of an image, outside the band: as a share of the largest value of that image, at least of 1.
    pub image: f64,
    /// Of a derivative, as a share of the largest in its field.
    pub gradient: f64,
    /// Relative error of an opacity: pixels at which that takes one across a cut-off may jump, by as much as then
    /// follows (see [`crate::reference::jumps`]).
    pub band: f64,
}

impl ErrorBounds {
    /// Larger, or smaller, by a factor: for a renderer that computes more coarsely, or less.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        let Self { image, gradient, band } = self;
        Self { image: image * factor, gradient: gradient * factor, band: band * factor }
    }
}

impl Default for ErrorBounds {
    /// What geometry in f64 and pixels in f32 leave.
    fn default() -> Self {
        Self { image: 1e-6, gradient: 2e-4, band: 1e-4 }
    }
}

/// Every hard case.
pub fn catalogue() -> Vec<HardCase> {
    let groups =
        [shapes::cases(), places::cases(), opacities::cases(), numbers::cases(), crowds::cases(), views::cases()];
    groups.into_iter().flatten().collect()
}
