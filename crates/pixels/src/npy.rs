//! NumPy's `.npy` files of images, as `numpy.lib.format` describes them: little-endian arrays in C order.

use atsplat_numeric::narrowed;

use crate::{Image, ImageU8, PixelError};

/// What every file begins with, before the two bytes of its version.
const MAGIC: &[u8] = b"\x93NUMPY";
/// The header ends at a multiple of this many bytes.
const ALIGNMENT: usize = 64;

/// The images of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct NpyImages<'a> {
    /// In the order of the array's first axis.
    pub images: Vec<Image>,
    /// All samples as they are stored, if the array is of bytes.
    pub bytes: Option<&'a [u8]>,
}

/// An 8-bit image as a file: an array of `|u1`, H×W×3.
pub fn write(image: &ImageU8) -> Vec<u8> {
    let shape = format!("({}, {}, 3)", image.height(), image.width());
    let mut header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}, }}");
    // Magic, version and length take ten bytes, the line's end one.
    let padding = (ALIGNMENT - (10 + header.len() + 1) % ALIGNMENT) % ALIGNMENT;
    header.extend(std::iter::repeat_n(' ', padding));
    header.push('\n');
    let mut bytes = MAGIC.to_vec();
    bytes.extend([1, 0]);
    #[expect(clippy::expect_used, reason = "two sizes have at most twenty digits")]
    let length = u16::try_from(header.len()).expect("a header far below the 65535 bytes of version 1");
    bytes.extend(length.to_le_bytes());
    bytes.extend(header.into_bytes());
    bytes.extend(image.samples());
    bytes
}

/// The images of a file with this shape, T×H×W×3: floats (`<f4` and `<f8` are read, `<f2` is not), or bytes (`|u1`), of which 255
/// is 1. Floats have any values.
///
/// # Errors
/// [`PixelError::Npy`].
pub fn read(bytes: &[u8], shape: [usize; 4]) -> Result<NpyImages<'_>, PixelError> {
    let (header, data) = split(bytes)?;
    let field = |name: &str| {
        let missing = || invalid(format!("{name} in the header"), format!("{header:?}"));
        field(header, name).ok_or_else(missing)
    };
    if field("fortran_order")? != "False" {
        return Err(invalid("an array in C order, as numpy.ascontiguousarray makes it", "Fortran order"));
    }
    let found = parsed_shape(field("shape")?).ok_or_else(|| invalid("a shape in the header", format!("{header:?}")))?;
    if found != shape {
        return Err(invalid(format!("the shape {}", text(&shape)), text(&found)));
    }
    let descr = field("descr")?;
    let (bytes_each, samples): (usize, Decoder) = match descr.trim_matches(['\'', '"']) {
        "|u1" => (1, |data| data.iter().map(|byte| f32::from(*byte) / 255.0).collect()),
        "<f4" => (4, |data| data.as_chunks().0.iter().map(|value| f32::from_le_bytes(*value)).collect()),
        "<f8" => (8, |data| data.as_chunks().0.iter().map(|value| narrowed(f64::from_le_bytes(*value))).collect()),
        _ => return Err(invalid("the type <f4, <f8 or |u1", descr)),
    };
    let [count, height, width, _] = shape;
    let each = height * width * 3;
    if data.len() != count * each * bytes_each {
        return Err(invalid(format!("{} bytes of data", count * each * bytes_each), data.len().to_string()));
    }
    let too_many = || invalid(format!("at most {} rows and columns", u32::MAX), text(&shape));
    let [width, height] = [width, height].map(|side| u32::try_from(side).ok().ok_or_else(too_many));
    let (width, height) = (width?, height?);
    let image = |part: &[u8]| Image::new(width, height, samples(part));
    let images = data.chunks_exact((each * bytes_each).max(1)).map(image).collect::<Result<Vec<_>, _>>()?;
    Ok(NpyImages { images, bytes: (bytes_each == 1).then_some(data) })
}

/// Samples from their bytes.
type Decoder = fn(&[u8]) -> Vec<f32>;

fn invalid(expected: impl Into<String>, found: impl Into<String>) -> PixelError {
    PixelError::Npy { expected: expected.into(), found: found.into() }
}

/// Header and data.
fn split(bytes: &[u8]) -> Result<(&str, &[u8]), PixelError> {
    let other = || invalid("a .npy file", "other bytes");
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(other)?;
    let (version, rest) = rest.split_first_chunk::<2>().ok_or_else(other)?;
    let bytes_of_length = match version {
        [1, 0] => 2,
        [2 | 3, 0] => 4,
        [major, minor] => return Err(invalid("a .npy file of version 1.0 to 3.0", format!("{major}.{minor}"))),
    };
    let (length, rest) = rest.split_at_checked(bytes_of_length).ok_or_else(other)?;
    let length = length.iter().rev().fold(0, |length, byte| length << 8 | usize::from(*byte));
    let (header, data) = rest.split_at_checked(length).ok_or_else(other)?;
    Ok((std::str::from_utf8(header).ok().ok_or_else(other)?, data))
}

/// The value of a field of the header, a Python dictionary.
fn field<'a>(header: &'a str, name: &str) -> Option<&'a str> {
    let (_, rest) = header.split_once(&format!("'{name}':"))?;
    let rest = rest.trim_start();
    // A tuple ends with its parenthesis, anything else with a comma.
    let end = if rest.starts_with('(') { rest.find(')')? + 1 } else { rest.find([',', '}'])? };
    rest.get(..end).map(str::trim)
}

