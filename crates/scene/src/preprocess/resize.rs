use std::fmt;

use atsplat_camera::ImageSize;
use serde::{Deserialize, Serialize};

use super::{Plan, PreprocessError, Resampling};

const STEP: &str = "resize";

/// Resamples to `height` × `width` without a crop; normalised intrinsics stay, the aspect ratio of a pixel
/// may not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Resize {
    /// Rows that come out.
    pub height: u32,
    /// Columns that come out.
    pub width: u32,
    /// Resampling filter.
    #[serde(default)]
    pub filter: Resampling,
}

impl Resize {
    /// With Lanczos.
    pub const fn new(height: u32, width: u32) -> Self {
        Self { height, width, filter: Resampling::Lanczos }
    }

    pub(super) fn extend(&self, plan: &mut Plan) -> Result<(), PreprocessError> {
        plan.resize(STEP, ImageSize { width: self.width, height: self.height }, self.filter)
    }
}

impl fmt::Display for Resize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{STEP} {}×{} ({})", self.width, self.height, self.filter)
    }
}
