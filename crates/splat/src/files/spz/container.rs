//! Decompression of a file into the bytes of each attribute.

use std::io::{self, Read, Write};

use flate2::Compression;
use flate2::bufread::GzDecoder;
use flate2::write::GzEncoder;
use ruzstd::decoding::{FrameDecoder, StreamingDecoder};

use super::Malformed;
use super::header::{Header, MAGIC};

/// The first bytes of gzip's header.
pub(in super::super) const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];
/// Deflate's maximal compression: 258 bytes in two bits.
const DEFLATE_RATIO: u64 = 1032;
/// For version 4, the reference rejects headers that declare more than this many bytes of centres per byte of file.
const ZSTD_RATIO: u64 = 1024;
/// Window size that every Zstandard decoder should support (RFC 8878, 3.1.1.1.2), regardless of the stream's length.
const ZSTD_WINDOW: u64 = 8 << 20;
/// More than any known extension needs.
const MAX_EXTENSION_BYTES: u64 = 1 << 16;

/// A decompressed file.
pub(super) struct Container {
    pub(super) header: Header,
    /// Centres, opacities, colours, log-scales, quaternions, higher coefficients; with the lengths declared in the
    /// header.
    pub(super) attributes: [Vec<u8>; 6],
    pub(super) extensions: Vec<u8>,
    /// Descriptions of undeclared bytes, if any.
    pub(super) unused: Vec<String>,
}

impl Container {
    pub(super) fn open(bytes: &[u8]) -> Result<Self, Malformed> {
        if !bytes.starts_with(&MAGIC) {
            let mut stream = GzDecoder::new(bytes);
            let mut container = Self::in_one_stream(&mut stream, bytes.len() as u64, DEFLATE_RATIO)?;
            if !stream.get_ref().is_empty() {
                container.unused.push("bytes after the gzip stream".to_owned());
            }
            return Ok(container);
        }
        let header = Header::parse(bytes)?;
        if header.version < 4 {
            // Such files result from tools that decompress gzip transparently.
            return Self::in_one_stream(bytes, bytes.len() as u64, 1);
        }
        Self::in_streams(header, bytes)
    }

    /// Versions 1 to 3. `ratio` bounds the stream's expansion.
    fn in_one_stream(mut stream: impl Read, length: u64, ratio: u64) -> Result<Self, Malformed> {
        let header = Header::parse(&take(&mut stream, "SPZ header", Header::OLD_SIZE as u64)?)?;
        if header.version >= 4 {
            // Version 4 has a longer header, and compresses each stream itself.
            let found = format!("version {}", header.version);
            return Err(Malformed::new("SPZ header", "version 1 to 3 within gzip", found));
        }
        let needed: u64 = header.sizes().iter().sum();
        if needed > length.saturating_mul(ratio) {
            let expected = format!("a file that can hold {} Gaussians of {needed} bytes", header.count);
            return Err(Malformed::new("SPZ header", expected, format!("{length} bytes")));
        }
        let mut attributes = [const { Vec::new() }; 6];
        for (attribute, size) in attributes.iter_mut().zip(header.sizes()) {
            *attribute = take(&mut stream, "SPZ attributes", size)?;
        }
        let mut trailing = Vec::new();
        let at_most = stream.by_ref().take(MAX_EXTENSION_BYTES + 1).read_to_end(&mut trailing);
        at_most.map_err(|error| corrupt("SPZ stream", &error))?;
        if header.has_extensions && trailing.len() as u64 > MAX_EXTENSION_BYTES {
            return Err(Malformed::new("SPZ extensions", format!("at most {MAX_EXTENSION_BYTES} bytes"), "more"));
        }
        // gzip compares its checksum at the end of the stream alone.
        let more = io::copy(&mut stream, &mut io::sink()).map_err(|error| corrupt("SPZ stream", &error))?;
        let (mut extensions, mut unused) = (Vec::new(), Vec::new());
        if header.has_extensions {
            extensions = trailing;
        } else if !trailing.is_empty() {
            if header.unknown_flags == 0 {
                // With another count, version or degree, the bytes of one attribute are read as those of the next.
                let expected = format!("{needed} bytes of {} Gaussians", header.count);
                let found = needed + trailing.len() as u64 + more;
                return Err(Malformed::new("SPZ attributes", expected, format!("{found} bytes")));
            }
            unused.push("bytes after the last attribute".to_owned());
        }
        Ok(Self { header, attributes, extensions, unused })
    }

