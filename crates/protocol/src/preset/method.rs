use std::borrow::Cow;
use std::collections::BTreeSet;

use atsplat_camera::{Camera, ImageSize, NormalizedIntrinsics};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{PoseNormalisation, Preset, RendererConvention, RendererOverrides};
use crate::ProtocolError;

/// Near and far plane, in the units of the normalised scene unless the normalisation scales them too.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct NearFar {
    /// Distance of the near plane; > 0.
    pub near: f64,
    /// Distance of the far plane; > near.
    pub far: f64,
}

/// Planes by disparity, in place of fixed ones: where a movement by the largest distance between two context views moves a point
/// by so many pixels (pixelSplat `src/dataset/shims/bounds_shim.py`, called in `src/model/encoder/encoder_epipolar.py`).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct DisparityPlanes {
    /// At the near plane, in multiples of the image's shorter side; > `far_pixels`.
    pub near_sides: f64,
    /// At the far plane, in pixels; > 0.
    pub far_pixels: f64,
}

impl DisparityPlanes {
    /// The planes for context views of this size, in the unit of their cameras.
    pub fn of(&self, context: &[Camera], size: ImageSize) -> NearFar {
        // As published, so that views in one place have planes.
        const MIN: f64 = 1e-6;
        let centres: Vec<DVec3> = context.iter().map(|camera| camera.camera_from_world.inverse().centre()).collect();
        let distances = centres.iter().flat_map(|a| centres.iter().map(|b| a.distance(*b)));
        let baseline = distances.fold(MIN, |most, distance| if distance > most { distance } else { most });
        let [width, height] = [size.width, size.height].map(f64::from);
        let pixels = context.iter().flat_map(|camera| {
            let NormalizedIntrinsics { fx, fy, .. } = camera.intrinsics;
            [1.0 / (width * fx), 1.0 / (height * fy)]
        });
        let mean_pixel = pixels.sum::<f64>() / (2 * context.len()) as f64;
        let shorter = f64::from(size.width.min(size.height));
        let plane = |disparity: f64| baseline / (disparity * mean_pixel);
        NearFar { near: plane(self.near_sides * shorter), far: plane(self.far_pixels) }
    }
}

/// The settings one method published under a protocol, if they differ from the preset's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct MethodSetting {
    /// The method's name, as in its paper.
    pub method: String,
    /// Its pose normalisation.
    pub pose_normalisation: PoseNormalisation,
    /// Its near and far plane.
    pub near_far: NearFar,
    /// What replaces them, in the network and the renderer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub disparity_planes: Option<DisparityPlanes>,
    /// Repository file that states these settings.
    pub source: String,
    /// How its renderer differs from the preset's; `None` if it does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub renderer: Option<RendererOverrides>,
}

/// The settings that a method uses: its published ones, or the preset's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffectiveSetting<'a> {
    /// Pose normalisation.
    pub pose_normalisation: &'a PoseNormalisation,
    /// Near and far plane.
    pub near_far: NearFar,
    /// What replaces them.
    pub disparity_planes: Option<DisparityPlanes>,
}

impl Preset {
    /// The method whose settings are a preset's own.
    pub const OWN_METHOD: &'static str = "ATSplat";

    fn published_by(&self, method: &str) -> Option<&MethodSetting> {
        self.methods.iter().find(|setting| setting.method.eq_ignore_ascii_case(method))
    }

    /// Whether the preset states the settings of `method`, which is then listed or ATSplat. Names are case-insensitive.
    pub fn has_setting_of(&self, method: &str) -> bool {
        Self::OWN_METHOD.eq_ignore_ascii_case(method) || self.published_by(method).is_some()
    }

    /// Methods whose settings some built-in preset states.
    ///
    /// # Errors
    /// [`ProtocolError`] for a broken preset.
    pub fn methods_with_settings() -> Result<BTreeSet<String>, ProtocolError> {
        let mut methods = BTreeSet::from([Self::OWN_METHOD.to_owned()]);
        for name in Self::names() {
            methods.extend(Self::named(name)?.methods.into_iter().map(|setting| setting.method));
        }
        Ok(methods)
    }

