use libjpeg_turbo_rs::{Decoder, Image, JpegError, PixelFormat};

use crate::size::header;
use crate::{DecodeLimits, ImageFormat, ImageU8, PixelError};

const FORMAT: ImageFormat = ImageFormat::Jpeg;

/// Real progressive JPEGs have ten scans; each additional one is a pass over all blocks for a few bytes.
const MAX_SCANS: usize = 100;

/// The marker at the end of a JPEG.
const END: [u8; 2] = [0xff, 0xd9];

/// Equal bytes at the end of the last scan from which on it is checked whether pixels need them. Padding is at most one byte.
const REPEATED: usize = 8;

/// Whether a JPEG has the marker of its end behind its first scan: a preview in the header has one too. In a scan, no other
/// 0xff is followed by its second byte (ITU-T T.81, B.1.1.5). Of a header with other bytes than markers, only decoding can
/// tell; it counts as whole.
pub fn jpeg_has_end(bytes: &[u8]) -> bool {
    let mut rest = bytes.get(2..).unwrap_or_default();
    while let [0xff, marker, behind @ ..] = rest {
        rest = match (marker, behind) {
            (0xda, _) => return behind.windows(2).rev().any(|pair| pair == END),
            (0xff, _) => rest.get(1..).unwrap_or_default(),
            (0x01 | 0xd0..=0xd9, _) => behind,
            (_, [high, low, ..]) => behind.get(usize::from(u16::from_be_bytes([*high, *low]))..).unwrap_or_default(),
            _ => &[],
        };
    }
    // Neither the end of the bytes nor a marker.
    !matches!(rest, [] | [0xff])
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
        let problem = |text: String| header(FORMAT, text);
        let mut rest = bytes.get(2..).unwrap_or_default();
        loop {
            let at = bytes.len() - rest.len();
            let (marker, payload) = match rest {
                [0xff, 0xff, ..] => {
                    rest = rest.get(1..).unwrap_or_default();
                    continue;
                }
                [0xff, marker @ (0x01 | 0xd0..=0xd7), ..] => (*marker, 0),
                [0xff, 0xda, ..] => return Err(problem(format!("scan without a frame header at byte {at}"))),
                [0xff, 0xd9, ..] => return Err(problem(format!("end of image without a frame header at byte {at}"))),
                [0xff, marker, high, low, ..] => (*marker, usize::from(u16::from_be_bytes([*high, *low]))),
                [0xff, ..] | [] => return Err(problem(format!("truncated after {} bytes", bytes.len()))),
                [other, ..] => return Err(problem(format!("expected a marker at byte {at}, found {other:#04x}"))),
            };
            if matches!(marker, 0xc0..=0xcf) && !matches!(marker, 0xc4 | 0xc8 | 0xcc) {
                let Some([_, _, _, _, _, h1, h0, w1, w0]) = rest.first_chunk() else {
                    return Err(problem(format!("frame header at byte {at} is truncated")));
                };
                let (width, height) = (u16::from_be_bytes([*w1, *w0]), u16::from_be_bytes([*h1, *h0]));
                if height == 0 {
                    let feature = "a height after the first scan (DNL)".to_owned();
                    return Err(PixelError::Unsupported { format: FORMAT, feature });
                }
                let (components, _) = rest.get(10..2 + payload).unwrap_or_default().as_chunks();
                return Ok(Self { size: (u32::from(width), u32::from(height)), components });
            }
            let standalone = matches!(marker, 0x01 | 0xd0..=0xd7);
            if !standalone && payload < 2 {
                return Err(problem(format!(
                    "segment {marker:#04x} at byte {at}: expected a length of 2 or more, found {payload}"
                )));
            }
            rest = rest.get(2 + payload..).ok_or_else(|| {
                problem(format!("segment {marker:#04x} at byte {at}: {payload} bytes exceed the end of the file"))
            })?;
        }
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
    others.iter().all(|other| other == byte).then(|| ([scan, &END].concat(), *byte))
}

/// Where the data of the last scan end; `None` if the image's end does not follow where a marker is expected.
fn end_of_scans(bytes: &[u8]) -> Option<usize> {
    let mut at = 2;
    let mut end = None;
    loop {
        let [0xff, marker, behind @ ..] = bytes.get(at..)? else { return None };
        match marker {
            0xd9 => return end,
            0xff => at += 1,
            0x01 | 0xd0..=0xd8 => at += 2,
            _ => {
                let [high, low, ..] = behind else { return None };
                at += 2 + usize::from(u16::from_be_bytes([*high, *low]));
                if *marker == 0xda {
                    at += end_of_scan(bytes.get(at..)?)?;
                    end = Some(at);
                }
            }
        }
    }
}

/// Where the data of a scan end: at the first marker other than those of restarts, and at its fill bytes: any number of 0xff may
/// precede a marker (ITU-T T.81, B.1.1.2).
fn end_of_scan(data: &[u8]) -> Option<usize> {
    let is_end = |pair: &[u8]| matches!(pair, [0xff, next] if !matches!(next, 0x00 | 0xd0..=0xd7 | 0xff));
    let marker = data.windows(2).position(is_end)?;
    let last = data.get(..marker)?.iter().rposition(|byte| *byte != 0xff);
    Some(last.map_or(0, |last| last + 1))
}
