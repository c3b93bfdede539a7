use std::fmt;

use atsplat_camera::ImageSize;
use serde::{Deserialize, Serialize};

use super::{Plan, PreprocessError};

const STEP: &str = "centre-crop";

/// Crops the centre to `height` × `width` without resampling; the half-pixel of an odd margin is rounded down
/// (`center_crop`, pixelSplat `src/dataset/shims/crop_shim.py`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct CentreCrop {
    /// Output rows; at most the image's.
    pub height: u32,
    /// Output columns; at most the image's.
    pub width: u32,
}

impl CentreCrop {
    /// A crop of this size.
    pub const fn new(height: u32, width: u32) -> Self {
        Self { height, width }
    }

    pub(super) fn extend(self, plan: &mut Plan) -> Result<(), PreprocessError> {
        plan.crop_centre(STEP, ImageSize { width: self.width, height: self.height })
    }
}

impl fmt::Display for CentreCrop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{STEP} {}×{}", self.width, self.height)
    }
}
