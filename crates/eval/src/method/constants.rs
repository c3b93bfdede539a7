use atsplat_protocol::{NearCull, NearFar, RendererConvention, RendererPrincipalPoint};
use atsplat_splat::{ClampedGradient, Extent, PrincipalPoint, RendererConstants, ShAxes};

use crate::EvalError;
use crate::tradeoff::RendererKnobs;

/// Which renderer constants a method uses.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum ConstantsChoice {
    /// The protocol's, with which its published numbers were computed (see [`constants_of`]).
    #[default]
    FromPreset,
    /// Fixed constants for every protocol; near and far planes are in the trial's scene units.
    Fixed(RendererConstants),
    /// The protocol's constants, or those of a named preset, with overrides.
    Changed(ChangedConstants),
}

/// Overrides of the protocol's constants, with a name for records.
#[derive(Clone, Debug, PartialEq)]
pub struct ChangedConstants {
    name: String,
    knobs: RendererKnobs,
}

impl ChangedConstants {
    /// Overrides that apply to any protocol.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for values that no renderer accepts.
    pub fn new(knobs: RendererKnobs) -> Result<Self, EvalError> {
        let name = knobs
            .applied(&RendererConstants { name: "of the preset".to_owned(), ..RendererConstants::default() })?
            .name;
        Ok(Self { name, knobs })
    }

    /// The overrides.
    pub const fn knobs(&self) -> &RendererKnobs {
        &self.knobs
    }
}

impl ConstantsChoice {
    /// The constants for a trial of this protocol.
    pub fn of(&self, convention: &RendererConvention, planes: NearFar) -> RendererConstants {
        match self {
            Self::FromPreset => constants_of(convention, planes),
            Self::Fixed(constants) => constants.clone(),
            Self::Changed(changed) => changed.knobs.applied_unchecked(&constants_of(convention, planes)),
        }
    }

    /// Name in records.
    pub fn name(&self) -> &str {
        match self {
            Self::FromPreset => "of the preset",
            Self::Fixed(constants) => &constants.name,
            Self::Changed(changed) => &changed.name,
        }
    }
}

/// A protocol's rendering convention as constants of our renderer. `planes` are the trial's, in its normalised world.
///
/// - A near cull in near planes is a multiple of the trial's near plane; one in scene units is used as is. A centre
///   exactly on it is culled, as in diff-gaussian-rasterization. There is no far cull.
/// - An extent of 3 standard deviations is that rasterizer's, applied by tiles; any other extent draws everything that
///   reaches the smallest alpha.
/// - An ignored principal point is the image's centre.
/// - Spherical harmonics use 3DGS's axes: their order is a property of the Gaussians, not of the protocol.
pub fn constants_of(convention: &RendererConvention, planes: NearFar) -> RendererConstants {
    const THREE_SIGMAS: f64 = 3.0;
    let by_tiles = convention.extent_sigmas.total_cmp(&THREE_SIGMAS).is_eq();
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
        extent: if by_tiles { Extent::ThreeSigmaTiles } else { Extent::Exact },
        principal_point: match convention.principal_point {
            RendererPrincipalPoint::Ignored => PrincipalPoint::Centre,
            RendererPrincipalPoint::Used => PrincipalPoint::Full,
        },
        sh_axes: ShAxes::Standard,
        clamped_gradient: ClampedGradient::Exact,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_protocol::Preset;

    /// Compares with the renderer's own preset of the published rasterizer.
    #[test]
    fn published_protocols_use_the_published_rasterizer() {
        let preset = Preset::named("re10k-2v-256").unwrap();
        let found = constants_of(&preset.renderer, NearFar { near: 1.0, far: 100.0 });
        let inria = RendererConstants::named("inria").unwrap();
        let expected = RendererConstants {
            name: preset.renderer.rasteriser.clone(),
            min_compensation: 0.0,
            clamped_gradient: ClampedGradient::Exact,
            ..inria
        };
        assert_eq!(found, expected);
    }

    #[test]
    fn near_cull_is_converted_from_its_unit() {
        let mut convention = Preset::named("re10k-2v-256").unwrap().renderer;
        let planes = NearFar { near: 0.5, far: 100.0 };
        let near = |convention: &RendererConvention| constants_of(convention, planes).near;
        atsplat_numeric::Tolerance::EXACT.assert([near(&convention)], [0.1], "in near planes");
        convention.near_cull_unit = NearCull::SceneUnits;
        convention.principal_point = RendererPrincipalPoint::Used;
        convention.extent_sigmas = 3.33;
        atsplat_numeric::Tolerance::EXACT.assert([near(&convention)], [0.2], "in scene units");
        let constants = constants_of(&convention, planes);
        assert_eq!((constants.extent, constants.principal_point), (Extent::Exact, PrincipalPoint::Full));
        constants.check().unwrap();
        let fixed = ConstantsChoice::Fixed(RendererConstants::default());
        assert_eq!(fixed.of(&convention, planes), RendererConstants::default());
    }
}
