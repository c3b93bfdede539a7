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
        let is_stored = |element: &&Element<'_>| element.count > 0 && !element.properties.is_empty();
        let last = header.elements.iter().rev().find(is_stored).or(header.elements.last());
        let trailing = match self {
            Self::Ascii(text) => {
                text.trailing_rows().map(|(line, rows)| (format!("line {line}"), format!("{rows} more")))
            }
            Self::Binary(binary) => binary.trailing_bytes().map(|(byte, remaining)| {
                let row = last.map_or(0, Binary::smallest_row);
                let more = remaining.checked_div(row).filter(|more| *more > 0);
                let more = more.map_or_else(String::new, |more| format!(", enough for {more} more"));
                (format!("byte {byte}"), format!("{remaining} bytes{more}"))
            }),
        };
        match trailing {
            None => Ok(()),
            Some((location, found)) => {
                let rows = |Element { name, count, .. }: &Element<'_>| {
                    format!("the {count} rows of element {}", quoted(name.as_bytes()))
                };
                let rows = last.map_or_else(|| "the header".to_owned(), rows);
                Err(Malformed::new(location, format!("the end of the file after {rows}"), found))
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

#[cfg(test)]
mod tests {
    use super::*;

    /// As Brush writes it. Of two such comments, the last counts.
    #[test]
    fn a_comment_states_whether_training_was_antialiased() {
        let names = "x y z rot_0 rot_1 rot_2 rot_3 scale_0 scale_1 scale_2 opacity f_dc_0 f_dc_1 f_dc_2";
        let properties: String = names.split(' ').flat_map(|name| ["property float ", name, "\n"]).collect();
        let of = |comments: &str| {
            let header =
                format!("ply\nformat binary_little_endian 1.0\n{comments}element vertex 1\n{properties}end_header\n");
            read(&[header.into_bytes(), vec![0; 56]].concat()).unwrap().antialiased
        };
        let [mip, default] = ["mip", "default"].map(|mode| format!("comment SplatRenderMode: {mode}\n"));
        assert_eq!(of(&format!("comment Exported from Brush\ncomment SH degree: 0\n{mip}")), Some(true));
        assert_eq!((of(&default), of(&[&*mip, &default].concat())), (Some(false), Some(false)));
        for other in ["", "comment mip\n", "comment SplatRenderMode: other\n", "obj_info SplatRenderMode: mip\n"] {
            assert_eq!(of(other), None, "{other}");
        }
    }

    /// An element without rows, or whose rows have no bytes, is not where the file should have ended.
    #[test]
    fn data_after_the_end_names_the_last_element_with_rows() {
        let names = "x y z rot_0 rot_1 rot_2 rot_3 scale_0 scale_1 scale_2 opacity f_dc_0 f_dc_1 f_dc_2";
        let properties: String = names.split(' ').flat_map(|name| ["property float ", name, "\n"]).collect();
        let empty = "element face 0\nproperty list uchar int vertex_indices\nelement void 3\nend_header\n";
        let header =
            format!("ply\nformat binary_little_endian 1.0\nelement vertex 2\n{properties}{empty}").into_bytes();
        let of = |more: usize| read(&[header.clone(), vec![0; 2 * 56 + more]].concat()).err();
        assert!(of(0).is_none());
        let error = of(1).unwrap();
        assert_eq!(error.location, format!("byte {}", header.len() + 2 * 56));
        assert_eq!(error.expected, "the end of the file after the 2 rows of element \"vertex\"");
        assert_eq!(error.found, "1 bytes");
    }
}
