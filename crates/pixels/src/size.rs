use crate::{DecodeLimits, ImageFormat, PixelError, png_chunks};

/// Columns and rows of an encoded image according to its header; nothing is decoded or allocated. EXIF orientation is
/// not applied, as in [`decode`](crate::decode()).
///
/// # Errors
/// [`PixelError::UnknownFormat`], [`PixelError::LfsPointer`], [`PixelError::Header`] if the header is truncated or
/// declares zero pixels, [`PixelError::Unsupported`] for a JPEG with its height after the data.
pub fn size_of(bytes: &[u8]) -> Result<(u32, u32), PixelError> {
    let format = ImageFormat::sniff(bytes).ok_or_else(|| unknown(bytes))?;
    let (width, height) = match format {
        ImageFormat::Png => png_size(bytes),
        ImageFormat::Jpeg => crate::jpeg::Frame::find(bytes).map(|frame| frame.size),
        ImageFormat::WebP => webp_size(bytes),
        ImageFormat::Exr => crate::exr::size(bytes),
    }?;
    if width == 0 || height == 0 {
        return Err(header(format, format!("expected at least one pixel, found {width}×{height}")));
    }
    Ok((width, height))
}

/// [`size_of`] an image, unless [`decode`](crate::decode()) refuses to decode one of this size.
///
/// # Errors
/// Those of [`size_of`]; [`PixelError::OverLimit`].
pub fn size_within(bytes: &[u8], limits: &DecodeLimits) -> Result<(u32, u32), PixelError> {
    let size = size_of(bytes)?;
    let format = ImageFormat::sniff(bytes).ok_or_else(|| unknown(bytes))?;
    limits.check(format, size, 3)?;
    Ok(size)
}

/// Whether a PNG or WebP has an alpha channel or a transparent colour, from the chunks before its pixels; `false` for other
/// formats. Whether any pixel is transparent is not checked.
pub fn has_alpha(bytes: &[u8]) -> bool {
    match ImageFormat::sniff(bytes) {
        Some(ImageFormat::Png) => png_has_alpha(bytes),
        Some(ImageFormat::WebP) => webp_has_alpha(bytes),
        _ => false,
    }
}

/// Whether a PNG stores 16 bits per sample, of which [`decode`](crate::decode()) keeps the high byte; `false` for other
/// formats.
pub fn has_16_bits(bytes: &[u8]) -> bool {
    const BIT_DEPTH: usize = 24;
    ImageFormat::sniff(bytes) == Some(ImageFormat::Png) && bytes.get(BIT_DEPTH) == Some(&16)
}

/// The error for bytes of an unknown format.
pub(crate) fn unknown(bytes: &[u8]) -> PixelError {
    if atsplat_files::is_lfs_pointer(bytes) {
        return PixelError::LfsPointer;
    }
    let start: Vec<String> = bytes.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
    PixelError::UnknownFormat { start: start.join(" "), length: bytes.len() }
}

pub(crate) fn header(format: ImageFormat, problem: impl Into<String>) -> PixelError {
    PixelError::Header { format, problem: problem.into() }
}

fn png_size(bytes: &[u8]) -> Result<(u32, u32), PixelError> {
    const LARGEST: u32 = i32::MAX.unsigned_abs();
    let problem = |text| header(ImageFormat::Png, text);
    let [length, kind, width, height] =
        words(bytes, 8).ok_or_else(|| problem(format!("truncated after {} bytes", bytes.len())))?;
    if length != 13u32.to_be_bytes() || kind != *b"IHDR" {
        return Err(problem("expected an IHDR chunk of 13 bytes as the first chunk".to_owned()));
    }
    let (width, height) = (u32::from_be_bytes(width), u32::from_be_bytes(height));
    if width > LARGEST || height > LARGEST {
        return Err(problem(format!("expected at most 2^31 - 1 pixels per side, found {width}×{height}")));
    }
    Ok((width, height))
}

/// Four consecutive 32-bit words starting at `at`.
fn words(bytes: &[u8], at: usize) -> Option<[[u8; 4]; 4]> {
    let (words, _) = bytes.get(at..)?.as_chunks::<4>();
    words.first_chunk::<4>().copied()
}

/// The colour type's alpha bit (PNG specification, 11.2.1), or a `tRNS` chunk, which comes before the pixels (11.3.1).
fn png_has_alpha(bytes: &[u8]) -> bool {
    const ALPHA_USED: u8 = 4;
    if bytes.get(25).is_some_and(|colour_type| colour_type & ALPHA_USED != 0) {
        return true;
    }
    png_chunks(bytes).map(|(name, _)| name).find(|name| matches!(*name, b"tRNS" | b"IDAT")) == Some(b"tRNS")
}

