use serde::{Deserialize, Serialize};

/// The constants of the renderer behind a protocol's published numbers.
///
/// Other constants give other numbers, so they are recorded with every result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RendererConvention {
    /// Name and version of the rasteriser.
    pub rasteriser: String,
    /// Gaussians nearer than this are culled.
    pub near_cull: f64,
    /// The unit of [`Self::near_cull`].
    pub near_cull_unit: NearCull,
    /// Added to both diagonal entries of the projected covariance, in square pixels.
    pub dilation: f64,
    /// Largest opacity of one Gaussian at one pixel.
    pub alpha_max: f64,
    /// Inverse of the alpha below which a Gaussian is skipped at a pixel.
    pub alpha_min_inverse: f64,
    /// Blending stops before the transmittance falls below this.
    pub transmittance_stop: f64,
    /// Extent of a Gaussian, in standard deviations.
    pub extent_sigmas: f64,
    /// Background colour, sRGB-encoded, in [0, 1].
    pub background: [f64; 3],
    /// How the principal point is treated.
    pub principal_point: RendererPrincipalPoint,
}

/// The constants in which the renderer of one method differs from the preset's; those that are `None` are the preset's.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RendererOverrides {
    /// [`RendererConvention::rasteriser`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rasteriser: Option<String>,
    /// [`RendererConvention::near_cull`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub near_cull: Option<f64>,
    /// [`RendererConvention::near_cull_unit`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub near_cull_unit: Option<NearCull>,
    /// [`RendererConvention::dilation`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dilation: Option<f64>,
    /// [`RendererConvention::alpha_max`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alpha_max: Option<f64>,
    /// [`RendererConvention::alpha_min_inverse`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alpha_min_inverse: Option<f64>,
    /// [`RendererConvention::transmittance_stop`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transmittance_stop: Option<f64>,
    /// [`RendererConvention::extent_sigmas`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub extent_sigmas: Option<f64>,
    /// [`RendererConvention::background`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub background: Option<[f64; 3]>,
    /// [`RendererConvention::principal_point`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub principal_point: Option<RendererPrincipalPoint>,
}

impl RendererOverrides {
    /// A preset's renderer with these constants in place of its own.
    #[must_use]
    pub fn applied_to(&self, renderer: &RendererConvention) -> RendererConvention {
        RendererConvention {
            rasteriser: self.rasteriser.as_ref().unwrap_or(&renderer.rasteriser).clone(),
            near_cull: self.near_cull.unwrap_or(renderer.near_cull),
            near_cull_unit: self.near_cull_unit.unwrap_or(renderer.near_cull_unit),
            dilation: self.dilation.unwrap_or(renderer.dilation),
            alpha_max: self.alpha_max.unwrap_or(renderer.alpha_max),
            alpha_min_inverse: self.alpha_min_inverse.unwrap_or(renderer.alpha_min_inverse),
            transmittance_stop: self.transmittance_stop.unwrap_or(renderer.transmittance_stop),
            extent_sigmas: self.extent_sigmas.unwrap_or(renderer.extent_sigmas),
            background: self.background.unwrap_or(renderer.background),
            principal_point: self.principal_point.unwrap_or(renderer.principal_point),
        }
    }
}

/// The unit of a near-culling distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NearCull {
    /// Scene units.
    SceneUnits,
    /// Multiples of the near plane: pixelSplat, MVSplat and DepthSplat scale the scene by 1/near first
    /// (depthsplat `src/model/decoder/cuda_splatting.py:62-70`).
    NearPlanes,
}

/// How a renderer treats the principal point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RendererPrincipalPoint {
    /// A symmetric frustum from the field of view: `cx`, `cy` are ignored (depthsplat
    /// `src/model/decoder/cuda_splatting.py:16-43`).
    Ignored,
    /// The full intrinsics (gsplat).
    Used,
}
