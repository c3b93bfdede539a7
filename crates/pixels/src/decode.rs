use std::io::Cursor;

use image::codecs::{png::PngDecoder, webp::WebPDecoder};
use image::{ColorType, ImageDecoder, ImageError, Limits};

use crate::limits::zeroed;
use crate::render::check_header;
use crate::size::{header, unknown};
use crate::{DecodeLimits, ImageFormat, ImageU8, PixelError, size_within};

/// Decodes to 8-bit RGB, by the rules of Pillow's `Image.open(…).convert("RGB")`. For 8-bit RGB, as the published datasets have it,
/// these are also the values of loaders that do not convert; of other images, pixelSplat's (`src/dataset/dataset_re10k.py`) skips
/// the scene, because `ToTensor` gives another shape than 3×360×640:
///
/// - EXIF orientation is not applied, gamma and colour profiles are ignored;
/// - alpha is dropped, not composited over a background;
/// - grey is repeated three times, 1, 2 and 4 bits are scaled to 0…255;
/// - a palette index beyond the palette is black;
/// - 16-bit samples keep their high byte (truncation, not rounding);
/// - an animated WebP gives its first frame.
///
/// One rule differs on purpose: Pillow clips 16-bit *grey* at 255, which turns nearly every such image white; here it
/// keeps its high byte, as colours do.
///
/// # Errors
/// [`PixelError::UnknownFormat`], [`PixelError::LfsPointer`], [`PixelError::HoldsFloats`] for EXR,
/// [`PixelError::OverLimit`] and [`PixelError::FileTooShort`] before decoding, [`PixelError::Decode`] for corrupt data.
pub fn decode(bytes: &[u8], limits: &DecodeLimits) -> Result<ImageU8, PixelError> {
    decoded(bytes, limits, |_, _, _| Ok(()))
}

/// [`decode`], but with pixels composited over a colour by their alpha, as loaders of 3DGS and nerfstudio do: alpha is straight, and
/// stored (not linear) values are mixed; here they are rounded to 8 bits, where nerfstudio keeps floats and 3DGS truncates.
///
/// # Errors
/// Those of [`decode`].
pub fn decode_over(bytes: &[u8], limits: &DecodeLimits, background: [u8; 3]) -> Result<ImageU8, PixelError> {
    let mut alphas = Vec::new();
    let image = decoded(bytes, limits, |color, stored, _| {
        alphas = alphas_of(color, stored);
        Ok(())
    })?;
    if alphas.is_empty() {
        return Ok(image);
    }
    let pixels = image.samples().as_chunks::<3>().0.iter().zip(alphas);
    let samples = pixels.flat_map(|(pixel, alpha)| {
        let channels = pixel.iter().zip(background);
        channels.map(move |(above, behind)| mixed(*above, behind, alpha))
    });
    ImageU8::new(image.width(), image.height(), samples.collect())
}

/// A sample over another, rounded to nearest.
fn mixed(above: u8, behind: u8, alpha: u8) -> u8 {
    let [above, behind, alpha] = [above, behind, alpha].map(u16::from);
    let [sample, _] = ((above * alpha + behind * (255 - alpha) + 127) / 255).to_le_bytes();
    sample
}

/// The alpha of each pixel, of 16 bits the high byte; empty without an alpha channel.
fn alphas_of(color: ColorType, stored: &[u8]) -> Vec<u8> {
    let high = |pair: [u8; 2]| u16::from_ne_bytes(pair).to_be_bytes()[0];
    match color {
        ColorType::Rgba8 => stored.as_chunks::<4>().0.iter().map(|&[.., alpha]| alpha).collect(),
        ColorType::La8 => stored.as_chunks::<2>().0.iter().map(|&[_, alpha]| alpha).collect(),
        ColorType::Rgba16 => stored.as_chunks::<8>().0.iter().map(|&[.., a, b]| high([a, b])).collect(),
        ColorType::La16 => stored.as_chunks::<4>().0.iter().map(|&[.., a, b]| high([a, b])).collect(),
        _ => Vec::new(),
    }
}

