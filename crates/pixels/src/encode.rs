use std::io::Cursor;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};
use libjpeg_turbo_rs::{PixelFormat, Subsampling, compress};

use crate::{ImageFormat, ImageU8, PixelError};

/// Encodes as 8-bit RGB PNG, lossless; the same image gives the same bytes.
///
/// # Errors
/// [`PixelError::Empty`] for an image without pixels, [`PixelError::Encode`].
pub fn encode_png(image: &ImageU8) -> Result<Vec<u8>, PixelError> {
    let (width, height) = (image.width(), image.height());
    if width == 0 || height == 0 {
        return Err(PixelError::Empty { what: "encoded image", width, height });
    }
    let mut file = Cursor::new(Vec::new());
    PngEncoder::new_with_quality(&mut file, CompressionType::Default, FilterType::Adaptive)
        .write_image(image.samples(), width, height, ExtendedColorType::Rgb8)
        .map_err(|source| PixelError::Encode { format: ImageFormat::Png, source: source.into() })?;
    Ok(file.into_inner())
}

/// Encodes as baseline JPEG of this quality, 1 to 100, with 4:2:0 chroma: the same bytes as Pillow's
/// `save(…, quality=quality)`.
///
/// # Errors
/// [`PixelError::Empty`] for an image without pixels, [`PixelError::Quality`], [`PixelError::Encode`], also for a side
/// of more than 65500 pixels.
pub fn encode_jpeg(image: &ImageU8, quality: u8) -> Result<Vec<u8>, PixelError> {
    if !(1..=100).contains(&quality) {
        return Err(PixelError::Quality { found: quality });
    }
    let (width, height) = (image.width(), image.height());
    if width == 0 || height == 0 {
        return Err(PixelError::Empty { what: "JPEG", width, height });
    }
    let (width, height) = (width as usize, height as usize);
    compress(image.samples(), width, height, PixelFormat::Rgb, quality, Subsampling::S420)
        .map_err(|source| PixelError::Encode { format: ImageFormat::Jpeg, source: source.into() })
}