    /// Version 4: a table of (compressed, uncompressed) sizes, then one stream per non-empty attribute.
    fn in_streams(header: Header, bytes: &[u8]) -> Result<Self, Malformed> {
        let short =
            || Malformed::new("SPZ header", "32 bytes and the streams after them", format!("{} bytes", bytes.len()));
        if 9 * u64::from(header.count) > ZSTD_RATIO * bytes.len() as u64 {
            let expected = format!("a file that can hold {} Gaussians", header.count);
            return Err(Malformed::new("SPZ header", expected, format!("{} bytes", bytes.len())));
        }
        let (&streams, rest) = bytes.get(15..).and_then(<[u8]>::split_first).ok_or_else(short)?;
        let table = u32::from_le_bytes(*rest.first_chunk().ok_or_else(short)?) as usize;
        let declared = header.sizes().iter().filter(|size| **size > 0).count();
        if usize::from(streams) != declared {
            return Err(Malformed::new("SPZ header", format!("{declared} streams"), streams.to_string()));
        }
        let before_table = bytes.get(Header::NEW_SIZE..table).ok_or_else(short)?;
        let (mut extensions, mut unused) = (Vec::new(), Vec::new());
        if header.has_extensions {
            extensions = before_table.to_vec();
        } else if !before_table.is_empty() {
            unused.push("bytes between the header and the table of streams".to_owned());
        }
        let (sizes, mut rest) =
            bytes.get(table..).and_then(|rest| rest.split_at_checked(16 * declared)).ok_or_else(short)?;
        let mut sizes = sizes.as_chunks::<8>().0.iter().map(|size| u64::from_le_bytes(*size));

        let mut attributes = [const { Vec::new() }; 6];
        for (attribute, needed) in attributes.iter_mut().zip(header.sizes()) {
            if needed == 0 {
                continue;
            }
            let (compressed, uncompressed) = sizes.next().zip(sizes.next()).ok_or_else(short)?;
            if uncompressed != needed {
                return Err(Malformed::new("SPZ stream", format!("{needed} bytes"), format!("{uncompressed} bytes")));
            }
            let stream = usize::try_from(compressed).ok().and_then(|length| rest.split_at_checked(length));
            let (stream, trailing) = stream.ok_or_else(|| {
                Malformed::new("SPZ stream", format!("{compressed} bytes"), format!("{} bytes", rest.len()))
            })?;
            *attribute = unpack(stream, needed)?;
            rest = trailing;
        }
        if !rest.is_empty() {
            unused.push("bytes after the last stream".to_owned());
        }
        Ok(Self { header, attributes, extensions, unused })
    }
}

/// Decompresses a stream that is one Zstandard frame of `length` bytes, whose checksum may be missing.
fn unpack(stream: &[u8], length: u64) -> Result<Vec<u8>, Malformed> {
    let mut frame = FrameDecoder::new();
    frame.set_max_window_size(if length > ZSTD_WINDOW { length } else { ZSTD_WINDOW });
    let decoder = StreamingDecoder::new_with_decoder(stream, frame);
    let mut decoder = decoder.map_err(|error| corrupt("SPZ stream", &io::Error::other(error.to_string())))?;
    let bytes = take(&mut decoder, "SPZ stream", length)?;
    let mut more = Vec::new();
    decoder.by_ref().take(1).read_to_end(&mut more).map_err(|error| corrupt("SPZ stream", &error))?;
    if !(more.is_empty() && decoder.get_ref().is_empty()) {
        return Err(Malformed::new("SPZ stream", format!("{length} bytes"), "more"));
    }
    let frame = decoder.into_frame_decoder();
    match (frame.get_checksum_from_data(), frame.get_calculated_checksum()) {
        (Some(stored), Some(found)) if found != stored => {
            let expected = format!("contents with the checksum 0x{stored:08x}");
            Err(Malformed::new("SPZ stream", expected, format!("0x{found:08x}")))
        }
        _ => Ok(bytes),
    }
}

/// The next `length` bytes; memory grows with the bytes present, not with the declared length.
fn take(stream: &mut impl Read, location: &str, length: u64) -> Result<Vec<u8>, Malformed> {
    let mut bytes = Vec::new();
    stream.take(length).read_to_end(&mut bytes).map_err(|error| corrupt(location, &error))?;
    if bytes.len() as u64 == length {
        return Ok(bytes);
    }
    Err(Malformed::new(location, format!("{length} bytes"), format!("{} bytes", bytes.len())))
}

fn corrupt(location: &str, error: &io::Error) -> Malformed {
    Malformed::new(location, "compressed data", error.to_string())
}

/// Whether the bytes begin with a whole header of gzip (RFC 1952, 2.3.1): of a deflate stream, without unknown flags. Read as
/// an f32, such a header is positive and below 1e-19.
pub(in super::super) fn is_gzip(bytes: &[u8]) -> bool {
    matches!(bytes, [0x1f, 0x8b, 8, 0..0x20, ..])
}

