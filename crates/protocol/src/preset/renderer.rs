use serde::{Deserialize, Serialize};

use super::older;

/// The constants of the renderer behind a protocol's published numbers.
///
/// Other constants give other numbers, so they are recorded with every result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", try_from = "RendererTable")]
pub struct RendererConvention {
    /// Name and version of the rasteriser, for readers: no constant follows from it.
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
    /// Which pixels a Gaussian may reach.
    pub extent: RendererExtent,
    /// Highest degree of spherical harmonics that is evaluated, at most [`Self::MAX_SH_DEGREE`]: 3 in diff-gaussian-rasterization and
    /// its modified versions, whatever the Gaussians store.
    pub max_sh_degree: u8,
    /// Background colour, sRGB-encoded, in [0, 1].
    pub background: [f64; 3],
    /// How the principal point is treated.
    pub principal_point: RendererPrincipalPoint,
}

impl RendererConvention {
    /// Highest degree of spherical harmonics that any renderer evaluates.
    pub const MAX_SH_DEGREE: u8 = 4;
}

/// The constants in which the renderer of one method differs from the preset's; those that are `None` are the preset's.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", try_from = "RendererTable")]
pub struct RendererOverrides {
    /// [`RendererConvention::rasteriser`]; with it, a degree of spherical harmonics is stated too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rasteriser: Option<String>,
    /// [`RendererConvention::near_cull`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub near_cull: Option<f64>,
    /// [`RendererConvention::near_cull_unit`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub near_cull_unit: Option<NearCull>,
    /// [`RendererConvention::dilation`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dilation: Option<f64>,
    /// [`RendererConvention::alpha_max`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alpha_max: Option<f64>,
    /// [`RendererConvention::alpha_min_inverse`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alpha_min_inverse: Option<f64>,
    /// [`RendererConvention::transmittance_stop`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transmittance_stop: Option<f64>,
    /// [`RendererConvention::extent`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extent: Option<RendererExtent>,
    /// [`RendererConvention::max_sh_degree`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_sh_degree: Option<u8>,
    /// [`RendererConvention::background`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background: Option<[f64; 3]>,
    /// [`RendererConvention::principal_point`].
    #[serde(skip_serializing_if = "Option::is_none")]
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
            extent: self.extent.unwrap_or(renderer.extent),
            max_sh_degree: self.max_sh_degree.unwrap_or(renderer.max_sh_degree),
            background: self.background.unwrap_or(renderer.background),
            principal_point: self.principal_point.unwrap_or(renderer.principal_point),
        }
    }
}

impl From<&RendererConvention> for RendererOverrides {
    /// All of a renderer's constants.
    fn from(renderer: &RendererConvention) -> Self {
        Self {
            rasteriser: Some(renderer.rasteriser.clone()),
            near_cull: Some(renderer.near_cull),
            near_cull_unit: Some(renderer.near_cull_unit),
            dilation: Some(renderer.dilation),
            alpha_max: Some(renderer.alpha_max),
            alpha_min_inverse: Some(renderer.alpha_min_inverse),
            transmittance_stop: Some(renderer.transmittance_stop),
            extent: Some(renderer.extent),
            max_sh_degree: Some(renderer.max_sh_degree),
            background: Some(renderer.background),
            principal_point: Some(renderer.principal_point),
        }
    }
}

/// A table of a renderer's constants in a preset, or in one of an older version, which states the extent in standard deviations.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(super) struct RendererTable {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) rasteriser: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) near_cull: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) near_cull_unit: Option<NearCull>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) dilation: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) alpha_max: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) alpha_min_inverse: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) transmittance_stop: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) extent: Option<RendererExtent>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) extent_sigmas: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) max_sh_degree: Option<u8>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) background: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) principal_point: Option<RendererPrincipalPoint>,
}

impl TryFrom<RendererTable> for RendererOverrides {
    type Error = String;

    fn try_from(table: RendererTable) -> Result<Self, String> {
        let extent = match (table.extent, table.extent_sigmas) {
            (Some(_), Some(_)) => return Err("extent and extent-sigmas, expected extent alone".to_owned()),
            (extent, None) => extent,
            (None, Some(sigmas)) => Some(older::extent(sigmas)?),
        };
        Ok(Self {
            rasteriser: table.rasteriser,
            near_cull: table.near_cull,
            near_cull_unit: table.near_cull_unit,
            dilation: table.dilation,
            alpha_max: table.alpha_max,
            alpha_min_inverse: table.alpha_min_inverse,
            transmittance_stop: table.transmittance_stop,
            extent,
            max_sh_degree: table.max_sh_degree,
            background: table.background,
            principal_point: table.principal_point,
        })
    }
}

impl TryFrom<RendererTable> for RendererConvention {
    type Error = String;

    fn try_from(table: RendererTable) -> Result<Self, String> {
        let is_older = table.extent_sigmas.is_some();
        let constants = RendererOverrides::try_from(table)?;
        let rasteriser = stated("rasteriser", constants.rasteriser)?;
        let max_sh_degree = match constants.max_sh_degree {
            None if is_older => older::sh_degree(&rasteriser),
            degree => stated("max-sh-degree", degree)?,
        };
        Ok(Self {
            rasteriser,
            near_cull: stated("near-cull", constants.near_cull)?,
            near_cull_unit: stated("near-cull-unit", constants.near_cull_unit)?,
            dilation: stated("dilation", constants.dilation)?,
            alpha_max: stated("alpha-max", constants.alpha_max)?,
            alpha_min_inverse: stated("alpha-min-inverse", constants.alpha_min_inverse)?,
            transmittance_stop: stated("transmittance-stop", constants.transmittance_stop)?,
            extent: stated("extent", constants.extent)?,
            max_sh_degree,
            background: stated("background", constants.background)?,
            principal_point: stated("principal-point", constants.principal_point)?,
        })
    }
}

/// A constant that must be there, or the parser's message about a field that is not.
fn stated<T>(field: &str, constant: Option<T>) -> Result<T, String> {
    constant.ok_or_else(|| format!("missing field `{field}`"))
}

/// Which pixels a Gaussian may reach in a renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RendererExtent {
    /// The tiles of 16×16 pixels that touch a square of three standard deviations of its longer axis
    /// (diff-gaussian-rasterization `forward.cu:229-240`).
    ThreeSigmaTiles,
    /// Every pixel at which it has at least the smallest alpha (gsplat from 1.5 on): up to 3.33 standard deviations for 1/255.
    Exact,
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
