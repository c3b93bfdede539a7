//! Headers of files that another program rendered: their stored samples have to be the image.

use std::ops::RangeInclusive;

use crate::{ImageFormat, Orientation, PixelError, png_chunks};

/// Exponents in `gAMA`, times 100 000, of samples that are encoded for display: 1/2.8 to 1/1.7.
const FOR_DISPLAY: RangeInclusive<u32> = 35_000..=60_000;
/// Transfer functions in `cICP` that are not for a display of standard range: linear, logarithmic, PQ, SMPTE 428, HLG
/// (ITU-T H.273, table 3).
const NOT_FOR_DISPLAY: [u8; 6] = [8, 9, 10, 16, 17, 18];

/// An error for a format other than PNG, and for a header by which viewers rotate, mirror or encode the stored samples
/// before they show them. Damaged files and EXR are left to the decoder.
pub(crate) fn check_header(bytes: &[u8]) -> Result<(), PixelError> {
    let unusable = |expected, found, remedy| Err(PixelError::UnusableRender { expected, found, remedy });
    if let Some(format @ (ImageFormat::Jpeg | ImageFormat::WebP)) = ImageFormat::sniff(bytes) {
        let remedy = "the losses of other formats would count as errors of the method";
        return unusable("a PNG or EXR file", format!("a {format}"), remedy);
    }
    if let Some(orientation) = Orientation::of(bytes) {
        let found = format!("one that is {orientation}");
        return unusable("an upright image", found, "store the pixels as they are to be compared");
    }
    if let Some(pictures) = other_pictures(bytes) {
        let found = format!("an animation of {pictures} according to `acTL`");
        return unusable("a PNG of one picture", found, "store the picture that is to be compared in a separate file");
    }
    if let Some(found) = other_encoding(bytes) {
        return unusable("samples encoded as sRGB", found, "encode them, or correct the header");
    }
    Ok(())
}

/// Whether a PNG states that its samples are not encoded for a display of standard range, as `gAMA` does for linear light, and `cICP`
/// for PQ, HLG and a narrow range; `false` for other formats. [`decode`](crate::decode()) takes samples as they are stored.
///
/// The chunks before the pixels suffice.
pub fn has_other_encoding(bytes: &[u8]) -> bool {
    other_encoding(bytes).is_some()
}

/// The complete chunks of a PNG before its first image; none in another format.
fn header_chunks(bytes: &[u8]) -> impl Iterator<Item = (&[u8; 4], &[u8])> {
    let is_png = ImageFormat::sniff(bytes) == Some(ImageFormat::Png);
    let before = png_chunks(if is_png { bytes } else { &[] }).take_while(|(name, _)| *name != b"IDAT");
    before.filter_map(|(name, data)| Some((name, data?)))
}

/// The number of pictures of an animated PNG with several: which of them is meant, only its writer knows.
fn other_pictures(bytes: &[u8]) -> Option<u32> {
    let pictures = header_chunks(bytes).find_map(|(name, data)| match (name, data) {
        (b"acTL", [a, b, c, d, ..]) => Some(u32::from_be_bytes([*a, *b, *c, *d])),
        _ => None,
    })?;
    (pictures > 1).then_some(pictures)
}

