mod coefficients;
mod passes;

use serde::{Deserialize, Serialize};

use crate::{ImageU8, PixelError};
use coefficients::Coefficients;

/// The kernel that [`resize`] weighs source pixels with, as in Pillow `src/libImaging/Resample.c`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// `sinc(x) · sinc(x/3)` within three pixels: what pixelSplat and its descendants resize with
    /// (pixelSplat `src/dataset/shims/crop_shim.py`).
    Lanczos,
    /// A triangle of one pixel either side, widened by the scale when shrinking (antialiased, unlike
    /// OpenCV's bilinear).
    Bilinear,
    /// The mean over the source area of each target pixel.
    Box,
}

/// Resamples to `width × height`, bit for bit what Pillow's `Image.resize((width, height), filter)` makes
/// of an RGB picture.
///
/// Weights are computed in f64, quantised to 22 fractional bits, and applied in a horizontal pass that
/// rounds to 8 bits, then in a vertical one; a pass whose size does not change is left out, and the same
/// size is a copy. Enlarging uses the kernel at its own width (Pillow `src/libImaging/Resample.c`,
/// `precompute_coeffs`).
///
/// # Errors
/// [`PixelError::Empty`] where either size is zero, [`PixelError::TooLarge`] where the result does not
/// fit into memory.
pub fn resize(image: &ImageU8, width: u32, height: u32, filter: Filter) -> Result<ImageU8, PixelError> {
    if image.width() == 0 || image.height() == 0 {
        return Err(PixelError::Empty { what: "resize from", width: image.width(), height: image.height() });
    }
    if width == 0 || height == 0 {
        return Err(PixelError::Empty { what: "resize to", width, height });
    }
    let columns = (width != image.width()).then(|| Coefficients::new(image.width(), width, filter)).transpose()?;
    let rows = (height != image.height()).then(|| Coefficients::new(image.height(), height, filter)).transpose()?;
    let samples = match (columns, rows) {
        (None, None) => image.samples().to_vec(),
        (Some(columns), None) => passes::horizontal(image.samples(), image.width(), &columns)?,
        (None, Some(rows)) => passes::vertical(image.samples(), image.width(), &rows)?,
        (Some(columns), Some(rows)) => {
            passes::vertical(&passes::horizontal(image.samples(), image.width(), &columns)?, width, &rows)?
        }
    };
    ImageU8::new(width, height, samples)
}
