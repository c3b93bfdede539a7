//! PLY (Turk 1994) with the properties of 3DGS or of PlayCanvas' compressed variant.

mod ascii;
mod binary;
mod compressed;
mod gaussians;
mod header;
mod write;

pub(super) use write::write;

use atsplat_files::quoted;

use super::{Encoding, Format, Malformed, Stored};
use ascii::Text;
use binary::Binary;
use header::{Element, Header};

pub(super) fn read(bytes: &[u8]) -> Result<Stored, Malformed> {
    let header = Header::parse(bytes)?;
    let mut body = Body::of(bytes, &header);
    let stored = if compressed::matches(&header) {
        compressed::read(&header, &mut body)?
    } else {
        gaussians::read(&header, &mut body)?
    };
    body.finish(&header)?;
    Ok(stored)
}

/// RGB coefficients from `f_rest`, which holds all of red, then all of green, then all of blue.
fn interleaved<T: Copy>(rest: &[T], per_channel: usize) -> impl Iterator<Item = [T; 3]> {
    let (red, rest) = rest.split_at(per_channel);
    let (green, blue) = rest.split_at(per_channel);
    red.iter().zip(green).zip(blue).map(|((red, green), blue)| [*red, *green, *blue])
}

/// The rows after the header, element by element.
enum Body<'a> {
    Ascii(Text<'a>),
    Binary(Binary<'a>),
}

impl<'a> Body<'a> {
    fn of(bytes: &'a [u8], header: &Header<'_>) -> Self {
        let rest = &bytes[header.end..];
        match header.encoding {
            Encoding::Ascii => Self::Ascii(Text::new(rest, header.lines)),
            Encoding::BinaryLittleEndian => Self::Binary(Binary::new(rest, header.end, false)),
            Encoding::BinaryBigEndian => Self::Binary(Binary::new(rest, header.end, true)),
        }
    }

    /// Reads the next element's rows and passes the `requested` scalar properties of each to `take`, in that order.
    ///
    /// Checks first that the file is long enough, so that callers may allocate for the declared count.
    fn rows(&mut self, element: &Element<'_>, requested: &[usize], take: impl FnMut(&[f64])) -> Result<(), Malformed> {
        self.check_length(element)?;
        match self {
            Self::Ascii(text) => text.rows(element, requested, take),
            Self::Binary(binary) => binary.rows(element, requested, take),
        }
    }

    /// Skips the next element's rows.
    fn skip(&mut self, element: &Element<'_>) -> Result<(), Malformed> {
        self.rows(element, &[], |_| {})
    }

    /// Rejects data after the last row, which would be rows missing from the header's count. Blank text lines are
    /// allowed.
    fn finish(&self, header: &Header<'_>) -> Result<(), Malformed> {
        let rows = header.elements.last().map_or(0, |element| element.count);
        let trailing = match self {
            Self::Ascii(text) => {
                text.trailing_rows().map(|(line, rows)| (format!("line {line}"), format!("{rows} more")))
            }
            Self::Binary(binary) => binary.trailing_bytes().map(|(byte, remaining)| {
                let row = header.elements.last().map_or(0, Binary::smallest_row);
                let more = remaining.checked_div(row).filter(|more| *more > 0);
                let more = more.map_or_else(String::new, |more| format!(", enough for {more} more"));
                (format!("byte {byte}"), format!("{remaining} bytes{more}"))
            }),
        };
        match trailing {
            None => Ok(()),
            Some((location, found)) => {
                Err(Malformed::new(location, format!("the end of the file after the {rows} rows of the header"), found))
            }
        }
    }

    /// Rejects a row count that the rest of the file is too short for; returns the count otherwise.
    fn check_length(&self, element: &Element<'_>) -> Result<usize, Malformed> {
        let (remaining, row) = match self {
            Self::Ascii(text) => (text.remaining(), Text::smallest_row(element)),
            Self::Binary(binary) => (binary.remaining(), Binary::smallest_row(element)),
        };
        let needed = u128::from(element.count) * row as u128;
        // The last line of text may lack a line break.
        let slack = u128::from(matches!(self, Self::Ascii(_)));
        if needed > remaining as u128 + slack {
            let location = format!("element {}", quoted(element.name.as_bytes()));
            let expected = format!("at least {needed} bytes for {} rows", element.count);
            return Err(Malformed::new(location, expected, format!("{remaining} bytes")));
        }
        // The rows are in memory, so their count fits a usize.
        Ok(if row == 0 { 0 } else { usize::try_from(element.count).unwrap_or(remaining) })
    }
}
