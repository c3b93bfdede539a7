use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::CameraError;

/// Image width and height in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ImageSize {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl ImageSize {
    /// Longest side of an image that the CPU renderer accepts.
    pub const MAX_SIDE: u32 = u16::MAX as u32;

    /// A multiple of this size, in whole pixels.
    ///
    /// # Errors
    /// [`CameraError::InvalidSize`] for a side below 1 or above [`Self::MAX_SIDE`].
    pub fn scaled(self, factor: f64) -> Result<Self, CameraError> {
        let [width, height] = [self.width, self.height].map(|side| (f64::from(side) * factor).round());
        format!("{width}x{height}").parse()
    }
}

impl fmt::Display for ImageSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}×{}", self.width, self.height)
    }
}

impl FromStr for ImageSize {
    type Err = CameraError;

    /// `WxH` or `W×H`, each side from 1 to [`Self::MAX_SIDE`].
    fn from_str(text: &str) -> Result<Self, CameraError> {
        let side = |text: &str| text.parse().ok().filter(|side| (1..=Self::MAX_SIDE).contains(side));
        let sides = text.split_once(['x', '×']).and_then(|(width, height)| Some((side(width)?, side(height)?)));
        let (width, height) = sides.ok_or_else(|| CameraError::InvalidSize { found: text.to_owned() })?;
        Ok(Self { width, height })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_sizes() {
        let expected = ImageSize { width: 640, height: 360 };
        assert_eq!(("640x360".parse(), expected.to_string().parse()), (Ok(expected), Ok(expected)));
        for broken in ["640", "0x3", "3x0", "x", "1x2x3", "65536x1", "-1x4"] {
            assert!(broken.parse::<ImageSize>().is_err(), "{broken:?}");
        }
        assert_eq!(expected.scaled(0.25), Ok(ImageSize { width: 160, height: 90 }));
        assert!(expected.scaled(0.001).is_err() && expected.scaled(200.0).is_err());
    }
}
