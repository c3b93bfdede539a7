use serde::{Deserialize, Serialize};

use crate::{Exposure, RendererConstants};

/// What is rendered, and how, beside the Gaussians and the view.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderOptions {
    /// Thresholds and rules.
    pub constants: RendererConstants,
    /// RGB behind everything.
    pub background: [f64; 3],
    /// What becomes of Gaussians smaller than a pixel.
    pub mode: RasterMode,
    /// Highest degree of spherical harmonics that is evaluated.
    pub max_sh_degree: u8,
    /// What becomes of colour after compositing; nothing where absent.
    pub exposure: Option<Exposure>,
    /// Images beside colour and alpha.
    pub channels: Channels,
    /// How far gradients reach.
    pub gradients: GradientReach,
}

impl Default for RenderOptions {
    /// Colour and alpha alone on black, exact constants, classic mode, every degree.
    fn default() -> Self {
        Self {
            constants: RendererConstants::default(),
            background: [0.0; 3],
            mode: RasterMode::Classic,
            max_sh_degree: crate::MAX_SH_DEGREE,
            exposure: None,
            channels: Channels::default(),
            gradients: GradientReach::default(),
        }
    }
}

/// What becomes of Gaussians smaller than a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RasterMode {
    /// The screen-space blur makes them larger and so brighter (3DGS, gsplat's `classic`).
    Classic,
    /// Their opacity falls as the blur spreads them: `√(det Σ / det(Σ + blur))` (gsplat's `antialiased`,
    /// Mip-Splatting's 2D filter).
    Antialiased,
}

/// Images beside colour and alpha.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Channels {
    /// Depth along the optical axis, composited like a colour on 0; divide by alpha for the expected depth.
    pub depth: bool,
    /// The Gaussians' own scalar, composited like a colour on 0.
    pub scalar: bool,
    /// Depth of the Gaussian that takes the transmittance to one half or below; 0 where none does.
    pub median_depth: bool,
}

/// How far gradients reach.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct GradientReach {
    /// The scalar image's gradient goes to the scalars and to nothing else (ATSplat's stop-gradient on its
    /// uncertainty map).
    pub scalar_stops: bool,
    /// View directions are constants to the spherical harmonics, so that colour does not pull at means.
    pub directions_stop: bool,
}
