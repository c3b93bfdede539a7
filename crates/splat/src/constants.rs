use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::cpu::to_f32;
use crate::{MAX_SH_DEGREE, SplatError};

/// Largest magnitude of a drawn Gaussian's colour channels and scalar; a Gaussian beyond it counts as invalid. Far
/// above any real colour, and far enough below f32's maximum that no sum or gradient overflows.
pub const LARGEST_CHANNEL: f64 = 1e12;

/// Smallest [`RendererConstants::min_alpha`]: the f32 exponential is cut off at 2⁻²⁰, so a smaller threshold would turn
/// a Gaussian's falloff into a plateau.
pub const SMALLEST_MIN_ALPHA: f64 = 1e-6;

/// Every constant and rule in which published rasterizers differ; a result is not reproducible without them.
///
/// The default is exact: every pixel where a Gaussian reaches `min_alpha` is drawn, and all of the camera matrix K is
/// used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RendererConstants {
    /// Name of the preset, or the user's own name for these values.
    pub name: String,
    /// Smallest depth that is drawn, in scene units; at least 0.
    pub near: f64,
    /// Largest depth that is drawn; at least `near`, possibly infinite.
    pub far: f64,
    /// Whether a centre at exactly `near` is culled (diff-gaussian-rasterization) or drawn (gsplat).
    pub near_is_culled: bool,
    /// Variance added to both screen axes, in square pixels; at least 0.
    pub blur: f64,
    /// Upper clamp of one Gaussian's alpha at a pixel; below 1, also in f32.
    pub max_alpha: f64,
    /// Contributions below this alpha are skipped; from [`SMALLEST_MIN_ALPHA`] to `max_alpha`.
    pub min_alpha: f64,
    /// A pixel stops before the Gaussian that would reduce its transmittance to this or below; from 0 to below 1 − `max_alpha`,
    /// which an opaque Gaussian leaves: otherwise it would never be drawn.
    pub min_transmittance: f64,
    /// How far beyond the image border the projection's Jacobian is evaluated at the true position before it is
    /// clamped, as a fraction of half the visible width (lens distortion included): 0.3 in every published rasterizer;
    /// at least 0.
    pub jacobian_margin: f64,
    /// Lower clamp of the factor by which anti-aliasing reduces opacity; in [0, 1].
    pub min_compensation: f64,
    /// Which pixels a Gaussian may reach.
    pub extent: Extent,
    /// Which principal point the projection uses.
    pub principal_point: PrincipalPoint,
    /// Axis order in which spherical harmonics are evaluated.
    pub sh_axes: ShAxes,
    /// Highest degree of spherical harmonics that is evaluated, at most [`MAX_SH_DEGREE`], which a file without it means:
    /// diff-gaussian-rasterization and its modified version have no degree 4, whatever the Gaussians store.
    #[serde(default = "every_degree", skip_serializing_if = "is_every_degree")]
    pub max_sh_degree: u8,
    /// Gradient of clamped values.
    pub clamped_gradient: ClampedGradient,
}

const fn every_degree() -> u8 {
    MAX_SH_DEGREE
}

/// Records of constants without a limit stay as they were before there was one.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
const fn is_every_degree(degree: &u8) -> bool {
    *degree == MAX_SH_DEGREE
}

/// Thresholds of alpha and transmittance as rasterizers compile them in: rounded to f32. With them, two Gaussians of alpha
/// 0.99 leave less than 1e-4 of the light behind them, and the second is not drawn; in f64, 0.01² exceeds 1e-4.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Thresholds {
    pub(crate) max_alpha: f64,
    pub(crate) min_alpha: f64,
    pub(crate) min_transmittance: f64,
}

/// Which pixels a Gaussian may reach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Extent {
    /// Every pixel at which it has at least `min_alpha`; gsplat from 1.5 on.
    Exact,
    /// The tiles of 16×16 pixels that touch a square of three standard deviations of its longer axis
    /// (diff-gaussian-rasterization `forward.cu:229-240`).
    ThreeSigmaTiles,
}

/// Which principal point the projection uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PrincipalPoint {
    /// The camera's.
    Full,
    /// The image centre, regardless of the camera, with the camera's focal lengths (3DGS `utils/graphics_utils.py`: `focal2fov`).
    Centre,
    /// The image centre, regardless of the camera, with the focal lengths of a centred image that has the camera's
    /// [field of view](atsplat_camera::NormalizedIntrinsics::field_of_view) (pixelSplat and its descendants `get_fov`). The field of
    /// view depends on the principal point: where that is off the centre, they are longer than the camera's.
    FieldOfView,
}

