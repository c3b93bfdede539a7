use std::fmt;

use atsplat_camera::ImageSize;
use atsplat_numeric::Extremes;
use serde::{Deserialize, Serialize};

use super::plan::not_empty;
use super::{Plan, PreprocessError, Resampling};

const STEP: &str = "rescale-and-crop";

/// Scales an image to the smallest size that covers `height` × `width`, then crops the centre: `rescale_and_crop` of
/// pixelSplat, MVSplat, NoPoSplat (`src/dataset/shims/crop_shim.py`) and DepthSplat (lines 64–105).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RescaleAndCrop {
    /// Output rows; at most the image's.
    pub height: u32,
    /// Output columns; at most the image's.
    pub width: u32,
    /// Resampling filter.
    #[serde(default)]
    pub filter: Resampling,
}

impl RescaleAndCrop {
    /// With Lanczos, the papers' filter.
    pub const fn new(height: u32, width: u32) -> Self {
        Self { height, width, filter: Resampling::Lanczos }
    }

    pub(super) fn extend(&self, plan: &mut Plan) -> Result<(), PreprocessError> {
        let target = ImageSize { width: self.width, height: self.height };
        not_empty(STEP, target)?;
        let found = plan.output();
        if target.width > found.width || target.height > found.height {
            return Err(PreprocessError::TooSmall { step: STEP, wanted: target, found });
        }
        plan.resize(STEP, just_covering(found, target), self.filter)?;
        plan.crop_centre(STEP, target)
    }
}

/// `source` scaled by `s = max(h_out / h_in, w_out / w_in)`, in Python's arithmetic: f64, with `round()` of halves to
/// even.
fn just_covering(source: ImageSize, target: ImageSize) -> ImageSize {
    let ratio = |outer: u32, inner: u32| f64::from(inner) / f64::from(outer);
    let scale = ratio(source.height, target.height).maximum_of(ratio(source.width, target.width));
    ImageSize { width: scaled(source.width, scale), height: scaled(source.height, scale) }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "0 < scale <= 1, so the product stays within 0 and `length`"
)]
fn scaled(length: u32, scale: f64) -> u32 {
    (f64::from(length) * scale).round_ties_even() as u32
}

impl fmt::Display for RescaleAndCrop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{STEP} {}×{} ({})", self.width, self.height, self.filter)
    }
}
