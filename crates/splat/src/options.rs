use std::borrow::Cow;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::{Exposure, Gaussians, PackedHarmonics, RendererConstants, ShAxes, SplatError, sh_coefficients};

/// What to render and how, apart from the Gaussians and the view.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderOptions {
    /// Thresholds and rules.
    pub constants: RendererConstants,
    /// RGB behind all Gaussians.
    pub background: [f64; 3],
    /// How Gaussians smaller than a pixel are drawn.
    pub mode: RasterMode,
    /// Highest degree of spherical harmonics that is requested; [`RendererConstants::max_sh_degree`] may be lower.
    pub max_sh_degree: u8,
    /// Packed coefficients of the same Gaussians to evaluate instead of their own; renderers compare a sample. Gradients are
    /// always with respect to their own; a graphics processor takes only the highest degree from it.
    pub harmonics: Option<Arc<PackedHarmonics>>,
    /// Colour transform after compositing, if any.
    pub exposure: Option<Exposure>,
    /// Images rendered in addition to colour and alpha.
    pub channels: Channels,
    /// Which gradients are stopped.
    pub gradients: StoppedGradients,
}

impl Default for RenderOptions {
    /// Colour and alpha on black, exact constants, classic mode, all SH degrees.
    fn default() -> Self {
        Self {
            constants: RendererConstants::default(),
            background: [0.0; 3],
            mode: RasterMode::Classic,
            max_sh_degree: crate::MAX_SH_DEGREE,
            harmonics: None,
            exposure: None,
            channels: Channels::default(),
            gradients: StoppedGradients::default(),
        }
    }
}

impl RenderOptions {
    /// The degree of spherical harmonics that every backend evaluates of Gaussians of degree `stored`: at most the requested
    /// one and that of the constants.
    pub(crate) const fn sh_degree(&self, stored: u8) -> u8 {
        let (requested, most) = (self.max_sh_degree, self.constants.max_sh_degree);
        let most = if requested < most { requested } else { most };
        if stored < most { stored } else { most }
    }

    /// A remark on Gaussians with coefficients that were requested but that the constants do not evaluate; `None` if there
    /// are none.
    pub fn ignored_harmonics(&self, gaussians: &Gaussians) -> Option<String> {
        let (parts, RendererConstants { name, max_sh_degree: most, .. }) = (gaussians.parts(), &self.constants);
        let requested = if self.max_sh_degree < parts.sh_degree { self.max_sh_degree } else { parts.sh_degree };
        if requested <= *most {
            return None;
        }
        let ignored = sh_coefficients(*most)..sh_coefficients(requested);
        let is_set = |sh: &&[[f32; 3]]| {
            sh.get(ignored.clone()).is_some_and(|upper| upper.as_flattened().iter().any(|value| !(value.abs() <= 0.0)))
        };
        let count = parts.sh.chunks_exact(sh_coefficients(parts.sh_degree)).filter(is_set).count();
        (count > 0).then(|| {
            let all = gaussians.len();
            format!(
                "{count} of {all} Gaussians have spherical harmonics above degree {most}, which the constants {name} do not \
                 evaluate"
            )
        })
    }

    /// A remark on Gaussians with a coefficient that is evaluated otherwise than in the rasterizer of [`ShAxes::E3nn`]; `None` if
    /// there are none. Its forward pass has z(zz − xx) as the basis function of coefficient 14. The permuted basis has
    /// y(zz − xx), and so has its backward pass.
    pub fn differing_harmonics(&self, gaussians: &Gaussians) -> Option<String> {
        const DIFFERING: usize = 14;
        let (parts, RendererConstants { name, sh_axes, .. }) = (gaussians.parts(), &self.constants);
        if *sh_axes == ShAxes::Standard || self.sh_degree(parts.sh_degree) < 3 {
            return None;
        }
        let is_set = |sh: &&[[f32; 3]]| sh.get(DIFFERING).is_some_and(|rgb| rgb.iter().any(|value| value.abs() > 0.0));
        let count = parts.sh.chunks_exact(sh_coefficients(parts.sh_degree)).filter(is_set).count();
        (count > 0).then(|| {
            let all = gaussians.len();
            format!(
                "{count} of {all} Gaussians have a coefficient {DIFFERING} of spherical harmonics, which the constants {name} \
                 evaluate as y(zz - xx), as the published rasterizer's backward pass does; its forward pass has z(zz - xx)"
            )
        })
    }

    /// Without approximations: what gradients are computed from.
    pub(crate) fn in_full(&self) -> Cow<'_, Self> {
        if self.harmonics.is_none() {
            return Cow::Borrowed(self);
        }
        Cow::Owned(Self { harmonics: None, ..self.clone() })
    }

    /// # Errors
    /// [`SplatError::Length`] and [`SplatError::OtherHarmonics`] for packed coefficients of other Gaussians.
    pub(crate) fn check_harmonics(&self, gaussians: &Gaussians) -> Result<(), SplatError> {
        let Some(packed) = &self.harmonics else { return Ok(()) };
        if packed.len() != gaussians.len() {
            let (expected, found) = (gaussians.len(), packed.len());
            return Err(SplatError::Length { field: "packed harmonics", expected, found });
        }
        packed.first_difference(gaussians).map_or(Ok(()), |position| Err(SplatError::OtherHarmonics { position }))
    }
}

/// How Gaussians smaller than a pixel are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RasterMode {
    /// The screen-space blur enlarges and so brightens them (3DGS, gsplat's `classic`).
    Classic,
    /// Their opacity falls as the blur spreads them: `√(det Σ / det(Σ + blur))` (gsplat's `antialiased`,
    /// Mip-Splatting's 2D filter).
    Antialiased,
}

/// Images rendered in addition to colour and alpha.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Channels {
    /// Depth along the optical axis, composited like a colour on 0; divide by alpha for the expected depth.
    pub depth: bool,
    /// The per-Gaussian scalar, composited like a colour on 0.
    pub scalar: bool,
    /// Depth of the Gaussian that reduces the transmittance to one half or below; 0 if none does.
    pub median_depth: bool,
}

/// Which gradients are stopped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct StoppedGradients {
    /// The scalar image has a gradient with respect to the scalars only (ATSplat's stop-gradient on its uncertainty
    /// map).
    pub scalar_stops: bool,
    /// View directions are treated as constants, so that colour has no gradient with respect to the means through the
    /// spherical harmonics.
    pub directions_stop: bool,
}
