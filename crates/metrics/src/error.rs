use thiserror::Error;

use crate::NonFinite;

/// Why two pictures have no such number.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum MetricError {
    /// Two things that are compared pixel by pixel have different sizes.
    #[error("{what}: expected {}×{} pixels as the render has, found {}×{}", expected[0], expected[1], found[0], found[1])]
    SizeMismatch {
        /// What has the other size: the truth, the mask.
        what: &'static str,
        /// Width and height of the render.
        expected: [u32; 2],
        /// Width and height that were found.
        found: [u32; 2],
    },
    /// There is no pixel.
    #[error("pictures: expected at least one pixel, found {}×{}", size[0], size[1])]
    Empty {
        /// Width and height.
        size: [u32; 2],
    },
    /// Samples that are NaN or infinite: there is no honest number for them.
    #[error("pictures: expected finite samples, found {0}")]
    NonFinite(NonFinite),
    /// The picture is smaller than what the measure looks at.
    #[error("{measure}: expected at least {smallest} pixels a side, found {}×{}", size[0], size[1])]
    TooSmall {
        /// Which measure.
        measure: &'static str,
        /// Smallest side that it has a value for.
        smallest: u32,
        /// Width and height of the picture.
        size: [u32; 2],
    },
    /// The mask leaves nothing to compare.
    #[error("mask: expected {expected}, found none")]
    NothingInMask {
        /// What should lie in it.
        expected: &'static str,
    },
    /// A mask or a depth map has another number of values than pixels.
    #[error("{what}: expected {expected} values for its width and height, found {found}")]
    ValueCount {
        /// What was given.
        what: &'static str,
        /// Width times height.
        expected: u64,
        /// How many there are.
        found: usize,
    },
}
