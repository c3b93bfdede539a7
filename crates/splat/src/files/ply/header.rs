use std::collections::HashSet;

use atsplat_files::quoted;

use super::{Encoding, Malformed};

/// The parsed header of a PLY file.
#[derive(Debug)]
pub(super) struct Header<'a> {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element<'a>>,
    /// Offset of the first byte after the header.
    pub(super) end: usize,
    /// Number of header lines.
    pub(super) lines: usize,
    /// Whether training was antialiased, if a comment of Brush states it.
    pub(super) antialiased: Option<bool>,
}

/// The key of the comment in which Brush (`crates/brush-serde/src/export.rs`) states how its Gaussians were rendered in training.
const RENDER_MODE: &str = "SplatRenderMode:";

/// An element: rows with the same properties.
#[derive(Debug)]
pub(super) struct Element<'a> {
    pub(super) name: &'a str,
    pub(super) count: u64,
    pub(super) properties: Vec<Property<'a>>,
}

/// A column.
#[derive(Debug)]
pub(super) struct Property<'a> {
    pub(super) name: &'a str,
    pub(super) kind: Kind,
}

/// Type of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { length: Scalar, item: Scalar },
}

/// Number types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    /// Those without fractions.
    pub(super) const INTEGERS: [Self; 6] = [Self::I8, Self::U8, Self::I16, Self::U16, Self::I32, Self::U32];

    fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// Its name in a header.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::I8 => "char",
            Self::U8 => "uchar",
            Self::I16 => "short",
            Self::U16 => "ushort",
            Self::I32 => "int",
            Self::U32 => "uint",
            Self::F32 => "float",
            Self::F64 => "double",
        }
    }

    /// Size in bytes in a binary file.
    pub(super) const fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

impl<'a> Header<'a> {
    pub(super) fn parse(bytes: &'a [u8]) -> Result<Self, Malformed> {
        let (mut encoding, mut antialiased) = (None, None);
        let mut elements: Vec<Element<'_>> = Vec::new();
        let (mut element_names, mut property_names) = (HashSet::new(), HashSet::new());
        let (mut end, mut lines) = (0, 0);
        loop {
            let rest = &bytes[end..];
            let Some(length) = rest.iter().position(|byte| *byte == b'\n') else {
                return Err(malformed(lines + 1, "end_header", "the end of the file"));
            };
            let line = rest[..length].trim_ascii();
            end += length + 1;
            lines += 1;
            let text = str::from_utf8(line).unwrap_or_default();
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            match *words {
                ["ply"] if lines == 1 => {}
                ["comment", RENDER_MODE, "mip"] => antialiased = Some(true),
                ["comment", RENDER_MODE, "default"] => antialiased = Some(false),
                ["comment" | "obj_info", ..] => {}
                // A comment may be in any encoding, so that it is not valid UTF-8; blank lines are ignored.
                [] if line.is_empty() || line.starts_with(b"comment") || line.starts_with(b"obj_info") => {}
                ["format", name, version] if encoding.is_none() => encoding = Some(format(lines, name, version)?),
                ["element", name, count] => {
                    let count = count.parse::<u64>().ok().filter(|count| i64::try_from(*count).is_ok());
                    let count = count.ok_or_else(|| malformed(lines, "a count of rows below 2⁶³", &quoted(line)))?;
                    if !element_names.insert(name) {
                        return Err(malformed(lines, "each element once", &quoted(line)));
                    }
                    property_names.clear();
                    elements.push(Element { name, count, properties: Vec::new() });
                }
                ["property", .., name] => {
                    let kind =
                        kind(&words).ok_or_else(|| malformed(lines, "a property of a known type", &quoted(line)))?;
                    let element = elements.last_mut();
                    let element =
                        element.ok_or_else(|| malformed(lines, "an element before its properties", &quoted(line)))?;
                    if !property_names.insert(name) {
                        return Err(malformed(lines, "each property once", &quoted(line)));
                    }
                    element.properties.push(Property { name, kind });
                }
                ["end_header"] => break,
                _ => return Err(malformed(lines, "a line of a PLY header", &quoted(line))),
            }
        }
        let encoding = encoding.ok_or_else(|| malformed(lines, "a line \"format\"", "none before end_header"))?;
        Ok(Self { encoding, elements, end, lines, antialiased })
    }

    pub(super) fn element(&self, name: &str) -> Option<&Element<'a>> {
        self.elements.iter().find(|element| element.name == name)
    }
}

impl Element<'_> {
    /// Index of a scalar property.
    pub(super) fn scalar(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|property| property.name == name && matches!(property.kind, Kind::Scalar(_)))
    }

    /// Index of a required scalar property.
    pub(super) fn required(&self, name: &str) -> Result<usize, Malformed> {
        self.scalar(name).ok_or_else(|| {
            let found: Vec<&str> = self.properties.iter().map(|property| property.name).take(12).collect();
            let more = if self.properties.len() > found.len() { ", …" } else { "" };
            let found = if found.is_empty() { "no properties".to_owned() } else { found.join(", ") };
            Malformed::new(
                format!("element {}", quoted(self.name.as_bytes())),
                format!("a property {name}"),
                found + more,
            )
        })
    }
}

fn format(line: usize, name: &str, version: &str) -> Result<Encoding, Malformed> {
    let encoding = match name {
        "ascii" => Some(Encoding::Ascii),
        "binary_little_endian" => Some(Encoding::BinaryLittleEndian),
        "binary_big_endian" => Some(Encoding::BinaryBigEndian),
        _ => None,
    };
    let known = encoding.filter(|_| version == "1.0");
    let expected = "ascii, binary_little_endian or binary_big_endian 1.0";
    known.ok_or_else(|| malformed(line, expected, &quoted(format!("{name} {version}").as_bytes())))
}

/// The type in `property <type> <name>` or `property list <type> <type> <name>`.
fn kind(words: &[&str]) -> Option<Kind> {
    match *words {
        [_, "list", length, item, _] => {
            let length = Scalar::from_name(length).filter(|length| !matches!(length, Scalar::F32 | Scalar::F64))?;
            Some(Kind::List { length, item: Scalar::from_name(item)? })
        }
        [_, scalar, _] => Scalar::from_name(scalar).map(Kind::Scalar),
        _ => None,
    }
}

fn malformed(line: usize, expected: &str, found: &str) -> Malformed {
    Malformed::new(format!("header line {line}"), expected, found)
}
