use std::fmt;

use serde::{Deserialize, Serialize};

use crate::ModelError;

/// Height and width of an image in pixels; in TOML, `[height, width]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(from = "[usize; 2]", into = "[usize; 2]")]
pub struct ImageSize {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
}

#[cfg(feature = "network")]
impl From<atsplat_camera::ImageSize> for ImageSize {
    fn from(size: atsplat_camera::ImageSize) -> Self {
        Self::new(size.height as usize, size.width as usize)
    }
}

/// A grid of patches of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Grid {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
}

impl Grid {
    /// Number of patches.
    pub const fn len(self) -> usize {
        self.rows.saturating_mul(self.columns)
    }

    /// Whether the grid has no patches.
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }
}

impl ImageSize {
    /// A size of `height` rows and `width` columns.
    pub const fn new(height: usize, width: usize) -> Self {
        Self { height, width }
    }

    /// The size with this aspect ratio at the scale of another: the shorter side becomes as long as the other's shorter side
    /// and the longer one is scaled in proportion, both rounded to the nearest multiple of `step`.
    #[must_use]
    pub fn at_scale_of(self, other: Self, step: usize) -> Self {
        let step = step.max(1);
        let whole = |side: usize| (side.saturating_add(step / 2) / step).max(1).saturating_mul(step);
        let [shorter, wanted] = [self.height.min(self.width).max(1), other.height.min(other.width)];
        let side = |side: usize| whole(side.saturating_mul(wanted).saturating_add(shorter / 2) / shorter);
        Self { height: side(self.height), width: side(self.width) }
    }

    /// The patch grid of this image after downscaling by `downscale`.
    pub(super) fn grid(self, patch: usize, downscale: usize, branch: &'static str) -> Result<Grid, ModelError> {
        let step = patch.saturating_mul(downscale);
        let divides = step > 0 && self.height > 0 && self.width > 0;
        if !divides || !self.height.is_multiple_of(step) || !self.width.is_multiple_of(step) {
            return Err(ModelError::Indivisible { branch, step, found: self });
        }
        Ok(Grid { rows: self.height / step, columns: self.width / step })
    }
}

impl From<[usize; 2]> for ImageSize {
    fn from([height, width]: [usize; 2]) -> Self {
        Self { height, width }
    }
}

impl From<ImageSize> for [usize; 2] {
    fn from(size: ImageSize) -> Self {
        [size.height, size.width]
    }
}

/// Height × width, as the papers write resolutions.
impl fmt::Display for ImageSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.height, self.width)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shorter_side_sets_the_scale_and_sides_are_whole_patches() {
        let trained = ImageSize::new(128, 128);
        for (given, expected) in [
            ([256, 256], [128, 128]),
            ([128, 128], [128, 128]),
            ([112, 112], [128, 128]),
            ([256, 448], [128, 224]),
            ([448, 256], [224, 128]),
            ([512, 960], [128, 240]),
            // 1920 · 128 / 1080 is 227.6; 228 is between 224 and 232, and the upper is taken.
            ([1080, 1920], [128, 232]),
            ([100, 130], [128, 168]),
            ([1, 3], [128, 384]),
        ] {
            assert_eq!(ImageSize::from(given).at_scale_of(trained, 8), ImageSize::from(expected), "{given:?}");
        }
        let wide = ImageSize::new(256, 448);
        assert_eq!(ImageSize::new(512, 512).at_scale_of(wide, 16), ImageSize::new(256, 256));
        assert_eq!(wide.at_scale_of(wide, 16), wide);
        assert!(wide.at_scale_of(ImageSize::new(usize::MAX, usize::MAX), 16).width > 1 << 50, "no overflow");
        // A trained size that patches do not divide is rounded to the nearest multiple.
        assert_eq!(ImageSize::new(90, 90).at_scale_of(ImageSize::new(100, 100), 16), ImageSize::new(96, 96));
    }

    #[test]
    fn a_grid_without_rows_or_columns_is_empty() {
        let is_empty = |rows, columns| Grid { rows, columns }.is_empty();
        assert_eq!([is_empty(2, 3), is_empty(0, 3), is_empty(2, 0)], [false, true, true]);
    }
}
