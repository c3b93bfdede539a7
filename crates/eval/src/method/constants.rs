use atsplat_protocol::{NearCull, NearFar, RendererConvention, RendererExtent, RendererPrincipalPoint};
use atsplat_results::MethodRecord;
use atsplat_splat::{ClampedGradient, Extent, MAX_SH_DEGREE, PrincipalPoint, RendererConstants, ShAxes};

use crate::EvalError;
use crate::sweep::ConstantChanges;

/// Which renderer constants a method uses.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum ConstantsChoice {
    /// The protocol's, with which its published numbers were computed (see [`constants_of`]).
    #[default]
    FromPreset,
    /// Fixed constants for every protocol. Their near and far planes are in the unit of the Gaussians as they are given, as in the
    /// rasterizers: the trial's for Gaussians in its world frame, the dataset's for [`GaussianFrame::Dataset`](crate::GaussianFrame::Dataset).
    Fixed(RendererConstants),
    /// The protocol's constants, or those of a named preset, with overrides; planes of a named preset are as of
    /// [`Self::Fixed`], the protocol's are in the trial's unit.
    Changed(ChangedConstants),
}

/// Overrides of the protocol's constants, with a name for records.
#[derive(Clone, Debug, PartialEq)]
pub struct ChangedConstants {
    name: String,
    overrides: ConstantChanges,
}

impl ChangedConstants {
    /// Overrides that apply to any protocol.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for values that no renderer accepts.
    pub fn new(overrides: ConstantChanges) -> Result<Self, EvalError> {
        let of_preset = RendererConstants { name: MethodRecord::OF_PRESET.to_owned(), ..RendererConstants::default() };
        let name = overrides.applied(&of_preset)?.name;
        Ok(Self { name, overrides })
    }

    /// The overrides.
    pub const fn overrides(&self) -> &ConstantChanges {
        &self.overrides
    }
}

impl ConstantsChoice {
    /// The constants for a trial of this protocol, for Gaussians in its world frame.
    pub fn constants_for(&self, convention: &RendererConvention, planes: NearFar) -> RendererConstants {
        self.constants_in_unit(convention, planes, 1.0)
    }

    /// The constants for a trial of this protocol, in whose world the unit of the Gaussians' frame has the length `unit`: near and
    /// far planes that are not the protocol's are converted from it.
    pub(super) fn constants_in_unit(
        &self,
        convention: &RendererConvention,
        planes: NearFar,
        unit: f64,
    ) -> RendererConstants {
        let constants = match self {
            Self::FromPreset => constants_of(convention, planes),
            Self::Fixed(constants) => constants.clone(),
            Self::Changed(changed) => changed.overrides.applied_unchecked(&constants_of(convention, planes)),
        };
        if self.changes_planes() {
            RendererConstants { near: constants.near * unit, far: constants.far * unit, ..constants }
        } else {
            constants
        }
    }

    /// Whether near and far planes are not the protocol's.
    pub(super) const fn changes_planes(&self) -> bool {
        match self {
            Self::FromPreset => false,
            Self::Fixed(_) => true,
            Self::Changed(changed) => changed.overrides.names_constants(),
        }
    }

    /// Name in records.
    pub fn name(&self) -> &str {
        match self {
            Self::FromPreset => MethodRecord::OF_PRESET,
            Self::Fixed(constants) => &constants.name,
            Self::Changed(changed) => &changed.name,
        }
    }
}

/// A protocol's rendering convention as constants of our renderer. `planes` are the trial's, in its normalised world.
///
/// - A near cull in near planes is a multiple of the trial's near plane; one in scene units is used as is. A centre
///   exactly on it is culled, as in diff-gaussian-rasterization. There is no far cull.
/// - An ignored principal point is the image's centre.
/// - Spherical harmonics use 3DGS's axes: their order is a property of the Gaussians, not of the protocol.
pub fn constants_of(convention: &RendererConvention, planes: NearFar) -> RendererConstants {
    let unit = match convention.near_cull_unit {
        NearCull::SceneUnits => 1.0,
        NearCull::NearPlanes => planes.near,
    };
    RendererConstants {
        name: convention.rasteriser.clone(),
        near: convention.near_cull * unit,
        far: f64::INFINITY,
        near_is_culled: true,
        blur: convention.dilation,
        max_alpha: convention.alpha_max,
        min_alpha: 1.0 / convention.alpha_min_inverse,
        min_transmittance: convention.transmittance_stop,
        jacobian_margin: 0.3,
        min_compensation: 0.0,
        extent: match convention.extent {
            RendererExtent::ThreeSigmaTiles => Extent::ThreeSigmaTiles,
            RendererExtent::Exact => Extent::Exact,
        },
        principal_point: match convention.principal_point {
            RendererPrincipalPoint::Ignored => PrincipalPoint::FieldOfView,
            RendererPrincipalPoint::Used => PrincipalPoint::Full,
        },
        sh_axes: ShAxes::Standard,
        max_sh_degree: convention.max_sh_degree,
        clamped_gradient: ClampedGradient::Exact,
    }
}