/// Writes a gzip stream without a timestamp or name, so that the same Gaussians give the same file.
pub(in super::super) fn compress(payload: &[u8], out: &mut impl Write) -> io::Result<()> {
    let mut encoder = GzEncoder::new(out, Compression::default());
    encoder.write_all(payload)?;
    encoder.finish().map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(version: u32) -> Header {
        Header {
            version,
            count: 2,
            sh_degree: 0,
            fractional_bits: 12,
            antialiased: false,
            has_extensions: false,
            unknown_flags: 0,
        }
    }

    /// With enough bytes to be mistaken for the attributes.
    #[test]
    fn rejects_version_4_within_gzip() {
        let mut payload = header(4).to_bytes().to_vec();
        payload.extend([7; 200]);
        let mut file = Vec::new();
        compress(&payload, &mut file).unwrap();
        let error = Container::open(&file).err().unwrap();
        assert!(format!("{error:?}").contains("version 1 to 3 within gzip"), "{error:?}");
    }

    /// However many bytes follow the attributes, the stream is read to its end.
    #[test]
    fn the_checksum_of_gzip_is_compared_behind_many_bytes() {
        let most = usize::try_from(MAX_EXTENSION_BYTES).unwrap();
        let (none, extended, unknown) = (0, 2, 0x80);
        // Stored as it is, so that a byte of a centre can be changed.
        let file = |flags: u8, trailing: usize| {
            let attributes: Vec<u8> = (0..2 * (9 + 1 + 3 + 3 + 4)).collect();
            let mut header = header(3).to_bytes();
            header[14] = flags;
            let payload = [&header[..], &attributes, &vec![0; trailing]].concat();
            let mut encoder = GzEncoder::new(Vec::new(), Compression::none());
            encoder.write_all(&payload).unwrap();
            let bytes = encoder.finish().unwrap();
            let centres = bytes.windows(18).position(|window| window == &attributes[..18]).unwrap();
            (bytes, centres)
        };
        for trailing in [0, 1, most, most + 1, 3 * most] {
            let (mut bytes, centres) = file(unknown, trailing);
            let unused = Container::open(&bytes).unwrap_or_else(|error| panic!("{trailing}: {error:?}")).unused;
            assert_eq!(unused.is_empty(), trailing == 0, "{trailing}: {unused:?}");
            bytes[centres + 4] ^= 0x10;
            let error = Container::open(&bytes).err().unwrap_or_else(|| panic!("{trailing} bytes hide an error"));
            assert_eq!((error.location.as_str(), error.expected.as_str()), ("SPZ stream", "compressed data"));
            // Of a file without flags, they contradict the header.
            let error = Container::open(&file(none, trailing).0).err().map(|error| (error.expected, error.found));
            let expected = ("40 bytes of 2 Gaussians".to_owned(), format!("{} bytes", 40 + trailing));
            assert_eq!(error, (trailing > 0).then_some(expected));
        }
        let extensions = |trailing: usize| Container::open(&file(extended, trailing).0).map(|of| of.extensions.len());
        assert_eq!(extensions(most).unwrap(), most);
        let error = extensions(most + 1).unwrap_err();
        assert_eq!((error.location.as_str(), error.expected.as_str()), ("SPZ extensions", "at most 65536 bytes"));
    }

    /// XXH64 of "abc" is 44bc2cf5ad770999 (xxHash's own test vector), of which the frame holds the lower half.
    #[test]
    fn the_checksum_of_a_zstandard_frame_is_compared() {
        let frame = |flags: u8, contents: &[u8; 3], checksum: &[u8]| {
            [&[0x28, 0xb5, 0x2f, 0xfd, flags, 3, 0x19, 0, 0], &contents[..], checksum].concat()
        };
        let (single, checked) = (0x20, 0x24);
        let checksum = [0x99, 0x09, 0x77, 0xad];
        assert_eq!(unpack(&frame(checked, b"abc", &checksum), 3).unwrap(), b"abc");
        assert_eq!(unpack(&frame(single, b"abd", &[]), 3).unwrap(), b"abd", "none to compare");
        let error = unpack(&frame(checked, b"abd", &checksum), 3).unwrap_err();
        assert_eq!(error.expected, "contents with the checksum 0xad770999");
        let error = unpack(&frame(checked, b"abc", &[0x99, 0x09, 0x77, 0xac]), 3).unwrap_err();
        assert_eq!(
            (error.expected.as_str(), error.found.as_str()),
            ("contents with the checksum 0xac770999", "0xad770999")
        );
    }
}
