use thiserror::Error;

use crate::NonFinite;

/// Why a metric cannot be computed.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum MetricError {
    /// The truth has another size than the render.
    #[error("truth: expected {}×{} pixels like the render, found {}×{}", expected[0], expected[1], found[0], found[1])]
    SizeMismatch {
        /// Width and height of the render.
        expected: [u32; 2],
        /// Width and height of the truth.
        found: [u32; 2],
    },
    /// The images have no pixels.
    #[error("images: expected at least one pixel, found {}×{}", size[0], size[1])]
    Empty {
        /// Width and height.
        size: [u32; 2],
    },
    /// Samples are NaN or infinite.
    #[error("images: expected finite samples, found {0}")]
    NonFinite(NonFinite),
    /// The image is smaller than the metric's window.
    #[error("{measure}: expected at least {smallest} pixels a side, found {}×{}", size[0], size[1])]
    TooSmall {
        /// Which metric.
        measure: &'static str,
        /// Smallest supported side.
        smallest: u32,
        /// Width and height of the image.
        size: [u32; 2],
    },
    /// Features are by another network, or by other weights of it, than those that they are compared by.
    #[error("features: expected those of {expected}, found those of {found}")]
    OtherFeatures {
        /// The network, and the hash of its weights.
        expected: String,
        /// Those of the features.
        found: String,
    },
    /// A number that is no mean squared error.
    #[error("mean squared error: expected a finite number from 0, found {found}")]
    MeanSquaredError {
        /// The number.
        found: f64,
    },
    /// The network's features, and thus the distance, are NaN or infinite.
    #[error("{measure}: the samples are so large that the network's sums are not finite numbers")]
    Overflow {
        /// Which metric.
        measure: &'static str,
    },
}
