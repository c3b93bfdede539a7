use atsplat_camera::Camera;
use serde::{Deserialize, Serialize};

/// What a protocol makes of the lens distortion that data state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LensDistortion {
    /// Views are rendered through their lens.
    #[default]
    Used,
    /// Views are taken for pinholes, whatever the format says: published loaders read formats without lenses, made from files that
    /// have them (depthsplat `src/scripts/convert_dl3dv_test.py:90-129`).
    Ignored,
}

impl LensDistortion {
    /// Whether it is [`Self::Used`].
    pub const fn is_used(&self) -> bool {
        matches!(self, Self::Used)
    }

    /// A camera of the data as the protocol sees it.
    #[must_use]
    pub fn seen(self, camera: &Camera) -> Camera {
        match self {
            Self::Used => *camera,
            Self::Ignored => camera.without_distortion(),
        }
    }
}