/// RFC 9649: the flag of an extended file (2.7), or the hint of a lossless one (3.4).
fn webp_has_alpha(bytes: &[u8]) -> bool {
    let byte = |at: usize, bit: u8| bytes.get(at).is_some_and(|byte| byte & bit != 0);
    match bytes.get(12..16) {
        Some(b"VP8X") => byte(20, 0x10),
        Some(b"VP8L") => byte(24, 0x10),
        _ => false,
    }
}

/// RFC 9649, sections 2.5 to 2.7; the lossy frame header is RFC 6386, 9.1.
fn webp_size(bytes: &[u8]) -> Result<(u32, u32), PixelError> {
    let problem = |text: &str| header(ImageFormat::WebP, text);
    let truncated = || problem("truncated");
    let kind: &[u8; 4] = bytes.get(12..).and_then(<[u8]>::first_chunk).ok_or_else(truncated)?;
    let payload = bytes.get(20..).ok_or_else(truncated)?;
    match kind {
        b"VP8 " => {
            let [_, _, _, s0, s1, s2, w0, w1, h0, h1] = payload.first_chunk().ok_or_else(truncated)?;
            if [*s0, *s1, *s2] != [0x9d, 0x01, 0x2a] {
                return Err(problem("expected the start code of a key frame"));
            }
            let size = |low, high| u32::from(u16::from_le_bytes([low, high]) & 0x3fff);
            Ok((size(*w0, *w1), size(*h0, *h1)))
        }
        b"VP8L" => {
            let [signature, a, b, c, d] = payload.first_chunk().ok_or_else(truncated)?;
            if *signature != 0x2f {
                return Err(problem("expected the signature of a lossless image"));
            }
            let bits = u32::from_le_bytes([*a, *b, *c, *d]);
            Ok(((bits & 0x3fff) + 1, ((bits >> 14) & 0x3fff) + 1))
        }
        b"VP8X" => {
            let [_, _, _, _, w0, w1, w2, h0, h1, h2] = payload.first_chunk().ok_or_else(truncated)?;
            Ok((u32::from_le_bytes([*w0, *w1, *w2, 0]) + 1, u32::from_le_bytes([*h0, *h1, *h2, 0]) + 1))
        }
        other => {
            Err(problem(&format!("expected a VP8, VP8L or VP8X chunk, found {:?}", other.escape_ascii().to_string())))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::codecs::{png::PngEncoder, webp::WebPEncoder};
    use image::{ExtendedColorType, ImageEncoder as _};

    #[test]
    fn alpha_is_read_from_the_header() {
        let pixels = [5, 6, 7, 0].repeat(6);
        let mut files = [(Vec::new(), Vec::new()), (Vec::new(), Vec::new())];
        for ((png, webp), colour) in files.iter_mut().zip([ExtendedColorType::Rgb8, ExtendedColorType::Rgba8]) {
            let pixels = &pixels[..6 * usize::from(colour.channel_count())];
            PngEncoder::new(png).write_image(pixels, 3, 2, colour).unwrap();
            WebPEncoder::new_lossless(webp).write_image(pixels, 3, 2, colour).unwrap();
        }
        let [(png, webp), (png_with_alpha, webp_with_alpha)] = &files;
        assert!(!has_alpha(png) && !has_alpha(webp), "without");
        assert!(has_alpha(png_with_alpha) && has_alpha(webp_with_alpha), "with");
        let header_end = 33;
        let transparent_colour =
            [&png[..header_end], b"\0\0\0\x06tRNS\0\x05\0\x06\0\x07crc.", &png[header_end..]].concat();
        assert!(has_alpha(&transparent_colour), "one transparent colour");
        let behind_text = [&png[..header_end], b"\0\0\0\x02tEXta\0crc.", &transparent_colour[header_end..]].concat();
        assert!(has_alpha(&behind_text) && !has_alpha(&behind_text[..50]), "after another chunk");
    }

    #[test]
    fn sixteen_bits_are_read_from_the_header() {
        let samples = [5; 6 * 8];
        let colours = [
            (ExtendedColorType::L8, false),
            (ExtendedColorType::L16, true),
            (ExtendedColorType::Rgb8, false),
            (ExtendedColorType::Rgb16, true),
            (ExtendedColorType::Rgba16, true),
        ];
        for (colour, deep) in colours {
            let mut png = Vec::new();
            let bytes = 6 * usize::from(colour.bits_per_pixel() / 8);
            PngEncoder::new(&mut png).write_image(&samples[..bytes], 3, 2, colour).unwrap();
            assert_eq!(has_16_bits(&png), deep, "{colour:?}");
            assert!(!has_16_bits(&png[..24]), "a truncated header");
        }
        let mut webp = Vec::new();
        WebPEncoder::new_lossless(&mut webp).write_image(&samples[..18], 3, 2, ExtendedColorType::Rgb8).unwrap();
        webp[24] = 16;
        assert!(!has_16_bits(&webp), "another format");
    }
}
