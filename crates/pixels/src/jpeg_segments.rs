use thiserror::Error;

/// The marker of a scan: the header in its segment is followed by data.
pub(crate) const SCAN: u8 = 0xda;
/// The marker of the image's end.
pub(crate) const END: u8 = 0xd9;

/// Bytes of a marker.
const MARKER: usize = 2;
/// Bytes of a segment's marker and length.
const MARKER_AND_LENGTH: usize = 4;

/// Reads the markers of a JPEG behind that of its start, one after the other, with their segments (ITU-T T.81, B.1.1).
#[derive(Debug)]
pub(crate) struct Segments<'a> {
    file: &'a [u8],
    /// Where the next marker is, or why that is not known.
    next: Result<usize, SegmentError>,
}

/// A marker and its segment, of which only the marker and the length need be there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segment<'a> {
    pub(crate) marker: u8,
    /// Where the marker is in the file.
    pub(crate) at: usize,
    /// The file from the marker on.
    pub(crate) bytes: &'a [u8],
    length: Result<usize, SegmentError>,
}

/// Why there is no next marker.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub(crate) enum SegmentError {
    #[error("truncated after {length} bytes")]
    Truncated { length: usize },
    #[error("expected a marker at byte {at}, found {found:#04x}")]
    NoMarker { at: usize, found: u8 },
    #[error("segment {marker:#04x} at byte {at}: expected a length of 2 or more, found {stated}")]
    TooShort { marker: u8, at: usize, stated: usize },
    #[error("segment {marker:#04x} at byte {at}: {stated} bytes exceed the end of the file")]
    BeyondEnd { marker: u8, at: usize, stated: usize },
}

impl SegmentError {
    /// Whether the file ends too early, and what is there may be right.
    pub(crate) const fn is_cut_short(self) -> bool {
        matches!(self, Self::Truncated { .. } | Self::BeyondEnd { .. })
    }
}

impl<'a> Segments<'a> {
    /// Those of a file that starts like a JPEG.
    pub(crate) const fn of(file: &'a [u8]) -> Self {
        Self { file, next: Ok(MARKER) }
    }

    /// The next marker. A damaged length of its segment is an error of the following call only. Behind the header of a scan, the data
    /// are to be skipped first ([`Self::skip_scan`]).
    pub(crate) fn read(&mut self) -> Result<Segment<'a>, SegmentError> {
        let mut at = self.next?;
        let bytes = loop {
            match self.file.get(at..).unwrap_or_default() {
                // Any number of these may precede a marker (B.1.1.2).
                [0xff, 0xff, ..] => at += 1,
                bytes => break bytes,
            }
        };
        let (marker, length) = match bytes {
            [0xff, marker @ (0x01 | 0xd0..=0xd7 | END), ..] => (*marker, Ok(MARKER)),
            [0xff, marker, high, low, ..] => {
                let stated = usize::from(u16::from_be_bytes([*high, *low]));
                (*marker, length_of(*marker, at, stated, bytes.len()))
            }
            [0xff, ..] | [] => return Err(SegmentError::Truncated { length: self.file.len() }),
            [found, ..] => return Err(SegmentError::NoMarker { at, found: *found }),
        };
        self.next = length.map(|length| at + length);
        Ok(Segment { marker, at, bytes, length })
    }

    /// Skips the data of a scan, whose header was read last, and returns where they end: at the first marker other than those of
    /// restarts, and at the bytes 0xff that precede it. `None` if no marker follows.
    pub(crate) fn skip_scan(&mut self) -> Option<usize> {
        let start = self.next.ok()?;
        let data = self.file.get(start..)?;
        let is_end = |pair: &[u8]| matches!(pair, [0xff, next] if !matches!(next, 0x00 | 0xd0..=0xd7 | 0xff));
        let marker = data.windows(MARKER).position(is_end)?;
        let last = data.get(..marker)?.iter().rposition(|byte| *byte != 0xff);
        let end = start + last.map_or(0, |last| last + 1);
        self.next = Ok(end);
        Some(end)
    }
}

impl<'a> Segment<'a> {
    /// What is in the segment behind its length; empty for a marker without a segment, and for a damaged segment.
    pub(crate) fn parameters(&self) -> &'a [u8] {
        self.length.ok().and_then(|length| self.bytes.get(MARKER_AND_LENGTH..length)).unwrap_or_default()
    }
}