/// [`decode`] for renders, whose stored samples have to be the image: a file that the rules of [`decode`] would change is
/// an error. The colour of a transparent pixel depends on the background, and on whether the file's colours are
/// premultiplied by alpha, which PNG does not state.
///
/// # Errors
/// Those of [`decode`]; [`PixelError::UnusableRender`] for other formats than PNG, for 16-bit samples, for samples that are
/// not encoded for display according to `gAMA` or `cICP`, and for an EXIF orientation; [`PixelError::Transparent`].
pub fn decode_render(bytes: &[u8], limits: &DecodeLimits) -> Result<ImageU8, PixelError> {
    check_header(bytes)?;
    decoded(bytes, limits, |color, stored, width| {
        require_opaque(color, stored, width)?;
        require_eight_bits(color)
    })
}

fn decoded(
    bytes: &[u8],
    limits: &DecodeLimits,
    check: impl FnOnce(ColorType, &[u8], u32) -> Result<(), PixelError>,
) -> Result<ImageU8, PixelError> {
    let format = ImageFormat::sniff(bytes).ok_or_else(|| unknown(bytes))?;
    if format == ImageFormat::Exr {
        return Err(PixelError::HoldsFloats);
    }
    let (width, height) = size_within(bytes, limits)?;
    if u64::from(width) * u64::from(height) > max_pixels(format, bytes.len()) {
        return Err(PixelError::FileTooShort { format, width, height, length: bytes.len() });
    }
    let reader = Cursor::new(bytes);
    let failed = |source: ImageError| PixelError::Decode { format, source: source.into() };
    let (color, stored) = match format {
        ImageFormat::Png => {
            let decoder = PngDecoder::with_limits(reader, library_limits(limits)).map_err(failed)?;
            stored_samples(format, decoder, (width, height), limits)
        }
        ImageFormat::Jpeg => return crate::jpeg::decode(bytes, (width, height), limits),
        ImageFormat::WebP => stored_samples(format, WebPDecoder::new(reader).map_err(failed)?, (width, height), limits),
        ImageFormat::Exr => Err(PixelError::HoldsFloats),
    }?;
    check(color, &stored, width)?;
    ImageU8::new(width, height, rgb8(format, color, stored)?)
}

/// An error for stored samples that are not opaque. Alpha is the last sample of each pixel.
fn require_opaque(color: ColorType, stored: &[u8], width: u32) -> Result<(), PixelError> {
    if !color.has_alpha() {
        return Ok(());
    }
    let pixel = usize::from(color.bytes_per_pixel());
    let alpha = pixel / usize::from(color.channel_count());
    let is_transparent = |pixel: &[u8]| pixel.iter().rev().take(alpha).any(|byte| *byte != u8::MAX);
    let mut transparent = stored.chunks_exact(pixel).enumerate().filter(|(_, pixel)| is_transparent(pixel));
    let Some((first, _)) = transparent.next() else { return Ok(()) };
    let (column, row) = (first % width as usize, first / width as usize);
    Err(PixelError::Transparent { count: 1 + transparent.count(), column, row })
}

fn require_eight_bits(color: ColorType) -> Result<(), PixelError> {
    if color.bytes_per_pixel() == color.channel_count() {
        return Ok(());
    }
    Err(PixelError::UnusableRender {
        expected: "8-bit samples",
        found: "16-bit samples, whose low bytes would be lost".to_owned(),
        remedy: "write floats (EXR) for more than 8 bits",
    })
}

/// The maximum number of pixels in a file of `length` bytes.
///
/// Deflate expands at most 1032 times and a PNG row has at least one bit per pixel; a JPEG has at least one bit for the
/// DC coefficient of each 8×8 block. WebP has no such bound: pixels of a constant colour need no bits.
fn max_pixels(format: ImageFormat, length: usize) -> u64 {
    let length = length as u64;
    match format {
        ImageFormat::Png => length.saturating_mul(1032 * 8),
        ImageFormat::Jpeg => length.saturating_mul(8 * 64),
        ImageFormat::WebP | ImageFormat::Exr => u64::MAX,
    }
}

fn library_limits(limits: &DecodeLimits) -> Limits {
    let mut library = Limits::no_limits();
    library.max_image_width = Some(limits.max_width);
    library.max_image_height = Some(limits.max_height);
    library.max_alloc = Some(limits.max_bytes);
    library
}

