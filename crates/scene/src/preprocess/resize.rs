use std::fmt;

use atsplat_camera::ImageSize;
use atsplat_pixels::Filter;
use serde::{Deserialize, Serialize};

use super::{Plan, PreprocessError};

const STEP: &str = "resize";

/// Resamples to `height` × `width` without a crop. Normalised intrinsics do not change, but the aspect ratio of pixels
/// may.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Resize {
    /// Output rows.
    pub height: u32,
    /// Output columns.
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

/// Pillow's resampling filter, by its name in presets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Resampling {
    /// `Image.LANCZOS`, as used by `rescale` in pixelSplat `src/dataset/shims/crop_shim.py`.
    #[default]
    Lanczos,
    /// `Image.BILINEAR`, antialiased when shrinking.
    Bilinear,
    /// `Image.BOX`, the mean of the covered pixels.
    Box,
}

impl From<Resampling> for Filter {
    fn from(resampling: Resampling) -> Self {
        match resampling {
            Resampling::Lanczos => Self::Lanczos,
            Resampling::Bilinear => Self::Bilinear,
            Resampling::Box => Self::Box,
        }
    }
}

impl fmt::Display for Resampling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Lanczos => "lanczos",
            Self::Bilinear => "bilinear",
            Self::Box => "box",
        })
    }
}