    /// The settings of `method`: the ones it published, or else the preset's. Names are case-insensitive.
    pub fn setting_for(&self, method: &str) -> EffectiveSetting<'_> {
        match self.published_by(method) {
            Some(MethodSetting { pose_normalisation, near_far, disparity_planes, .. }) => {
                EffectiveSetting { pose_normalisation, near_far: *near_far, disparity_planes: *disparity_planes }
            }
            None => EffectiveSetting {
                pose_normalisation: &self.pose_normalisation,
                near_far: self.near_far,
                disparity_planes: None,
            },
        }
    }

    /// How the renderer that `method` published differs from the preset's; `None` if it does not. Names are case-insensitive.
    pub fn renderer_overrides_of(&self, method: &str) -> Option<&RendererOverrides> {
        self.published_by(method)?.renderer.as_ref()
    }

    /// The constants with which the Gaussians of `method` are rendered: the ones it published, or else the preset's. Names are
    /// case-insensitive.
    pub fn renderer_for(&self, method: &str) -> RendererConvention {
        let overrides = self.renderer_overrides_of(method);
        overrides.map_or_else(|| self.renderer.clone(), |overrides| overrides.applied_to(&self.renderer))
    }

    /// The preset whose renderer is [`Self::renderer_for`] `method`; nothing else differs.
    pub fn rendered_for(&self, method: &str) -> Cow<'_, Self> {
        match self.renderer_overrides_of(method) {
            None => Cow::Borrowed(self),
            Some(_) => Cow::Owned(Self { renderer: self.renderer_for(method), ..self.clone() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preset::{NearCull, RendererPrincipalPoint};

    #[test]
    fn listed_methods_override_the_preset() {
        let preset = Preset::named("dl3dv-6v-256x448").unwrap();
        let depthsplat = preset.setting_for("DEPTHSPLAT");
        assert_eq!(depthsplat.near_far, NearFar { near: 0.5, far: 200.0 });
        assert_eq!(*depthsplat.pose_normalisation, PoseNormalisation::None);
        assert_eq!(*preset.setting_for("ATSplat").pose_normalisation, preset.pose_normalisation);
        let stated = ["depthsplat", "atsplat", "MVSplat", "MVSplt"].map(|method| preset.has_setting_of(method));
        assert_eq!(stated, [true, true, false, false], "this preset does not list MVSplat");
        let known = Preset::methods_with_settings().unwrap();
        let known = ["ATSplat", "MVSplat", "MVSplt"].map(|method| known.contains(method));
        assert_eq!(known, [true, true, false]);
    }

    #[test]
    fn a_method_may_have_a_renderer_of_its_own() {
        let preset = Preset::named("re10k-2v-256").unwrap();
        let ilrm = preset.renderer_for("ILRM");
        let expected = RendererConvention {
            rasteriser: "gsplat".to_owned(),
            near_cull: 0.01,
            near_cull_unit: NearCull::SceneUnits,
            alpha_max: 0.999,
            max_sh_degree: 4,
            background: [1.0; 3],
            principal_point: RendererPrincipalPoint::Used,
            ..preset.renderer.clone()
        };
        assert_eq!(ilrm, expected, "what it does not state is the preset's");
        for method in ["ATSplat", "DepthSplat", "pixelSplat", "unheard of"] {
            assert_eq!(preset.renderer_for(method), preset.renderer, "{method}");
            assert!(matches!(preset.rendered_for(method), Cow::Borrowed(_)), "{method}");
        }
        let rendered = preset.rendered_for("iLRM").into_owned();
        assert_eq!(rendered.renderer, expected);
        assert_eq!(Preset { renderer: preset.renderer.clone(), ..rendered }, preset, "nothing else differs");
    }

    /// Each constant of an override replaces that constant and no other.
    #[test]
    fn an_override_changes_its_own_constant_only() {
        let renderer = Preset::named("re10k-2v-256").unwrap().renderer;
        let fields = serde_json::to_value(&renderer).unwrap();
        let other = serde_json::json!({
            "rasteriser": "another", "near-cull": 0.05, "near-cull-unit": "scene-units", "dilation": 0.1, "alpha-max": 0.9,
            "alpha-min-inverse": 100.0, "transmittance-stop": 1e-3, "extent": "exact", "max-sh-degree": 1,
            "background": [0.1, 0.2, 0.3], "principal-point": "used",
        });
        assert_eq!(fields.as_object().unwrap().len(), other.as_object().unwrap().len(), "every constant");
        for (name, value) in other.as_object().unwrap() {
            let overrides = serde_json::json!({ name: value });
            let overrides: RendererOverrides = serde_json::from_value(overrides).unwrap();
            let mut expected = fields.clone();
            expected[name] = value.clone();
            assert_eq!(serde_json::to_value(overrides.applied_to(&renderer)).unwrap(), expected, "{name}");
        }
        assert_eq!(RendererOverrides::default().applied_to(&renderer), renderer);
    }

    /// iLRM and Long-LRM render with gsplat on white; the others as most presets say.
    #[test]
    fn renderers_of_methods_are_the_published_ones() {
        for name in Preset::names() {
            let preset = Preset::named(name).unwrap();
            for setting in &preset.methods {
                let used = preset.renderer_for(&setting.method);
                let names = (used.rasteriser.as_str(), used.max_sh_degree);
                let found = (names, used.background.map(f64::to_bits), used.principal_point);
                let [black, white] = [0.0_f64, 1.0].map(|level| [level.to_bits(); 3]);
                let of_preset = ((preset.renderer.rasteriser.as_str(), 3), black, RendererPrincipalPoint::Ignored);
                let expected = match setting.method.as_str() {
                    "iLRM" | "Long-LRM" => (("gsplat", 4), white, RendererPrincipalPoint::Used),
                    _ => of_preset,
                };
                assert_eq!(found, expected, "{name}, {}", setting.method);
            }
        }
    }

    /// The text of a preset without the key, and so its hash, is what it was before there was one.
    #[test]
    fn a_method_without_a_renderer_is_written_without_the_key() {
        let mut preset = Preset::named("re10k-2v-256").unwrap();
        let with = preset.hash().unwrap();
        preset.methods.iter_mut().for_each(|setting| (setting.renderer, setting.disparity_planes) = (None, None));
        let without = preset.hash().unwrap();
        assert_ne!(with, without, "another background gives other numbers");
        assert!(
            without.to_string().starts_with("da1d9507791f"),
            "{without}: that of stores from before there was the key"
        );
        for setting in &preset.methods {
            let fields = serde_json::to_value(setting).unwrap();
            let names: BTreeSet<&String> = fields.as_object().unwrap().keys().collect();
            assert_eq!(names.len(), 4, "{names:?}");
        }
        let text = preset.to_toml().unwrap();
        assert!(!text.contains("[methods.renderer]"), "{text}");
        assert_eq!(Preset::from_toml(&text).unwrap().hash().unwrap(), without);
    }

    #[test]
    fn a_method_of_a_preset_shows_its_renderer() {
        let text = Preset::named("re10k-2v-256").unwrap().to_toml().unwrap();
        let ilrm = text.split("[[methods]]").find(|part| part.contains("method = \"iLRM\"")).unwrap();
        assert!(ilrm.contains("background = [1.0, 1.0, 1.0]") && ilrm.contains("rasteriser = \"gsplat\""), "{ilrm}");
    }

    #[test]
    fn renderers_of_methods_are_checked() {
        let text = Preset::text_of("re10k-2v-256").unwrap();
        let changed = |from: &str, to: &str| {
            assert!(text.contains(from), "{from}");
            Preset::from_toml(&text.replacen(from, to, 1)).unwrap_err().to_string()
        };
        let error = changed("alpha-max = 0.999", "alpha-max = 1.5");
        assert!(error.contains("methods, iLRM, renderer.alpha-max: expected below 1, found 1.5"), "{error}");
        let error = changed("alpha-max = 0.999", "alpha-most = 0.999");
        assert!(error.contains("unknown field `alpha-most`"), "{error}");
    }
}