/// Axis order in which spherical harmonics are evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShAxes {
    /// 3DGS's: (x, y, z).
    Standard,
    /// e3nn's order, (z, x, y), in the rasterizer of pixelSplat, MVSplat and DepthSplat. Its forward pass differs in one function of
    /// degree 3: [`RenderOptions::differing_harmonics`](crate::RenderOptions::differing_harmonics).
    E3nn,
}

impl ShAxes {
    /// The direction in which the basis is evaluated, of a unit direction in world axes.
    pub(crate) const fn permuted(self, direction: DVec3) -> DVec3 {
        match self {
            Self::Standard => direction,
            Self::E3nn => DVec3::new(direction.z, direction.x, direction.y),
        }
    }

    /// A rotation of the world in the axes in which the basis is evaluated: `P R Pᵀ` for the permutation `P` of [`Self::permuted`].
    pub(crate) fn rotation(self, world: DMat3) -> DMat3 {
        // Permutes the rows, then, transposed, the columns.
        let rows = |matrix: DMat3| {
            DMat3::from_cols(self.permuted(matrix.x_axis), self.permuted(matrix.y_axis), self.permuted(matrix.z_axis))
        };
        rows(rows(world).transpose()).transpose()
    }
}

/// Gradient of clamped values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ClampedGradient {
    /// The derivative of the computed function: zero through an active clamp (gsplat).
    Exact,
    /// As in diff-gaussian-rasterization: alpha's clamp is ignored, and the Jacobian's clamp holds the off-axis
    /// distance constant (`backward.cu:498-554`, `backward.cu:148-276`).
    Inria,
}

/// A preset's name and its values, which do not contain the name yet.
type Named = (&'static str, fn() -> RendererConstants);

/// The presets by name; the first is the default.
const NAMED: &[Named] = &[
    ("exact", gsplat),
    ("gsplat-1.5", gsplat),
    ("gsplat-1.6", || RendererConstants { max_alpha: 0.99, min_compensation: 0.005, ..gsplat() }),
    ("inria", inria),
    ("pixelsplat-family", || RendererConstants {
        principal_point: PrincipalPoint::FieldOfView,
        sh_axes: ShAxes::E3nn,
        ..inria()
    }),
    // What `atsplat fit` optimises with, in the antialiased mode.
    ("mip-splatting", || RendererConstants { blur: RendererConstants::MIP_BLUR, ..gsplat() }),
];

/// gsplat 1.5, without a name.
const fn gsplat() -> RendererConstants {
    RendererConstants {
        name: String::new(),
        near: 0.01,
        far: 1e10,
        near_is_culled: false,
        blur: 0.3,
        max_alpha: 0.999,
        min_alpha: 1.0 / 255.0,
        min_transmittance: 1e-4,
        jacobian_margin: 0.3,
        min_compensation: 0.0,
        extent: Extent::Exact,
        principal_point: PrincipalPoint::Full,
        sh_axes: ShAxes::Standard,
        max_sh_degree: MAX_SH_DEGREE,
        clamped_gradient: ClampedGradient::Exact,
    }
}

/// diff-gaussian-rasterization, without a name.
fn inria() -> RendererConstants {
    RendererConstants {
        near: 0.2,
        far: f64::INFINITY,
        near_is_culled: true,
        max_alpha: 0.99,
        // √0.000025, in the versions with anti-aliasing.
        min_compensation: 0.005,
        extent: Extent::ThreeSigmaTiles,
        principal_point: PrincipalPoint::Centre,
        max_sh_degree: RendererConstants::INRIA_SH_DEGREE,
        clamped_gradient: ClampedGradient::Inria,
        ..gsplat()
    }
}

impl RendererConstants {
    /// Highest degree that diff-gaussian-rasterization and its modified version evaluate: 16 coefficients (`forward.cu`,
    /// `computeColorFromSH`).
    pub const INRIA_SH_DEGREE: u8 = 3;

    /// Blur of Mip-Splatting's 2D filter, in square pixels.
    pub const MIP_BLUR: f64 = 0.1;

    /// Names accepted by [`Self::named`].
    pub fn preset_names() -> impl Iterator<Item = &'static str> {
        NAMED.iter().map(|(name, _)| *name)
    }

    /// [`Self::preset_names`] in one line, as errors list them.
    pub fn listed_presets() -> String {
        Self::preset_names().collect::<Vec<_>>().join(", ")
    }

    /// A preset by name, `None` for a name outside [`Self::preset_names`].
    pub fn named(name: &str) -> Option<Self> {
        let (name, constants) = NAMED.iter().find(|(known, _)| *known == name)?;
        Some(Self { name: (*name).to_owned(), ..constants() })
    }

    /// Checks the ranges; every backend calls this first. Values outside them give empty images, divisions by zero, or
    /// results that differ between backends.
    ///
    /// # Errors
    /// [`SplatError::Constants`] naming the first field that is outside its range.
    pub fn check(&self) -> Result<(), SplatError> {
        const LARGEST: f64 = f32::MAX as f64;
        const BELOW_ONE: f64 = 1f32.next_down() as f64;
        // In f32, as renderers compare.
        let below_opaque = f64::from((1.0 - to_f32(self.max_alpha)).next_down());
        let ranges = [
            ("near", self.near, 0.0, LARGEST),
            ("far", self.far, self.near, f64::INFINITY),
            ("blur", self.blur, 0.0, LARGEST),
            ("max-alpha", self.max_alpha, SMALLEST_MIN_ALPHA, BELOW_ONE),
            ("min-alpha", self.min_alpha, SMALLEST_MIN_ALPHA, self.max_alpha),
            ("min-transmittance", self.min_transmittance, 0.0, below_opaque),
            ("jacobian-margin", self.jacobian_margin, 0.0, LARGEST),
            ("min-compensation", self.min_compensation, 0.0, 1.0),
            ("max-sh-degree", self.max_sh_degree.into(), 0.0, MAX_SH_DEGREE.into()),
        ];
        match ranges.into_iter().find(|(_, found, least, most)| !(least..=most).contains(&found)) {
            Some((field, found, least, most)) => Err(SplatError::Constants { field, least, most, found }),
            None => Ok(()),
        }
    }

    /// The thresholds in f64, of the values that f32 code compares with.
    pub(crate) fn thresholds(&self) -> Thresholds {
        let [max_alpha, min_alpha, min_transmittance] =
            [self.max_alpha, self.min_alpha, self.min_transmittance].map(|value| f64::from(to_f32(value)));
        Thresholds { max_alpha, min_alpha, min_transmittance }
    }

    /// Whether a Gaussian with its centre at this depth is drawn. False for NaN and beyond [`LARGEST_CHANNEL`], because
    /// depth is composited too.
    pub fn keeps_depth(&self, depth: f64) -> bool {
        let beyond_near = if self.near_is_culled { depth > self.near } else { depth >= self.near };
        beyond_near && depth <= self.far && depth <= LARGEST_CHANNEL
    }
}

