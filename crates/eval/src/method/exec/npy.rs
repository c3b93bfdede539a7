//! NumPy's `.npy` files, as `numpy.lib.format` describes them: little-endian arrays in C order.

use std::path::Path;

use atsplat_numeric::narrowed;
use atsplat_pixels::{Image, ImageU8};

use crate::method::range::{check_bytes, check_range};

/// What every file begins with, before the two bytes of its version.
const MAGIC: &[u8] = b"\x93NUMPY";
/// The header ends at a multiple of this many bytes.
const ALIGNMENT: usize = 64;

/// An 8-bit image as an array of `|u1`, H×W×3.
pub(super) fn of_image(image: &ImageU8) -> Vec<u8> {
    let shape = format!("({}, {}, 3)", image.height(), image.width());
    let mut header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}, }}");
    // Magic, version and length take ten bytes, the line's end one.
    let padding = (ALIGNMENT - (10 + header.len() + 1) % ALIGNMENT) % ALIGNMENT;
    header.extend(std::iter::repeat_n(' ', padding));
    header.push('\n');
    let mut bytes = MAGIC.to_vec();
    bytes.extend([1, 0]);
    // Two sizes of ten digits: the header is far below the 65535 bytes of version 1.
    bytes.extend((header.len() as u64).to_le_bytes().into_iter().take(2));
    bytes.extend(header.into_bytes());
    bytes.extend(image.samples());
    bytes
}

/// The images of a file with the shape T×H×W×3: floats in [0, 1] with overshoots (`<f2` is not read, `<f4` and `<f8` are)
/// or bytes, of which not all may be 0 and 1 unless all are 0.
///
/// # Errors
/// What was expected and what was found, with the file's name.
pub(super) fn read_images(path: &Path, shape: [usize; 4]) -> Result<Vec<Image>, String> {
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let bytes = atsplat_files::read(path).map_err(|error| format!("{name}: {error}"))?;
    images(&bytes, shape).map_err(|error| format!("{name}: {error}"))
}

fn images(bytes: &[u8], shape: [usize; 4]) -> Result<Vec<Image>, String> {
    let (header, data) = split(bytes)?;
    let field = |name: &str| field(header, name).ok_or_else(|| format!("expected {name} in the header {header:?}"));
    if field("fortran_order")? != "False" {
        return Err("expected an array in C order, as numpy.ascontiguousarray makes it, found Fortran order".to_owned());
    }
    let found = parsed_shape(field("shape")?).ok_or_else(|| format!("expected a shape in the header {header:?}"))?;
    if found != shape {
        return Err(format!("expected the shape {}, found {}", text(&shape), text(&found)));
    }
    let descr = field("descr")?;
    let (bytes_each, sample): (usize, fn(&[u8]) -> f32) = match descr.trim_matches(['\'', '"']) {
        "|u1" => (1, |bytes| if let [byte] = bytes { f32::from(*byte) / 255.0 } else { f32::NAN }),
        "<f4" => (4, |bytes| bytes.try_into().map_or(f32::NAN, f32::from_le_bytes)),
        "<f8" => (8, |bytes| bytes.try_into().map_or(f32::NAN, |bytes| narrowed(f64::from_le_bytes(bytes)))),
        _ => return Err(format!("expected the type <f4, <f8 or |u1, found {descr}")),
    };
    let [count, height, width, _] = shape;
    let each = height * width * 3;
    if data.len() != count * each * bytes_each {
        return Err(format!("expected {} bytes of data, found {}", count * each * bytes_each, data.len()));
    }
    if bytes_each == 1 {
        check_bytes(data)?;
    }
    let [width, height] = [width, height].map(|side| u32::try_from(side).map_err(|error| error.to_string()));
    let (width, height) = (width?, height?);
    let image = |part: &[u8]| {
        let samples = part.chunks_exact(bytes_each).map(sample).collect();
        Image::new(width, height, samples).map_err(|error| error.to_string())
    };
    let images: Vec<Image> = data.chunks_exact((each * bytes_each).max(1)).map(image).collect::<Result<_, _>>()?;
    for (at, image) in images.iter().enumerate() {
        check_range(image).map_err(|error| format!("image {at}: {error}"))?;
    }
    Ok(images)
}

