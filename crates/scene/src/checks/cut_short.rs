//! Images that were cut short, for example by a copy that was interrupted: found by their structure, without decoding.

use atsplat_pixels::{ImageFormat, jpeg_has_end, png_chunks};

/// The last chunk of a PNG, with its checksum.
pub(crate) const PNG_END: [u8; 12] = *b"\0\0\0\0IEND\xaeB`\x82";

/// What is wrong with an image whose end is missing; `None` for a whole one, and for bytes of another format. Damage before
/// the end is not found.
pub(crate) fn cut_short(bytes: &[u8]) -> Option<String> {
    let format = ImageFormat::sniff(bytes)?;
    let is_whole = match format {
        ImageFormat::Png => png_has_end(bytes),
        ImageFormat::Jpeg => jpeg_has_end(bytes),
        ImageFormat::WebP => webp_has_end(bytes),
        ImageFormat::Exr => true,
    };
    (!is_whole).then(|| format!("cut short: a {format} of {} bytes without its end", bytes.len()))
}

fn png_has_end(bytes: &[u8]) -> bool {
    png_chunks(bytes).any(|(name, data)| name == b"IEND" && data.is_some())
}

/// Compares the length in the RIFF header. Some encoders count the byte that pads an odd length without writing it.
fn webp_has_end(bytes: &[u8]) -> bool {
    const HEADER: u64 = 8;
    let length = bytes.get(4..).and_then(<[u8]>::first_chunk::<4>).map_or(0, |length| u32::from_le_bytes(*length));
    bytes.len() as u64 + 1 >= u64::from(length) + HEADER
}

#[cfg(test)]
mod tests {
    use atsplat_pixels::{ImageU8, encode_jpeg, encode_png};

    use super::*;

    fn image() -> ImageU8 {
        let samples = (0..40 * 30 * 3).map(|at| u8::try_from(at * 7 % 251).unwrap()).collect();
        ImageU8::new(40, 30, samples).unwrap()
    }

    #[test]
    fn every_shorter_copy_is_cut_short_and_no_whole_image_is() {
        let (png, jpeg) = (encode_png(&image()).unwrap(), encode_jpeg(&image(), 90).unwrap());
        let mut webp = b"RIFF\x18\0\0\0WEBPVP8 ".to_vec();
        webp.resize(0x18 + 8, 7);
        assert!(png.ends_with(&PNG_END) && jpeg.ends_with(&[0xff, 0xd9]));
        for (whole, header, tail) in [(&png, 8, 1), (&jpeg, 3, 1), (&webp, 12, 2)] {
            assert_eq!(cut_short(whole), None);
            assert_eq!(cut_short(&[&whole[..], b"more"].concat()), None, "bytes behind the end are ignored");
            for length in header..=whole.len() - tail {
                let message = cut_short(&whole[..length]).unwrap();
                assert!(message.ends_with(&format!("of {length} bytes without its end")), "{message}");
            }
        }
    }

    #[test]
    fn the_end_of_a_preview_is_not_that_of_the_image() {
        let jpeg = encode_jpeg(&image(), 90).unwrap();
        let preview = [0xff, 0xe1, 0, 6, 0xff, 0xd9, 0xff, 0xd9];
        let with_preview = [&jpeg[..2], &preview, &jpeg[2..]].concat();
        assert_eq!(cut_short(&with_preview), None);
        assert!(cut_short(&with_preview[..with_preview.len() - 2]).is_some());
    }

    #[test]
    fn bytes_of_other_formats_are_not_judged() {
        for bytes in [&b""[..], b"no image", b"\x76\x2f\x31\x01", b"\xff\xd8\xff\xc0\0\x02no marker"] {
            assert_eq!(cut_short(bytes), None, "{bytes:?}");
        }
    }
}
