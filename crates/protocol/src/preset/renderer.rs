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