/// What a PNG says about the encoding of its samples, if it is not one for display. `cICP` takes precedence over a
/// profile, which is not read, and a profile over `gAMA` (PNG specification, third edition, 4.3).
fn other_encoding(bytes: &[u8]) -> Option<String> {
    let (mut has_profile, mut exponent) = (false, None);
    for (name, data) in header_chunks(bytes) {
        match (name, data) {
            (b"cICP", [_, transfer, ..]) if NOT_FOR_DISPLAY.contains(transfer) => {
                return Some(format!("transfer function {transfer} in `cICP`"));
            }
            (b"cICP", [_, _, _, 0, ..]) => return Some("samples of the narrow range 16 to 235 in `cICP`".to_owned()),
            (b"cICP", _) => return None,
            (b"iCCP" | b"sRGB", _) => has_profile = true,
            (b"gAMA", [a, b, c, d, ..]) => exponent = Some(u32::from_be_bytes([*a, *b, *c, *d])),
            _ => {}
        }
    }
    let exponent = exponent.filter(|exponent| !has_profile && !FOR_DISPLAY.contains(exponent))?;
    Some(format!("the exponent {:.3} in `gAMA`", f64::from(exponent) / 100_000.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ImageU8, encode_jpeg, encode_png};

    fn image() -> ImageU8 {
        ImageU8::new(2, 1, vec![10, 20, 30, 40, 50, 60]).unwrap()
    }

    /// A PNG with these chunks after its header.
    fn png(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
        let plain = encode_png(&image()).unwrap();
        let (header, pixels) = plain.split_at(33);
        let mut bytes = header.to_vec();
        for &(name, data) in chunks {
            let length = u32::try_from(data.len()).unwrap().to_be_bytes();
            bytes.extend([&length[..], &name[..], data, b"crc."].concat());
        }
        [&bytes[..], pixels].concat()
    }

    fn problem(bytes: &[u8]) -> Option<String> {
        check_header(bytes).err().map(|error| error.to_string())
    }

    #[test]
    fn samples_that_are_not_encoded_for_display_are_rejected() {
        let [linear, usual] = [100_000u32, 45_455].map(u32::to_be_bytes);
        let found = |chunks: &[(&[u8; 4], &[u8])]| problem(&png(chunks));
        let expected = |found: &str| {
            Some(format!("expected samples encoded as sRGB, found {found}: encode them, or correct the header"))
        };
        assert_eq!(found(&[(b"gAMA", &linear)]), expected("the exponent 1.000 in `gAMA`"));
        assert_eq!(found(&[(b"tEXt", b"a\0"), (b"cICP", &[9, 16, 0, 1])]), expected("transfer function 16 in `cICP`"));
        let narrow = expected("samples of the narrow range 16 to 235 in `cICP`");
        assert_eq!(found(&[(b"cICP", &[1, 13, 0, 0])]), narrow);
        assert_eq!(found(&[(b"cICP", &[1, 13, 0, 1])]), None);
        assert_eq!(found(&[]), None);
        assert_eq!(found(&[(b"gAMA", &usual)]), None);
        assert_eq!(found(&[(b"gAMA", &linear), (b"sRGB", &[0])]), None, "sRGB takes precedence");
        assert_eq!(found(&[(b"gAMA", &linear), (b"cICP", &[16, 13, 0, 1])]), None, "primaries 16, but sRGB's function");
    }

    #[test]
    fn rotated_images_and_other_formats_are_rejected() {
        // One entry: the orientation, half a turn.
        let exif = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x03\0\0\0\0\0\0\0";
        let rotated = problem(&png(&[(b"eXIf", exif)])).unwrap();
        let expected = "expected an upright image, found one that is rotated 180° by EXIF: ";
        assert!(rotated.starts_with(expected), "{rotated}");
        let jpeg = problem(&encode_jpeg(&image(), 95).unwrap()).unwrap();
        assert!(jpeg.starts_with("expected a PNG or EXR file, found a JPEG: "), "{jpeg}");
    }

    #[test]
    fn animations_are_rejected_unless_they_have_one_picture() {
        let of = |pictures: u32| [pictures, 7].map(u32::to_be_bytes).concat();
        let found = |pictures| problem(&png(&[(b"tEXt", b"a\0"), (b"acTL", &of(pictures))]));
        let several = found(3).unwrap();
        assert!(
            several.starts_with("expected a PNG of one picture, found an animation of 3 according to "),
            "{several}"
        );
        assert_eq!(found(1), None, "it repeats one picture seven times");
        let late =
            [encode_png(&image()).unwrap(), [&12u32.to_be_bytes()[..], b"acTL", &of(3), b"crc."].concat()].concat();
        assert_eq!(problem(&late), None, "after the image it has no meaning");
    }

    #[test]
    fn a_truncated_header_is_left_to_the_decoder() {
        let bytes = png(&[(b"gAMA", &45_455u32.to_be_bytes())]);
        assert!((0..bytes.len()).all(|length| check_header(&bytes[..length]).is_ok()));
    }
}
