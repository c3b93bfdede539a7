use super::ascii::Text;
use super::binary::Binary;
use super::header::{Element, Header};
use super::{Encoding, Fault};

/// What follows the header: the elements' rows, one element after the other.
pub(super) enum Body<'a> {
    Ascii(Text<'a>),
    Binary(Binary<'a>),
}

impl<'a> Body<'a> {
    pub(super) fn of(bytes: &'a [u8], header: &Header<'_>) -> Self {
        let rest = bytes.get(header.end..).unwrap_or_default();
        match header.encoding {
            Encoding::Ascii => Self::Ascii(Text::new(rest, header.lines)),
            Encoding::BinaryLittleEndian => Self::Binary(Binary::new(rest, header.end, false)),
            Encoding::BinaryBigEndian => Self::Binary(Binary::new(rest, header.end, true)),
        }
    }

    /// Reads the next element's rows and hands over the `wanted` scalar properties of each, in that order.
    ///
    /// That the file is long enough is checked before the first row: a count found in a header that got this
    /// far may be allocated.
    pub(super) fn rows(
        &mut self,
        element: &Element<'_>,
        wanted: &[usize],
        take: impl FnMut(&[f64]),
    ) -> Result<(), Fault> {
        self.check_length(element)?;
        match self {
            Self::Ascii(text) => text.rows(element, wanted, take),
            Self::Binary(binary) => binary.rows(element, wanted, take),
        }
    }

    /// Passes over the next element's rows.
    pub(super) fn skip(&mut self, element: &Element<'_>) -> Result<(), Fault> {
        self.rows(element, &[], |_| {})
    }

    /// Refuses what stands behind the last row: rows that the header does not count would be left out. Blank lines of
    /// a text are nothing.
    pub(super) fn finish(&self, header: &Header<'_>) -> Result<(), Fault> {
        let rows = header.elements.last().map_or(0, |element| element.count);
        let surplus = match self {
            Self::Ascii(text) => text.surplus().map(|(line, rows)| (format!("line {line}"), format!("{rows} more"))),
            Self::Binary(binary) => binary.surplus().map(|(byte, left)| {
                let row = header.elements.last().map_or(0, Binary::smallest_row);
                let more = left.checked_div(row).filter(|more| *more > 0);
                let more = more.map_or_else(String::new, |more| format!(", enough for {more} more"));
                (format!("byte {byte}"), format!("{left} bytes{more}"))
            }),
        };
        match surplus {
            None => Ok(()),
            Some((location, found)) => {
                Err(Fault::new(location, format!("the end of the file behind the {rows} rows of the header"), found))
            }
        }
    }

    /// Refuses a count of rows that the rest of the file cannot hold; the count that it can, otherwise.
    pub(super) fn check_length(&self, element: &Element<'_>) -> Result<usize, Fault> {
        let (left, row) = match self {
            Self::Ascii(text) => (text.left(), Text::smallest_row(element)),
            Self::Binary(binary) => (binary.left(), Binary::smallest_row(element)),
        };
        let needed = u128::from(element.count) * row as u128;
        // The last line of a text may end without a line break.
        let slack = u128::from(matches!(self, Self::Ascii(_)));
        if needed > left as u128 + slack {
            let location = format!("element {}", super::super::fault::shown(element.name.as_bytes()));
            let expected = format!("at least {needed} bytes for {} rows", element.count);
            return Err(Fault::new(location, expected, format!("{left} bytes")));
        }
        // Rows that lie in memory are no more than memory has bytes.
        Ok(if row == 0 { 0 } else { usize::try_from(element.count).unwrap_or(left) })
    }
}
