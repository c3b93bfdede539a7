use std::fmt;

use atsplat_pixels::Filter;
use serde::{Deserialize, Serialize};

/// Pillow's resampling filter, by the name that a preset writes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Resampling {
    /// `Image.LANCZOS`: what `rescale` uses in pixelSplat `src/dataset/shims/crop_shim.py`.
    #[default]
    Lanczos,
    /// `Image.BILINEAR`, antialiased when shrinking.
    Bilinear,
    /// `Image.BOX`: the mean of the covered pixels.
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