impl Default for RendererConstants {
    /// The preset `exact`.
    fn default() -> Self {
        Self::preset_names().next().and_then(Self::named).unwrap_or_else(|| unreachable!("the first preset exists"))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;

    #[test]
    fn presets_are_found_by_name() {
        for name in RendererConstants::preset_names() {
            assert_eq!(RendererConstants::named(name).map(|preset| preset.name).as_deref(), Some(name));
        }
        assert_eq!(RendererConstants::named("brush"), None);
        let mip = RendererConstants::named("mip-splatting").unwrap();
        assert_eq!(mip, RendererConstants { name: mip.name.clone(), blur: 0.1, ..RendererConstants::default() });
        let [exact, older, newer] =
            ["exact", "gsplat-1.5", "gsplat-1.6"].map(|name| RendererConstants::named(name).unwrap());
        assert_eq!(exact, RendererConstants { name: exact.name.clone(), ..older });
        assert!(newer.max_alpha < exact.max_alpha && newer.max_sh_degree == 4);
    }

    #[test]
    fn presets_are_documented() {
        let page = include_str!("../../../docs/rendering.md");
        let python = include_str!("../../python/python/atsplat/rendering.py");
        let line = page.lines().find(|line| line.starts_with("| constants | ")).unwrap();
        for name in RendererConstants::preset_names() {
            assert!(line.contains(&format!("`{name}`")), "docs/rendering.md lacks {name}");
            assert!(python.contains(&format!("``{name}``")), "rendering.py lacks {name}");
        }
    }

    #[test]
    fn near_plane_is_culled_only_where_the_preset_says() {
        let gsplat = RendererConstants::default();
        let inria = RendererConstants::named("inria").unwrap();
        assert!(gsplat.keeps_depth(0.01) && !gsplat.keeps_depth(0.009_999));
        assert!(!inria.keeps_depth(0.2) && inria.keeps_depth(0.200_001));
        assert!(!gsplat.keeps_depth(f64::NAN) && !inria.keeps_depth(f64::NAN));
    }

    /// Files of older versions have no degree; those of presets without a limit still have none.
    #[test]
    fn a_file_without_a_degree_means_all() {
        for (preset, written) in
            [("exact", None), ("gsplat-1.6", None), ("inria", Some(3)), ("pixelsplat-family", Some(3))]
        {
            let constants = RendererConstants { far: 100.0, ..RendererConstants::named(preset).unwrap() };
            let mut json = serde_json::to_value(&constants).unwrap();
            assert_eq!(json.get("max-sh-degree").and_then(Value::as_u64), written, "{preset}");
            assert_eq!(serde_json::from_value::<RendererConstants>(json.clone()).unwrap(), constants, "{preset}");
            json.as_object_mut().unwrap().remove("max-sh-degree");
            let read: RendererConstants = serde_json::from_value(json).unwrap();
            assert_eq!(read, RendererConstants { max_sh_degree: 4, ..constants }, "{preset}");
        }
        let beyond = RendererConstants { max_sh_degree: 5, ..RendererConstants::default() }.check();
        assert!(matches!(beyond, Err(SplatError::Constants { field: "max-sh-degree", .. })), "{beyond:?}");
    }

    #[test]
    fn every_preset_passes_the_check() {
        for name in RendererConstants::preset_names() {
            RendererConstants::named(name).unwrap().check().unwrap();
        }
        let max_alpha = f64::from(1f32.next_down());
        let ends = RendererConstants { near: 0.0, far: 0.0, max_alpha, min_transmittance: 0.0, ..smallest() };
        ends.check().unwrap();
    }

    /// In f32, 1 − 0.99 is below 0.01, and 1 − 0.75 equals 0.25.
    #[test]
    fn an_opaque_gaussian_leaves_more_than_the_smallest_transmittance() {
        for (max_alpha, most, rejected) in [(0.99, 0.009_999, 0.01), (0.999, 0.000_999, 0.001), (0.75, 0.249_999, 0.25)]
        {
            let of = |min_transmittance| {
                RendererConstants { max_alpha, min_transmittance, ..RendererConstants::default() }.check()
            };
            of(most).unwrap();
            for found in [rejected, 0.5] {
                let error = of(found).unwrap_err();
                assert!(
                    matches!(error, SplatError::Constants { field: "min-transmittance", .. }),
                    "{max_alpha}: {error}"
                );
            }
        }
        let error = RendererConstants { min_transmittance: 0.01, ..RendererConstants::named("inria").unwrap() }.check();
        let text = "constants: min-transmittance: expected 0 to 0.009999989531934261, found 0.01";
        assert_eq!(error.unwrap_err().to_string(), text);
    }

    fn smallest() -> RendererConstants {
        let constants = RendererConstants::default();
        RendererConstants { min_alpha: SMALLEST_MIN_ALPHA, blur: 0.0, jacobian_margin: 0.0, ..constants }
    }

    #[test]
    fn the_error_names_the_field_out_of_range() {
        type Set = fn(&mut RendererConstants, f64);
        const INFINITY: f64 = f64::INFINITY;
        let fields: [(&str, Set, &[f64]); 8] = [
            ("near", |constants, value| constants.near = value, &[-1e-9, INFINITY]),
            ("far", |constants, value| constants.far = value, &[0.009, -INFINITY]),
            ("blur", |constants, value| constants.blur = value, &[-0.1, INFINITY]),
            ("max-alpha", |constants, value| constants.max_alpha = value, &[1.000_001, 1.0, 0.999_999_999, 0.0, -1.0]),
            ("min-alpha", |constants, value| constants.min_alpha = value, &[0.0, -0.1, 9.9e-7, 0.9991]),
            ("min-transmittance", |constants, value| constants.min_transmittance = value, &[-1e-4, 0.001, 1.0]),
            ("jacobian-margin", |constants, value| constants.jacobian_margin = value, &[-0.3, INFINITY]),
            ("min-compensation", |constants, value| constants.min_compensation = value, &[-0.005, 1.1]),
        ];
        for (name, set, values) in fields {
            for value in values.iter().copied().chain([f64::NAN]) {
                let mut constants = RendererConstants::default();
                set(&mut constants, value);
                let outcome = constants.check();
                assert!(
                    matches!(outcome, Err(SplatError::Constants { field, .. }) if field == name),
                    "{name} = {value}: {outcome:?}"
                );
            }
        }
    }
}
