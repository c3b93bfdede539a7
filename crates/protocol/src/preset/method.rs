use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::{PoseNormalisation, Preset};
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
    /// Repository file that states these settings.
    pub source: String,
}

/// The settings that a method uses: its published ones, or the preset's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffectiveSetting<'a> {
    /// Pose normalisation.
    pub pose_normalisation: &'a PoseNormalisation,
    /// Near and far plane.
    pub near_far: NearFar,
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
            Some(MethodSetting { pose_normalisation, near_far, .. }) => {
                EffectiveSetting { pose_normalisation, near_far: *near_far }
            }
            None => EffectiveSetting { pose_normalisation: &self.pose_normalisation, near_far: self.near_far },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
