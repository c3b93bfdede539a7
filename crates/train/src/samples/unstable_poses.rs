use std::collections::BTreeMap;
use std::fmt;

use atsplat_camera::Fallback;
use atsplat_numeric::counted;

/// Scenes with samples for whose poses the pose normalisation has no stable solution: a [`Fallback`] applied.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct UnstablePoses {
    /// Each with its first such sample, and what applied to that.
    pub scenes: BTreeMap<String, String>,
}

impl UnstablePoses {
    /// Adds a sample, unless nothing applied to it.
    pub(super) fn add(&mut self, scene: &str, sample: &str, fallbacks: &[Fallback]) {
        if !fallbacks.is_empty() && !self.scenes.contains_key(scene) {
            let applied = fallbacks.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
            self.scenes.insert(scene.to_owned(), format!("{sample}: {applied}"));
        }
    }

    pub(super) fn merge(&mut self, other: Self) {
        for (scene, sample) in other.scenes {
            self.scenes.entry(scene).or_insert(sample);
        }
    }

    /// The same; `None` without any scene.
    pub(crate) fn if_any(self) -> Option<Self> {
        (!self.scenes.is_empty()).then_some(self)
    }
}

impl fmt::Display for UnstablePoses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scenes = counted(self.scenes.len() as u64, "scene");
        write!(f, "poses of samples of {scenes} have no stable normalisation")?;
        match self.scenes.first_key_value() {
            Some((_, sample)) => write!(f, ", such as {sample}"),
            None => Ok(()),
        }
    }
}
