use std::io::Cursor;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::codecs::webp::WebPEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageError};
use libjpeg_turbo_rs::{PixelFormat, Subsampling, compress};

use crate::{ImageU8, PictureFormat, PixelError};

/// RGB of 8 bits into a PNG; lossless, the same bytes for the same picture.
///
/// # Errors
/// [`PixelError::Empty`] for a picture without pixels, [`PixelError::Encode`].
pub fn encode_png(image: &ImageU8) -> Result<Vec<u8>, PixelError> {
    let mut file = Cursor::new(Vec::new());
    let encoder = PngEncoder::new_with_quality(&mut file, CompressionType::Default, FilterType::Adaptive);
    written(PictureFormat::Png, image, encoder)?;
    Ok(file.into_inner())
}

/// RGB of 8 bits into a lossless WebP.
///
/// # Errors
/// [`PixelError::Empty`] for a picture without pixels, [`PixelError::Encode`], for one with more than
/// 16384 pixels a side too.
pub fn encode_webp(image: &ImageU8) -> Result<Vec<u8>, PixelError> {
    let mut file = Cursor::new(Vec::new());
    written(PictureFormat::WebP, image, WebPEncoder::new_lossless(&mut file))?;
    Ok(file.into_inner())
}

/// RGB of 8 bits into a baseline JPEG of this quality, 1 to 100, with 4:2:0 chroma: the bytes that
/// Pillow's `save(…, quality=quality)` writes.
///
/// # Errors
/// [`PixelError::Empty`] for a picture without pixels, [`PixelError::Quality`], [`PixelError::Encode`],
/// for one with more than 65500 pixels a side too.
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
        .map_err(|source| PixelError::Encode { format: PictureFormat::Jpeg, source: source.into() })
}

fn written(format: PictureFormat, image: &ImageU8, encoder: impl ImageEncoder) -> Result<(), PixelError> {
    let (width, height) = (image.width(), image.height());
    if width == 0 || height == 0 {
        return Err(PixelError::Empty { what: "encoded picture", width, height });
    }
    encoder
        .write_image(image.samples(), width, height, ExtendedColorType::Rgb8)
        .map_err(|source: ImageError| PixelError::Encode { format, source: source.into() })
}