// What a preset accepts is drawn.
const _: () = assert!(RendererConvention::MAX_SH_DEGREE == MAX_SH_DEGREE);

#[cfg(test)]
mod tests {
    use atsplat_protocol::Preset;

    use super::*;

    /// Compares with the renderer's preset of the published rasterizer.
    #[test]
    fn published_protocols_use_the_published_rasterizer() {
        let preset = Preset::named("re10k-2v-256").unwrap();
        let found = constants_of(&preset.renderer, NearFar { near: 1.0, far: 100.0 });
        let inria = RendererConstants::named("inria").unwrap();
        let expected = RendererConstants {
            name: preset.renderer.rasteriser.clone(),
            min_compensation: 0.0,
            principal_point: PrincipalPoint::FieldOfView,
            clamped_gradient: ClampedGradient::Exact,
            ..inria
        };
        assert_eq!(found, expected);
    }

    #[test]
    fn degree_4_is_drawn_where_the_rasterizer_has_it() {
        let planes = NearFar { near: 1.0, far: 100.0 };
        for (preset, expected) in [("re10k-2v-256", 3), ("dl3dv-6v-256x448", 3), ("dl3dv-12v-512x960", 3)] {
            let preset = Preset::named(preset).unwrap();
            assert_eq!(constants_of(&preset.renderer, planes).max_sh_degree, expected, "{}", preset.name);
        }
        let preset = Preset::named("re10k-2v-256").unwrap();
        let degree = |convention: &RendererConvention| constants_of(convention, planes).max_sh_degree;
        assert_eq!(["iLRM", "DepthSplat"].map(|method| degree(&preset.renderer_for(method))), [4, 3]);
        // A name tells nothing.
        let mut convention = preset.renderer;
        convention.rasteriser = "gsplat 1.5".to_owned();
        assert_eq!(degree(&convention), 3);
        convention.max_sh_degree = 2;
        assert_eq!(degree(&convention), 2);
    }

    /// A unit of the dataset has the length 2.5 in the trial's world.
    #[test]
    fn planes_are_in_the_unit_of_their_source() {
        let convention = Preset::named("re10k-2v-256").unwrap().renderer;
        let planes = NearFar { near: 0.5, far: 100.0 };
        let named = |constants: Option<&str>| {
            let overrides = ConstantChanges {
                constants: constants.map(str::to_owned),
                blur: Some(0.1),
                ..ConstantChanges::default()
            };
            ConstantsChoice::Changed(ChangedConstants::new(overrides).unwrap())
        };
        let gsplat = ConstantsChoice::Fixed(RendererConstants::named("gsplat-1.6").unwrap());
        let inria = ConstantsChoice::Fixed(RendererConstants::named("inria").unwrap());
        let cases = [
            ("the protocol's", ConstantsChoice::FromPreset, [0.1, f64::INFINITY], [0.1, f64::INFINITY]),
            ("the protocol's with a blur", named(None), [0.1, f64::INFINITY], [0.1, f64::INFINITY]),
            ("inria", inria, [0.2, f64::INFINITY], [0.5, f64::INFINITY]),
            ("gsplat", gsplat, [0.01, 1e10], [0.025, 2.5e10]),
            ("gsplat with a blur", named(Some("gsplat-1.6")), [0.01, 1e10], [0.025, 2.5e10]),
        ];
        for (what, choice, in_trial, in_dataset) in cases {
            for (unit, expected) in [(1.0, in_trial), (2.5, in_dataset)] {
                let found = choice.constants_in_unit(&convention, planes, unit);
                assert_eq!([found.near, found.far].map(f64::to_bits), expected.map(f64::to_bits), "{what}, {unit}");
            }
            assert_eq!(
                choice.constants_for(&convention, planes),
                choice.constants_in_unit(&convention, planes, 1.0),
                "{what}"
            );
        }
    }

    #[test]
    fn near_cull_is_converted_from_its_unit() {
        let mut convention = Preset::named("re10k-2v-256").unwrap().renderer;
        let planes = NearFar { near: 0.5, far: 100.0 };
        let near = |convention: &RendererConvention| constants_of(convention, planes).near;
        atsplat_numeric::Tolerance::EXACT.assert([near(&convention)], [0.1], "in near planes");
        convention.near_cull_unit = NearCull::SceneUnits;
        convention.principal_point = RendererPrincipalPoint::Used;
        convention.extent = RendererExtent::Exact;
        atsplat_numeric::Tolerance::EXACT.assert([near(&convention)], [0.2], "in scene units");
        let constants = constants_of(&convention, planes);
        assert_eq!((constants.extent, constants.principal_point), (Extent::Exact, PrincipalPoint::Full));
        constants.check().unwrap();
        let fixed = ConstantsChoice::Fixed(RendererConstants::default());
        assert_eq!(fixed.constants_for(&convention, planes), RendererConstants::default());
    }
}
