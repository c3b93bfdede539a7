use std::fmt;

use atsplat_camera::ImageSize;
use serde::{Deserialize, Serialize};

use super::plan::not_empty;
use super::{Plan, PreprocessError};

const STEP: &str = "patch-crop";

/// Crops the centre to the largest size whose sides are multiples of `multiple`, as DepthSplat's encoder does to its
/// input images (depthsplat `src/dataset/shims/patch_shim.py:4-27`).
///
/// DepthSplat's and iLRM's "256×448" on DL3DV is this with `multiple = 64` on the native 270×480, without resampling.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct PatchCrop {
    /// Both sides become multiples of this.
    pub multiple: u32,
    /// Accept images with an odd side, whose crop is half a pixel off the centre. By default they are an error, as in
    /// DepthSplat.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub allow_odd_size: bool,
}

impl PatchCrop {
    /// For images with even sides only, as published.
    pub const fn new(multiple: u32) -> Self {
        Self { multiple, allow_odd_size: false }
    }

    pub(super) fn extend(self, plan: &mut Plan) -> Result<(), PreprocessError> {
        let found = plan.output();
        let even = found.width.is_multiple_of(2) && found.height.is_multiple_of(2);
        if !(even || self.allow_odd_size) {
            return Err(PreprocessError::OddSize { step: STEP, found });
        }
        let whole_patches =
            |length: u32| length.checked_div(self.multiple).map_or(0, |patches| patches * self.multiple);
        let size = ImageSize { width: whole_patches(found.width), height: whole_patches(found.height) };
        if size.width == 0 || size.height == 0 {
            let wanted = ImageSize { width: self.multiple, height: self.multiple };
            not_empty(STEP, wanted)?;
            return Err(PreprocessError::TooSmall { step: STEP, wanted, found });
        }
        plan.crop_centre(STEP, size)
    }
}

impl fmt::Display for PatchCrop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{STEP} to multiples of {}", self.multiple)?;
        if self.allow_odd_size { write!(f, " (odd sizes too)") } else { Ok(()) }
    }
}
