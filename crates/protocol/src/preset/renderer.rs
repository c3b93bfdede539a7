use serde::{Deserialize, Serialize};

/// The constants of the renderer behind a protocol's published numbers.
///
/// A render with other constants is another number; they are recorded with every result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RendererConvention {
    /// Name and version of the rasteriser.
    pub rasteriser: String,
    /// Gaussians nearer than this are left out.
    pub near_cull: f64,
    /// What [`Self::near_cull`] is measured in.
    pub near_cull_unit: NearCull,
    /// Added to both diagonal entries of the projected covariance, in square pixels.
    pub dilation: f64,
    /// Largest opacity of one Gaussian at one pixel.
    pub alpha_max: f64,
    /// Gaussians fainter than one part in this many at a pixel are skipped there.
    pub alpha_min_inverse: f64,
    /// Blending stops before the transmittance falls below this.
    pub transmittance_stop: f64,
    /// How far a Gaussian reaches, in standard deviations.
    pub extent_sigmas: f64,
    /// Colour behind everything, sRGB-encoded, in [0, 1].
    pub background: [f64; 3],
    /// What becomes of the principal point.
    pub principal_point: RendererPrincipalPoint,
}

/// What a near cull is measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NearCull {
    /// Scene units.
    SceneUnits,
    /// Multiples of the near plane: pixelSplat, MVSplat and DepthSplat scale the scene by 1/near first
    /// (depthsplat `src/model/decoder/cuda_splatting.py:62-70`).
    NearPlanes,
}

/// What a renderer does with the principal point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RendererPrincipalPoint {
    /// A symmetric frustum from the field of view: `cx`, `cy` are ignored (depthsplat
    /// `src/model/decoder/cuda_splatting.py:16-43`).
    Ignored,
    /// The full intrinsics (gsplat).
    Used,
}
