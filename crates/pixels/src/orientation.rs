use std::fmt;

use crate::jpeg_segments::{END, SCAN, Segments};
use crate::{ImageFormat, png_chunks};

/// EXIF's tag for the orientation.
const ORIENTATION: u16 = 0x0112;
/// EXIF's type for whole numbers of 16 bits.
const SHORT: u16 = 3;
/// That of 32 bits, in which some writers store the orientation.
const LONG: u16 = 4;
/// The prefix of EXIF data in a JPEG, and by mistake in some WebP files.
const EXIF: &[u8] = b"Exif\0\0";

/// EXIF orientation: how the stored image has to be rotated or mirrored for display.
///
/// [`decode`](crate::decode()) ignores it, as do Pillow's `Image.open` and the field's loaders; viewers and OpenCV's
/// `imread` apply it. Intrinsics may refer to either.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u16)]
pub enum Orientation {
    /// Mirrored left to right.
    Mirrored = 2,
    /// To be rotated by 180°.
    HalfTurn = 3,
    /// Mirrored top to bottom.
    Flipped = 4,
    /// Mirrored at the diagonal from the top left.
    Transposed = 5,
    /// To be rotated by 90° clockwise.
    Clockwise = 6,
    /// Mirrored at the other diagonal.
    Transversed = 7,
    /// To be rotated by 90° counter-clockwise.
    CounterClockwise = 8,
}

impl Orientation {
    /// The orientation of an encoded image; `None` if it is upright or not stated.
    ///
    /// The start of the file suffices for JPEG, and for PNG if the chunk `eXIf` is before the pixels, as in files of the
    /// common writers. WebP stores EXIF after the pixels: pass the whole file.
    pub fn of(bytes: &[u8]) -> Option<Self> {
        let exif = match ImageFormat::sniff(bytes)? {
            ImageFormat::Jpeg => exif_of_jpeg(bytes),
            ImageFormat::Png => exif_of_png(bytes),
            ImageFormat::WebP => exif_of_webp(bytes),
            ImageFormat::Exr => None,
        }?;
        Self::from_number(orientation_in(exif.strip_prefix(EXIF).unwrap_or(exif))?)
    }

    const fn from_number(number: u16) -> Option<Self> {
        Some(match number {
            2 => Self::Mirrored,
            3 => Self::HalfTurn,
            4 => Self::Flipped,
            5 => Self::Transposed,
            6 => Self::Clockwise,
            7 => Self::Transversed,
            8 => Self::CounterClockwise,
            _ => return None,
        })
    }
}

impl fmt::Display for Orientation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mirrored => "mirrored left to right by EXIF",
            Self::HalfTurn => "rotated 180° by EXIF",
            Self::Flipped => "mirrored top to bottom by EXIF",
            Self::Transposed => "mirrored at its diagonal by EXIF",
            Self::Clockwise => "rotated 90° clockwise by EXIF",
            Self::Transversed => "mirrored at its other diagonal by EXIF",
            Self::CounterClockwise => "rotated 90° counter-clockwise by EXIF",
        })
    }
}

/// The APP1 segment with the EXIF prefix, among the marker segments before the first scan (ITU-T T.81 B.1.1).
fn exif_of_jpeg(bytes: &[u8]) -> Option<&[u8]> {
    let mut segments = Segments::of(bytes);
    loop {
        let segment = segments.read().ok()?;
        match segment.marker {
            SCAN | END => return None,
            0xe1 if segment.parameters().starts_with(EXIF) => return Some(segment.parameters()),
            _ => {}
        }
    }
}

fn exif_of_png(bytes: &[u8]) -> Option<&[u8]> {
    let mut chunks = png_chunks(bytes).take_while(|(name, _)| *name != b"IEND");
    chunks.find(|(name, _)| *name == b"eXIf").and_then(|(_, data)| data)
}

/// A WebP is a sequence of chunks of name, length (little endian) and data padded to an even length (RFC 9649, section
/// 2.3).
fn exif_of_webp(bytes: &[u8]) -> Option<&[u8]> {
    let mut rest = bytes.get(12..)?;
    loop {
        let ([name, length], _) = rest.as_chunks::<4>().0.split_first_chunk::<2>()?;
        let length = usize::try_from(u32::from_le_bytes(*length)).ok()?;
        let end = length.checked_add(8)?;
        if name == b"EXIF" {
            return rest.get(8..end);
        }
        rest = rest.get(end.checked_add(length % 2)?..)?;
    }
}

