use std::fmt;

use serde::{Deserialize, Serialize};

use crate::ModelError;

/// Height and width of a picture in pixels; in TOML, `[height, width]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(from = "[usize; 2]", into = "[usize; 2]")]
pub struct ImageSize {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
}

/// Patches of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Grid {
    /// Patches from top to bottom.
    pub rows: usize,
    /// Patches from left to right.
    pub columns: usize,
}

impl Grid {
    /// Patches of the whole picture.
    pub const fn len(self) -> usize {
        self.rows.saturating_mul(self.columns)
    }

    /// Whether there is no patch.
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }
}

impl ImageSize {
    /// A picture of `height` rows and `width` columns.
    pub const fn new(height: usize, width: usize) -> Self {
        Self { height, width }
    }

    /// The patches of this picture after it was made `downscale` times smaller.
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
