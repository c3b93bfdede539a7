use libjpeg_turbo_rs::{Decoder, Image, JpegError, PixelFormat};

use crate::jpeg_segments::{END, SCAN, Segment, Segments};
use crate::size::header;
use crate::{DecodeLimits, ImageFormat, ImageU8, PixelError};

const FORMAT: ImageFormat = ImageFormat::Jpeg;

/// Real progressive JPEGs have ten scans; each additional one is a pass over all blocks for a few bytes.
const MAX_SCANS: usize = 100;

/// The last two bytes of a JPEG: the marker of its end.
pub const JPEG_END: [u8; 2] = [0xff, END];

/// Equal bytes at the end of the last scan from which on it is checked whether pixels need them. Padding is at most one byte.
const REPEATED: usize = 8;

/// Whether a JPEG has the marker of its end behind its first scan: a preview in the header has one too. In a scan, no other
/// 0xff is followed by its second byte (ITU-T T.81, B.1.1.5). Of a header with other bytes than markers, only decoding can
/// tell; it counts as whole.
pub fn jpeg_has_end(bytes: &[u8]) -> bool {
    let mut segments = Segments::of(bytes);
    loop {
        match segments.read() {
            Ok(Segment { marker: SCAN, bytes, .. }) => {
                return bytes.windows(JPEG_END.len()).rev().any(|pair| pair == JPEG_END);
            }
            Ok(_) => {}
            Err(error) => return !error.is_cut_short(),
        }
    }
}

/// A frame header.
pub(crate) struct Frame<'a> {
    /// Columns and rows.
    pub(crate) size: (u32, u32),
    /// Identifier, sampling factors (horizontal in the high nibble, vertical in the low one), quantisation table.
    components: &'a [[u8; 3]],
}

impl<'a> Frame<'a> {
    /// Finds the frame header among the marker segments (ITU-T T.81 B.2.2).
    pub(crate) fn find(bytes: &'a [u8]) -> Result<Self, PixelError> {
        let mut segments = Segments::of(bytes);
        loop {
            let segment = segments.read().map_err(|error| header(FORMAT, error.to_string()))?;
            let missing =
                |what: &str| Err(header(FORMAT, format!("{what} without a frame header at byte {}", segment.at)));
            match segment.marker {
                // The others are tables of Huffman codes, an extension, and conditions of arithmetic coding.
                0xc0..=0xcf if !matches!(segment.marker, 0xc4 | 0xc8 | 0xcc) => return Self::of(&segment),
                SCAN => return missing("scan"),
                END => return missing("end of image"),
                _ => {}
            }
        }
    }

    /// Of a frame's segment, the size suffices.
    fn of(segment: &Segment<'a>) -> Result<Self, PixelError> {
        let Some([_, _, _, _, _, h1, h0, w1, w0]) = segment.bytes.first_chunk() else {
            return Err(header(FORMAT, format!("frame header at byte {} is truncated", segment.at)));
        };
        let (width, height) = (u16::from_be_bytes([*w1, *w0]), u16::from_be_bytes([*h1, *h0]));
        if height == 0 {
            let feature = "a height after the first scan (DNL)".to_owned();
            return Err(PixelError::Unsupported { format: FORMAT, feature });
        }
        let (components, _) = segment.parameters().get(6..).unwrap_or_default().as_chunks();
        Ok(Self { size: (u32::from(width), u32::from(height)), components })
    }

    /// An error for unsupported sampling factors. Chroma may have the resolution of luma, a half or a quarter of it; black,
    /// the fourth component, must have that of luma.
    fn check_sampling(&self) -> Result<(), PixelError> {
        let factors = |component: &[u8; 3]| [component[1] >> 4, component[1] & 15];
        let [finest, ..] = self.components else { return Err(header(FORMAT, "a frame without components")) };
        let finest = factors(finest);
        let fits = |found: [u8; 2]| {
            std::iter::zip(found, finest).all(|(found, finest)| matches!(found, 1 | 2 | 4) && finest % found == 0)
        };
        let chroma_fits = self.components.iter().all(|component| fits(factors(component)));
        let black_fits = self.components.get(3).is_none_or(|black| factors(black) == finest);
        if chroma_fits && black_fits {
            return Ok(());
        }
        let listed: Vec<String> = self.components.iter().map(factors).map(|[x, y]| format!("{x}×{y}")).collect();
        Err(PixelError::Unsupported { format: FORMAT, feature: format!("sampling factors {}", listed.join(", ")) })
    }
}

/// Decodes bit for bit like libjpeg-turbo with default options, as Pillow does (see `JPEG.md` of this crate).
///
/// Stricter than Pillow in one way: truncated or corrupt data is an error, where libjpeg warns and fills with grey, or decodes the
/// zero bytes that an interrupted copy left at the end as pixels.
pub(crate) fn decode(bytes: &[u8], size: (u32, u32), limits: &DecodeLimits) -> Result<ImageU8, PixelError> {
    Frame::find(bytes)?.check_sampling()?;
    let damaged = |problem: String| PixelError::Decode { format: FORMAT, source: problem.into() };
    if !jpeg_has_end(bytes) {
        let found = format!("expected the marker of the image's end (ff d9), found none in {} bytes", bytes.len());
        return Err(damaged(found));
    }
    let image =
        decode_image(bytes, limits).map_err(|source| PixelError::Decode { format: FORMAT, source: source.into() })?;
    // Unknown markers and bytes behind the end cause none.
    if let Some(warning) = image.warnings.first() {
        return Err(damaged(warning.to_string()));
    }
    if let Some((shorter, byte)) = without_repeated_end(bytes)
        && decode_image(&shorter, limits).is_ok()
    {
        let found = format!("found {REPEATED} or more bytes {byte:#04x} behind the last pixel");
        return Err(damaged(format!("expected pixels up to the end of the last scan, {found}")));
    }
    let (width, height) = size;
    if (image.width, image.height) != (width as usize, height as usize) {
        return Err(header(
            FORMAT,
            format!("size {width}×{height}, but the data has {}×{}", image.width, image.height),
        ));
    }
    ImageU8::new(width, height, image.data)
}

fn decode_image(bytes: &[u8], limits: &DecodeLimits) -> Result<Image, JpegError> {
    let library = libjpeg_turbo_rs::DecodeLimits {
        max_width: limits.max_width as usize,
        max_height: limits.max_height as usize,
        max_pixels: limits.max_bytes / 3,
        max_scans: MAX_SCANS,
        ..Default::default()
    };
    Decoder::new_with_limits(bytes, library)?.with_output_format(PixelFormat::Rgb).decode_image()
}

/// The image without the last [`REPEATED`] bytes of its last scan, and their value, if they are equal: the library does not say where
/// the last pixel ends, but a scan that pixels need cannot be decoded without its end. Data that pixels need can end in equal bytes
/// too, in an area of one colour.
fn without_repeated_end(bytes: &[u8]) -> Option<(Vec<u8>, u8)> {
    let (scan, [byte, others @ ..]) = bytes.get(..end_of_scans(bytes)?)?.split_last_chunk::<REPEATED>()?;
    others.iter().all(|other| other == byte).then(|| ([scan, &JPEG_END].concat(), *byte))
}

/// Where the data of the last scan end; `None` if the image's end does not follow where a marker is expected.
fn end_of_scans(bytes: &[u8]) -> Option<usize> {
    let mut segments = Segments::of(bytes);
    let mut end = None;
    loop {
        match segments.read().ok()?.marker {
            END => return end,
            SCAN => end = Some(segments.skip_scan()?),
            _ => {}
        }
    }
}