/// Header and data.
fn split(bytes: &[u8]) -> Result<(&str, &[u8]), String> {
    const OTHER: &str = "expected a .npy file, found other bytes";
    let rest = bytes.strip_prefix(MAGIC).ok_or(OTHER)?;
    let (version, rest) = rest.split_first_chunk::<2>().ok_or(OTHER)?;
    let bytes_of_length = match version {
        [1, 0] => 2,
        [2 | 3, 0] => 4,
        [major, minor] => return Err(format!("expected a .npy file of version 1.0 to 3.0, found {major}.{minor}")),
    };
    let (length, rest) = rest.split_at_checked(bytes_of_length).ok_or(OTHER)?;
    let length = length.iter().rev().fold(0, |length, byte| length << 8 | usize::from(*byte));
    let (header, data) = rest.split_at_checked(length).ok_or(OTHER)?;
    Ok((std::str::from_utf8(header).ok().ok_or(OTHER)?, data))
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

    /// The first bytes are those of `numpy.save` (NumPy 2.3) for `numpy.arange(12, dtype="u1").reshape(1, 4, 3)`.
    #[test]
    fn writes_what_numpy_writes() {
        let image = ImageU8::new(4, 1, (0..12).collect()).unwrap();
        let bytes = of_image(&image);
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
            let read = images(&bytes, [2, 1, 2, 3]).unwrap();
            assert_eq!(read.iter().map(|image| (image.width(), image.height())).collect::<Vec<_>>(), [(2, 1); 2]);
            assert_eq!((read[0].samples(), read[1].samples()), (&values[..6], &values[6..]));
        }
        let levels = images(&file("|u1", "False", "(1, 1, 1, 3)", &[0, 51, 255]), [1, 1, 1, 3]).unwrap();
        assert_eq!(levels[0].samples(), [0.0, 0.2, 1.0]);
        let image = ImageU8::new(2, 1, vec![9; 6]).unwrap();
        assert!(images(&of_image(&image), [1, 1, 2, 3]).unwrap_err().contains("found (1, 2, 3)"));
    }

    #[test]
    fn the_version_decides_the_bytes_of_the_length() {
        let one = file("|u1", "False", "(1, 1, 1, 3)", &[0, 51, 255]);
        let of = |version: [u8; 2], length: usize| {
            let mut bytes = one.clone();
            bytes.splice(6..8, version);
            bytes.splice(10..10, vec![0; length - 2]);
            images(&bytes, [1, 1, 1, 3]).map(|images| images[0].samples().to_vec())
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
    fn floats_in_another_range_are_rejected() {
        let of = |sample: fn(f32) -> f32| {
            let values = (0..12u8).map(|at| if at < 6 { 0.0 } else { sample(f32::from(at) / 16.0) });
            let data: Vec<u8> = values.flat_map(f32::to_le_bytes).collect();
            images(&file("<f4", "False", "(2, 1, 2, 3)", &data), [2, 1, 2, 3])
        };
        assert_eq!(of(|x| x * 1.5).unwrap().len(), 2);
        let levels = of(|x| x * 255.0).unwrap_err();
        assert!(levels.starts_with("image 1: ") && levels.contains("seems to be 0…255"), "{levels}");
        assert!(of(|x| -x - 1.0).unwrap_err().contains("expected samples in [0, 1], found -1.69…-1.38"));
    }

    #[test]
    fn floats_that_were_cast_to_bytes_are_rejected_and_black_stays() {
        let of = |bytes: [u8; 12]| images(&file("|u1", "False", "(2, 1, 2, 3)", &bytes), [2, 1, 2, 3]);
        let mut bytes = [0; 12];
        assert!(of(bytes).unwrap().iter().flat_map(Image::samples).all(|sample| sample.to_bits() == 0), "black");
        bytes[7] = 1;
        let expected = "expected uint8 from 0 to 255, found only 0 and 1, as floats that were cast: multiply them by 255 before, or \
                        give floats in [0, 1]";
        assert_eq!(of(bytes), Err(expected.to_owned()));
        assert_eq!(of([1; 12]), Err(expected.to_owned()));
        bytes[0] = 2;
        assert!(of(bytes).is_ok(), "dark");
    }

    #[test]
    fn other_files_are_rejected_with_what_was_found() {
        let refused = |bytes: &[u8], shape| images(bytes, shape).unwrap_err();
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
            assert!(images(&bytes[..end], [1, 1, 2, 3]).is_err(), "the first {end} bytes");
        }
    }
}