fn parsed_shape(tuple: &str) -> Option<Vec<usize>> {
    let inside = tuple.strip_prefix('(')?.strip_suffix(')')?;
    inside.split(',').map(str::trim).filter(|side| !side.is_empty()).map(|side| side.parse().ok()).collect()
}

/// A shape as Python writes it.
fn text(shape: &[usize]) -> String {
    let sides: Vec<String> = shape.iter().map(ToString::to_string).collect();
    format!("({})", sides.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(descr: &str, order: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}\n");
        let length = u16::try_from(header.len()).unwrap().to_le_bytes();
        [MAGIC, &[1, 0], &length, header.as_bytes(), data].concat()
    }

    fn samples(bytes: &[u8], shape: [usize; 4]) -> Result<Vec<f32>, String> {
        let read = read(bytes, shape).map_err(|error| error.to_string())?;
        Ok(read.images.iter().flat_map(|image| image.samples().to_vec()).collect())
    }

    /// The first bytes are those of `numpy.save` (NumPy 2.3) for `numpy.arange(12, dtype="u1").reshape(1, 4, 3)`.
    #[test]
    fn writes_what_numpy_writes() {
        let image = ImageU8::new(4, 1, (0..12).collect()).unwrap();
        let bytes = write(&image);
        let header = b"\x93NUMPY\x01\x00v\x00{'descr': '|u1', 'fortran_order': False, 'shape': (1, 4, 3), }";
        assert!(bytes.starts_with(header), "{:?}", String::from_utf8_lossy(&bytes));
        assert_eq!((bytes.len(), bytes[127], &bytes[128..]), (140, b'\n', &(0..12).collect::<Vec<u8>>()[..]));
    }

    #[test]
    fn reads_floats_and_bytes_row_by_row() {
        // Two images of one row and two columns.
        let values: Vec<f32> = (0..12u8).map(|at| f32::from(at) / 16.0).collect();
        let single: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let double: Vec<u8> = values.iter().flat_map(|value| f64::from(*value).to_le_bytes()).collect();
        for bytes in [file("<f4", "False", "(2, 1, 2, 3)", &single), file("<f8", "False", "(2, 1, 2, 3)", &double)] {
            let NpyImages { images, bytes } = read(&bytes, [2, 1, 2, 3]).unwrap();
            assert_eq!(images.iter().map(|image| (image.width(), image.height())).collect::<Vec<_>>(), [(2, 1); 2]);
            assert_eq!((images[0].samples(), images[1].samples()), (&values[..6], &values[6..]));
            assert_eq!(bytes, None);
        }
        let levels = file("|u1", "False", "(1, 1, 1, 3)", &[0, 51, 255]);
        let NpyImages { images, bytes } = read(&levels, [1, 1, 1, 3]).unwrap();
        assert_eq!((images[0].samples(), bytes), (&[0.0, 0.2, 1.0][..], Some(&[0, 51, 255][..])));
        let image = ImageU8::new(2, 1, vec![9; 6]).unwrap();
        assert!(samples(&write(&image), [1, 1, 2, 3]).unwrap_err().contains("found (1, 2, 3)"));
    }

    #[test]
    fn the_version_decides_the_bytes_of_the_length() {
        let one = file("|u1", "False", "(1, 1, 1, 3)", &[0, 51, 255]);
        let of = |version: [u8; 2], length: usize| {
            let mut bytes = one.clone();
            bytes.splice(6..8, version);
            bytes.splice(10..10, vec![0; length - 2]);
            samples(&bytes, [1, 1, 1, 3])
        };
        for (version, length) in [([1, 0], 2), ([2, 0], 4), ([3, 0], 4)] {
            assert_eq!(of(version, length).as_deref(), Ok(&[0.0, 0.2, 1.0][..]), "{version:?}");
        }
        for version in [[9, 0], [0, 0], [1, 7]] {
            let expected = format!("expected a .npy file of version 1.0 to 3.0, found {}.{}", version[0], version[1]);
            assert_eq!([2, 4].map(|length| of(version, length)), [Err(expected.clone()), Err(expected)]);
        }
    }

    #[test]
    fn other_files_are_rejected_with_what_was_found() {
        let refused = |bytes: &[u8], shape| samples(bytes, shape).unwrap_err();
        let four = [0; 4 * 6];
        let cases = [
            (refused(b"P6 2 2 255", [1, 1, 2, 3]), "a .npy file"),
            (refused(&file("<f4", "False", "(1, 2, 1, 3)", &four), [1, 1, 2, 3]), "found (1, 2, 1, 3)"),
            (refused(&file("<f4", "True", "(1, 1, 2, 3)", &four), [1, 1, 2, 3]), "C order"),
            (refused(&file(">f4", "False", "(1, 1, 2, 3)", &four), [1, 1, 2, 3]), "found '>f4'"),
            (refused(&file("<f4", "False", "(1, 1, 2, 3)", &four[1..]), [1, 1, 2, 3]), "expected 24 bytes"),
            (refused(&file("<f4", "False", "(1, x)", &four), [1, 1, 2, 3]), "a shape"),
        ];
        for (found, expected) in cases {
            assert!(found.contains(expected), "{found}");
        }
        let bytes = file("<f4", "False", "(1, 1, 2, 3)", &four);
        for end in 0..bytes.len() {
            assert!(read(&bytes[..end], [1, 1, 2, 3]).is_err(), "the first {end} bytes");
        }
    }
}