/// The length of a segment with its marker, of `available` bytes up to the file's end. The stated one does not count the marker.
fn length_of(marker: u8, at: usize, stated: usize, available: usize) -> Result<usize, SegmentError> {
    let length = MARKER + stated;
    if length < MARKER_AND_LENGTH {
        return Err(SegmentError::TooShort { marker, at, stated });
    }
    if length > available {
        return Err(SegmentError::BeyondEnd { marker, at, stated });
    }
    Ok(length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ImageU8, encode_jpeg};

    /// Marker, place and parameters.
    type Found<'a> = (u8, usize, &'a [u8]);

    /// Each segment up to the first error, which is the last.
    fn all(file: &[u8]) -> (Vec<Found<'_>>, SegmentError) {
        let (mut segments, mut found) = (Segments::of(file), Vec::new());
        loop {
            match segments.read() {
                Ok(segment) => found.push((segment.marker, segment.at, segment.parameters())),
                Err(error) => {
                    assert_eq!(segments.read().unwrap_err(), error, "again");
                    return (found, error);
                }
            }
        }
    }

    #[test]
    fn markers_have_segments_or_stand_alone_and_may_follow_fill_bytes() {
        let file = b"\xff\xd8\xff\xfe\0\x04ab\xff\xff\xff\xd3\xff\x01\xff\xe1\0\x02\xff\xd9\xff\xfe\0\x03c";
        let (found, error) = all(file);
        let expected: [Found<'_>; 6] =
            [(0xfe, 2, b"ab"), (0xd3, 10, b""), (0x01, 12, b""), (0xe1, 14, b""), (END, 18, b""), (0xfe, 20, b"c")];
        assert_eq!(found, expected);
        assert_eq!(error.to_string(), "truncated after 25 bytes");
    }

    /// The marker of a damaged segment is read before the error.
    #[test]
    fn damaged_segments_and_other_bytes_are_errors() {
        let cases: [(&[u8], usize, bool, &str); 8] = [
            (b"", 0, true, "truncated after 2 bytes"),
            (b"\xff", 0, true, "truncated after 3 bytes"),
            (b"\xff\xff", 0, true, "truncated after 4 bytes"),
            (b"\xff\xfe\0", 0, true, "truncated after 5 bytes"),
            (b"\xff\xfe\0\x05ab", 1, true, "segment 0xfe at byte 2: 5 bytes exceed the end of the file"),
            (b"\xff\xfe\0\x01ab", 1, false, "segment 0xfe at byte 2: expected a length of 2 or more, found 1"),
            (b"\xff\xfe\0\x03a\x0b\xff", 1, false, "expected a marker at byte 7, found 0x0b"),
            (b"\xff\xfe\0\x03a\xff", 1, true, "truncated after 8 bytes"),
        ];
        for (behind, markers, cut_short, message) in cases {
            let file = [&b"\xff\xd8"[..], behind].concat();
            let (found, error) = all(&file);
            assert_eq!((found.len(), error.is_cut_short(), &*error.to_string()), (markers, cut_short, message));
        }
        assert_eq!(all(b"\xff").1.to_string(), "truncated after 1 bytes");
    }

    /// In the data are a zero behind 0xff, a marker of a restart, and bytes 0xff before the marker of the next scan.
    #[test]
    fn data_of_scans_end_before_a_marker_and_its_fill_bytes() {
        let file = b"\xff\xd8\xff\xda\0\x03h12\xff\0\xff\xd74\xff\xff\xff\xda\0\x02\xff\xd9";
        let mut segments = Segments::of(file);
        assert_eq!(segments.read().unwrap().parameters(), b"h");
        assert_eq!(segments.skip_scan(), Some(14));
        assert_eq!(segments.read().unwrap().at, 16);
        assert_eq!(segments.skip_scan(), Some(20), "no data");
        assert_eq!(segments.read().unwrap().marker, END);
        assert_eq!(segments.skip_scan(), None);
        for damaged in [&file[..14], &file[..16], &file[..4], &file[..6]] {
            let mut segments = Segments::of(damaged);
            assert!(segments.read().is_err() || segments.skip_scan().is_none(), "{damaged:?}");
        }
    }

    /// A whole file, and every part of it from the beginning: its segments are those of the whole file that are there.
    #[test]
    fn a_truncated_file_has_the_first_segments() {
        let samples = (0..24 * 16 * 3).map(|at| u8::try_from(at * 7 % 251).unwrap()).collect();
        let file = encode_jpeg(&ImageU8::new(24, 16, samples).unwrap(), 90).unwrap();
        let header = |file: &[u8]| {
            let (mut segments, mut markers) = (Segments::of(file), Vec::new());
            while let Ok(segment) = segments.read() {
                markers.push((segment.marker, segment.at));
                if segment.marker == SCAN && segments.skip_scan().is_none() {
                    break;
                }
            }
            markers
        };
        let whole = header(&file);
        assert_eq!((whole.first().map(|(_, at)| *at), whole.last()), (Some(2), Some(&(END, file.len() - 2))));
        for length in 0..file.len() {
            let found = header(&file[..length]);
            let there = whole.iter().take_while(|(_, at)| at + MARKER <= length).count();
            // Without the marker behind the data, or the length of a segment.
            assert!(found.len() <= there && whole.starts_with(&found), "{length}: {found:?}");
            assert!(found.len() + 1 >= there, "{length}: {found:?}");
        }
    }
}
