use std::fmt;

use atsplat_camera::ImageSize;
use serde::{Deserialize, Serialize};

use super::{Plan, PreprocessError, Resampling};

const STEP: &str = "square-crop";

/// Crops to the largest centred square and, if `size` is given, resamples it to `size` × `size`.
///
/// [`super::RescaleAndCrop`] in the opposite order: here the edges are whole pixels at the file's resolution, so the two
/// differ by up to an output pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct SquareCrop {
    /// Output side; that of the square, if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<u32>,
    /// Resampling filter.
    #[serde(default)]
    pub filter: Resampling,
}

impl SquareCrop {
    /// Cropped, then resampled to `size` with Lanczos.
    pub const fn resized(size: u32) -> Self {
        Self { size: Some(size), filter: Resampling::Lanczos }
    }

    pub(super) fn extend(&self, plan: &mut Plan) -> Result<(), PreprocessError> {
        let square = |side: u32| ImageSize { width: side, height: side };
        let found = plan.output();
        plan.crop_centre(STEP, square(found.width.min(found.height)))?;
        self.size.map_or(Ok(()), |side| plan.resize(STEP, square(side), self.filter))
    }
}

impl fmt::Display for SquareCrop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.size {
            Some(side) => write!(f, "{STEP} {side}×{side} ({})", self.filter),
            None => write!(f, "{STEP}"),
        }
    }
}