/// The orientation in the first directory of a TIFF structure (EXIF 2.32, section 4.6.2), whose entries have 12 bytes:
/// tag, type, count and value.
fn orientation_in(tiff: &[u8]) -> Option<u16> {
    let big_endian = match tiff {
        [b'M', b'M', 0, 42, ..] => true,
        [b'I', b'I', 42, 0, ..] => false,
        _ => return None,
    };
    let short = |at: usize| {
        let bytes = *tiff.get(at..)?.first_chunk()?;
        Some(if big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    };
    let long = |at: usize| {
        let bytes = *tiff.get(at..)?.first_chunk()?;
        Some(if big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    };
    let directory = usize::try_from(long(4)?).ok()?;
    let entries = directory.checked_add(2)?;
    let value = |at: usize| match (short(at)?, short(at.checked_add(2)?)?) {
        (ORIENTATION, SHORT) => short(at.checked_add(8)?),
        (ORIENTATION, LONG) => u16::try_from(long(at.checked_add(8)?)?).ok(),
        _ => None,
    };
    (0..usize::from(short(directory)?)).find_map(|entry| value(entries.saturating_add(12 * entry)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A TIFF structure with one directory whose second entry is the orientation.
    fn tiff(big_endian: bool, orientation: u16) -> Vec<u8> {
        let short = |value: u16| if big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
        let long = |value: u32| if big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
        let mut bytes = if big_endian { b"MM".to_vec() } else { b"II".to_vec() };
        bytes.extend(short(42));
        bytes.extend(long(8));
        bytes.extend(short(2));
        for (tag, value) in [(0x0100, 6), (ORIENTATION, orientation)] {
            bytes.extend([short(tag), short(SHORT)].concat());
            bytes.extend(long(1));
            bytes.extend([short(value), short(0)].concat());
        }
        bytes.extend(long(0));
        bytes
    }

    fn jpeg(exif: &[u8]) -> Vec<u8> {
        let segment = |marker: u8, payload: &[u8]| {
            let length = u16::try_from(payload.len() + 2).unwrap().to_be_bytes();
            [&[0xff, marker], &length[..], payload].concat()
        };
        let jfif = segment(0xe0, b"JFIF\0\x01\x02\0\0\x01\0\x01\0\0");
        let xmp = segment(0xe1, b"http://ns.adobe.com/xap/1.0/\0<x/>");
        [b"\xff\xd8".to_vec(), jfif, xmp, segment(0xe1, &[EXIF, exif].concat())].concat()
    }

    fn png(exif: &[u8]) -> Vec<u8> {
        let chunk = |name: &[u8; 4], data: &[u8]| {
            let length = u32::try_from(data.len()).unwrap().to_be_bytes();
            [&length[..], name, data, &[0; 4]].concat()
        };
        [b"\x89PNG\r\n\x1a\n".to_vec(), chunk(b"IHDR", &[0; 13]), chunk(b"eXIf", exif)].concat()
    }

    fn webp(exif: &[u8]) -> Vec<u8> {
        let length = u32::try_from(exif.len()).unwrap().to_le_bytes();
        // The first chunk has an odd length, so it is padded.
        [b"RIFF\xff\0\0\0WEBPVP8 \x03\0\0\0abc\0EXIF".as_slice(), &length, exif].concat()
    }

    #[test]
    fn reads_the_orientation_in_every_container_and_byte_order() {
        for big_endian in [true, false] {
            for (number, expected) in [
                (1, None),
                (2, Some(Orientation::Mirrored)),
                (3, Some(Orientation::HalfTurn)),
                (6, Some(Orientation::Clockwise)),
                (8, Some(Orientation::CounterClockwise)),
                (9, None),
            ] {
                let exif = tiff(big_endian, number);
                for file in [jpeg(&exif), png(&exif), webp(&exif), webp(&[EXIF, &exif].concat())] {
                    assert_eq!(Orientation::of(&file), expected, "{number}, big endian: {big_endian}");
                    for length in 0..file.len() {
                        let found = Orientation::of(&file[..length]);
                        assert!(found.is_none() || found == expected, "truncated to {length} bytes: {found:?}");
                    }
                }
            }
        }
    }

    /// Its type and its four bytes are the last of the second entry, before the place of the next directory.
    #[test]
    fn an_orientation_of_32_bits_is_read() {
        for (big_endian, kind, number) in [(true, [0, 4], [0, 0, 0, 6]), (false, [4, 0], [6, 0, 0, 0])] {
            let mut exif = tiff(big_endian, 1);
            let entry = exif.len() - 16;
            exif[entry + 2..entry + 4].copy_from_slice(&kind);
            exif[entry + 8..entry + 12].copy_from_slice(&number);
            assert_eq!(Orientation::of(&jpeg(&exif)), Some(Orientation::Clockwise), "big endian: {big_endian}");
            exif[entry + 2..entry + 4].copy_from_slice(&[9; 2]);
            assert_eq!(Orientation::of(&jpeg(&exif)), None, "another type");
        }
    }

    #[test]
    fn a_directory_beyond_the_end_is_ignored() {
        let mut exif = tiff(false, 6);
        exif[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(Orientation::of(&jpeg(&exif)), None);
    }
}