/// Decodes to the samples stored in the file, after a check that the decoder agrees with the header.
fn stored_samples(
    format: ImageFormat,
    decoder: impl ImageDecoder,
    size: (u32, u32),
    limits: &DecodeLimits,
) -> Result<(ColorType, Vec<u8>), PixelError> {
    if decoder.dimensions() != size {
        let (width, height) = decoder.dimensions();
        return Err(header(format, format!("size {}×{}, but the data has {width}×{height}", size.0, size.1)));
    }
    let color = decoder.color_type();
    let each = u64::from(color.bytes_per_pixel());
    limits.check(format, size, each)?;
    let mut samples = zeroed("decoded image", size.0.into(), size.1.into(), each)?;
    decoder.read_image(&mut samples).map_err(|source| PixelError::Decode { format, source: source.into() })?;
    Ok((color, samples))
}

/// Converts stored samples to 8-bit RGB; 16-bit samples are in native byte order.
fn rgb8(format: ImageFormat, color: ColorType, stored: Vec<u8>) -> Result<Vec<u8>, PixelError> {
    let high = |&pair: &[u8; 2]| u16::from_ne_bytes(pair).to_be_bytes()[0];
    Ok(match color {
        ColorType::Rgb8 => stored,
        ColorType::Rgba8 => stored.as_chunks::<4>().0.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect(),
        ColorType::L8 => stored.iter().flat_map(|&grey| [grey; 3]).collect(),
        ColorType::La8 => stored.as_chunks::<2>().0.iter().flat_map(|&[grey, _]| [grey; 3]).collect(),
        ColorType::Rgb16 => stored.as_chunks::<2>().0.iter().map(high).collect(),
        ColorType::Rgba16 => {
            let pixels = stored.as_chunks::<2>().0.as_chunks::<4>().0;
            pixels.iter().flat_map(|[r, g, b, _]| [high(r), high(g), high(b)]).collect()
        }
        ColorType::L16 => stored.as_chunks::<2>().0.iter().flat_map(|grey| [high(grey); 3]).collect(),
        ColorType::La16 => {
            let pixels = stored.as_chunks::<2>().0.as_chunks::<2>().0;
            pixels.iter().flat_map(|[grey, _]| [high(grey); 3]).collect()
        }
        other => {
            let feature = format!("converting {other:?} samples to 8-bit RGB");
            return Err(PixelError::Unsupported { format, feature });
        }
    })
}

#[cfg(test)]
mod tests {
    use image::codecs::png::PngEncoder;
    use image::{ExtendedColorType, ImageEncoder as _};

    use super::*;

    fn png(samples: &[u8], colour: ExtendedColorType) -> Vec<u8> {
        let mut png = Vec::new();
        PngEncoder::new(&mut png).write_image(samples, 2, 1, colour).unwrap();
        png
    }

    /// A transparent pixel shows the background, a translucent one a mixture of both.
    #[test]
    fn pixels_are_composited_by_their_alpha() {
        let over = |bytes: &[u8], background: [u8; 3]| {
            decode_over(bytes, &DecodeLimits::default(), background).unwrap().into_samples()
        };
        let rgba = png(&[200, 100, 50, 0, 200, 100, 50, 51], ExtendedColorType::Rgba8);
        // 51 is a fifth of 255.
        assert_eq!(over(&rgba, [255, 0, 10]), [255, 0, 10, 244, 20, 18]);
        assert_eq!(over(&rgba, [0; 3]), [0, 0, 0, 40, 20, 10]);
        assert_eq!(decode(&rgba, &DecodeLimits::default()).unwrap().into_samples(), [200, 100, 50, 200, 100, 50]);
        let grey = png(&[200, 255, 200, 51], ExtendedColorType::La8);
        assert_eq!(over(&grey, [0, 255, 10]), [200, 200, 200, 40, 244, 48]);
        let deep: Vec<u8> =
            [200_u16, 100, 50, 0, 200, 100, 50, 51].iter().flat_map(|v| (v * 257).to_ne_bytes()).collect();
        assert_eq!(over(&png(&deep, ExtendedColorType::Rgba16), [255, 0, 10]), [255, 0, 10, 244, 20, 18]);
        let opaque = png(&[1, 2, 3, 4, 5, 6], ExtendedColorType::Rgb8);
        assert_eq!(over(&opaque, [255; 3]), [1, 2, 3, 4, 5, 6], "no alpha channel");
    }
}
